"""The supervisor: one state of the cell, one table of transitions."""
