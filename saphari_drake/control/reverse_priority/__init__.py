"""Task priorities with reversed recursion: velocities for stacks of tasks and bounds."""
