"""What is recorded in a run, and the files it goes to."""
