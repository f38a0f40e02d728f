"""An arm guided by hand."""
