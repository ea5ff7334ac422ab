"""How a stage call runs: recipe, reuse, a process of its own, a Prefect task."""
