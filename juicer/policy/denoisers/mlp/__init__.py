"""Residual MLP on the flattened action chunk: the denoiser for CPUs."""
