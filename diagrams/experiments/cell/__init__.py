"""What the safe cell is made of, how it is run, judged and shown."""
