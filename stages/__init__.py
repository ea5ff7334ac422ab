"""Stages: what goes into and comes out of each step of the pipeline, one Prefect task each."""
