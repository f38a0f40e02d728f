"""The model of a camera, its frames, and the check that it stands where it should."""
