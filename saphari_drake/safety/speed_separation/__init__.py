"""Speed and separation monitoring: as fast as the way to people allows."""
