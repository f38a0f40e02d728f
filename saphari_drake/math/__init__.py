"""Laws and geometry on plain arrays; imports numpy and numba alone."""
