"""Safe dynamic control of redundant robots beside people, as Drake systems."""

__version__ = "0.1.0"
