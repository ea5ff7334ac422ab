"""Looking through a store: artifacts, their episodes as images, and what was made from what."""
