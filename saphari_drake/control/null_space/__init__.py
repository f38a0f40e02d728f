"""Compliance of the null space below a Cartesian task."""
