"""People drive the robot: devices, what they mean by them, and how nothing of it is lost. No web in it."""
