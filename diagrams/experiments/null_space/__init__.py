"""Compliance beside a ball and a wall."""
