"""Pushes against an arm that yields or holds a force."""
