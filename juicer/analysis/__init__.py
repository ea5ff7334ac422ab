"""What else there is to know of a trained policy than its success rate."""
