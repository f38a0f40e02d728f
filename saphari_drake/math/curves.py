"""Curves from 0 to 1."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit


@njit(cache=True)
def quintic(a):
    """Return s = 6a⁵ − 15a⁴ + 10a³ with `a` clipped to [0, 1], s′ and s″: no slope and no curvature at both ends.

    Of all curves from rest to rest it has the least mean square jerk (Flash and Hogan, 1985). `a` is a number or an
    array, and s′ is at most 15/8, at a = 1/2.
    """
    a = np.minimum(np.maximum(a, 0.0), 1.0)
    b = a * (1.0 - a)
    return a * a * a * (10.0 + a * (6.0 * a - 15.0)), 30.0 * b * b, 60.0 * b * (1.0 - 2.0 * a)
