"""Predictive control past obstacles and people."""
