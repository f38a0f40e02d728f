"""Whether encoders and drives of a robot say what can be true."""
