"""People: hands that push and guide, recorded motions and forces."""
