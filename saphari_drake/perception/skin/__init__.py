"""A sensitive skin: layout, calibration, and the contacts that it feels."""
