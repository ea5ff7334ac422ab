"""Flow of noise into action chunks, in one step or a few."""
