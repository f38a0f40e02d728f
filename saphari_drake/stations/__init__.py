"""A robot at the other end, real or simulated, behind the same ports."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
