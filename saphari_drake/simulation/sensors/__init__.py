"""Simulated sensors: what measurements a plant would give."""
