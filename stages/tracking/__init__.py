"""What MLflow shows, computed from artifacts: it can be made again at any time, and nothing is read back from it."""
