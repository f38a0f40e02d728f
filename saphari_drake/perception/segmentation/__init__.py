"""What in a depth image is background, robot or person."""
