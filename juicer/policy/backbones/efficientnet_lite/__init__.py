"""EfficientNet-Lite0: a small network whose pretrained weights install from the package registry."""
