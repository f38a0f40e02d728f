"""Elements that may only reduce what the robot does."""
