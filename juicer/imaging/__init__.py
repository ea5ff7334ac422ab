"""Images of a scene, and what is made of them."""
