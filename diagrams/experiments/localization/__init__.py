"""Where touches are, over many scenes."""
