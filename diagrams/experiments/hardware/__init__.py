"""A robot at the other end: what the script that drives it and its tests share."""
