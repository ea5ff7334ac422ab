"""A small convolutional network of our own, fast on CPUs."""
