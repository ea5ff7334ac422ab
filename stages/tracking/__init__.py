"""What an experiment consisted of, told to MLflow: written to local journals first, delivered from there."""
