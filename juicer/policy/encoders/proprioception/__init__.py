"""The robot's own readings, and nothing else: what a policy sees beside images."""
