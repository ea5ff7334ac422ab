"""What the commands of the command line do, grouped by what they need to import."""
