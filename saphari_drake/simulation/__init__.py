"""The simulated cell, its people, and the runner of experiments."""
