"""Image augmentation: colour jitter and blur, one draw a sample, on the device that trains."""
