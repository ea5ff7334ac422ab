"""What ``juicer doctor`` looks at on a machine, one module a kind of thing."""
