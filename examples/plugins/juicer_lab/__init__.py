"""What a lab adds to juicer without touching it."""
