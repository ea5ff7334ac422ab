"""Pretrained weights of backbones: which there are, where their files are looked for, and how they are read safely."""
