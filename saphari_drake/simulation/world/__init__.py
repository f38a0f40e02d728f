"""Bodies, cells and references of the simulated world."""
