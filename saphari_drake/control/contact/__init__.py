"""Impedance and force laws at a contact that was found, Section 7."""
