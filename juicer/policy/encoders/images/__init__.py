"""Images of cameras through a backbone: what a policy sees where nobody knows the poses of parts."""
