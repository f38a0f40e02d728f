"""Cameras and what is read from their images."""
