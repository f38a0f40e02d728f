"""Joint envelope: the last element before the torque, which nothing leaves."""
