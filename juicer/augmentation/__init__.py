"""Trajectory augmentation: corrective episodes grown around the critical states of demonstrations."""
