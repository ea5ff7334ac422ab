"""ResNet with 18, 34 or 50 layers: the encoder of the paper, of R3M and of VIP."""
