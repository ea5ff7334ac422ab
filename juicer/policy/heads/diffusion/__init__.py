"""Denoising diffusion over action chunks."""
