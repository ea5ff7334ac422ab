"""What stands behind :mod:`juicer.api`: names of models, tables, evaluations and images for whoever works in Python."""
