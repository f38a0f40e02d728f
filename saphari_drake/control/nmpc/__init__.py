"""Nonlinear model predictive control of an arm or a mobile manipulator among obstacles, eq. (9)–(22)."""
