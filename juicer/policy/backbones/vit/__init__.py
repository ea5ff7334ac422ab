"""Vision transformer with patches of 16 pixels: the encoder of DINO and of MAE."""
