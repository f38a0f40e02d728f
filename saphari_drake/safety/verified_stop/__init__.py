"""A verified stop behind every velocity command."""
