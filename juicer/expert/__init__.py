"""The scripted operator, who stands in for a person."""
