"""Velocity envelope: no velocity is commanded that the motors cannot give, or that they cannot stop in time."""
