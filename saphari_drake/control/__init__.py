"""Torque laws, each a pure function and a thin LeafSystem."""
