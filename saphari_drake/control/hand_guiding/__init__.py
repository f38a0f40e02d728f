"""Hand guiding by touches on the skin and at the tool."""
