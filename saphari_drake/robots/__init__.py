"""A robot as the controllers see it."""
