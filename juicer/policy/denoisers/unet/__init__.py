"""1-D U-Net along the time axis of an action chunk: the denoiser of the paper."""
