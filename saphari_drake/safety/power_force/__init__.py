"""Power and force limiting: no faster than a contact may be hard."""
