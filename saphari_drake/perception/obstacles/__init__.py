"""Obstacles in depth images, followed over time."""
