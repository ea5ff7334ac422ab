"""Training: from episodes to windows, from windows to a checkpoint, resumable bit for bit."""
