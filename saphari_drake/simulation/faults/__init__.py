"""Faults that a scenario names, brought in at the simulated side."""
