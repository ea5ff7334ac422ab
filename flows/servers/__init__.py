"""Prefect's and MLflow's servers as juicer runs them: behind a guard, with a password, ended with their starter."""
