"""What is known of the relative poses of parts and gripper, as numbers; for state observations."""
