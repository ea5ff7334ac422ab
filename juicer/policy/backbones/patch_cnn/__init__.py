"""A small convolutional network that begins with patches, and is as wide as processors like it."""
