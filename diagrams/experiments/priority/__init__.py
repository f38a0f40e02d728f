"""Tasks by priority, planar and in space."""
