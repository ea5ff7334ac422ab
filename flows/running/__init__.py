"""What a run is made of: its settings, context, plan, execution and repair."""
