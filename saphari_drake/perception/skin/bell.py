"""The bell of pressure under a touch, integrated over the modules of a skin."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit

_ROOT2 = math.sqrt(2.0)
_ROOT2PI = math.sqrt(2.0 * math.pi)

# Flatness of a bell: the profile is a Gaussian times 1 + FLATNESS (r²/s² − 2). The least squares fit to the parabolic
# pressure between a soft cover and a round tip gives 0.26, to Hertz's 0.27.
FLATNESS = 0.26


class Grid(NamedTuple):
    """Where the modules of a patch, or of a window of it, lie on its surface."""

    u: NDArray[np.float64]  # (a,) m, coordinates of the rows
    v: NDArray[np.float64]  # (b,) m, and of the columns
    pitch: float  # m


@njit(cache=True)
def _segment(a, b, out):
    """Fill the integrals of a bell's factors between a and b, and their slopes.

    P = ∫φ and E = [xφ], each with its first and second slope as the bell moves by one width, and the slope of itself
    and of its first slope over log width: P, Pu, Puu, Ps, Pus, E, Eu, Euu, Es, Eus.
    """
    fa, fb = math.exp(-0.5 * a * a) / _ROOT2PI, math.exp(-0.5 * b * b) / _ROOT2PI
    aa, bb = a * a, b * b
    e = b * fb - a * fa
    out[0] = 0.5 * (math.erf(b / _ROOT2) - math.erf(a / _ROOT2))
    out[1] = fa - fb
    out[2] = -e
    out[3] = -e
    out[4] = aa * fa - bb * fb
    out[5] = e
    out[6] = (1.0 - aa) * fa - (1.0 - bb) * fb
    out[7] = a * (3.0 - aa) * fa - b * (3.0 - bb) * fb
    out[8] = a * (1.0 - aa) * fa - b * (1.0 - bb) * fb
    out[9] = aa * (3.0 - aa) * fa - bb * (3.0 - bb) * fb


@njit(cache=True)
def bell_share(grid, shape, share, slope):
    """Fill how much of a unit bell each module of a grid carries (a·b,), and its slope over the shape (a·b, 5).

    The bell is integrated over the square of the module, so that an endless grid carries all of it.

    Parameters
    ----------
    grid : Grid
    shape : (5,) array
        Middle u, v (m), log of the widths s_u and s_v (m), and skew c: the first-order turn of the axes, c s_u s_v
        ∂²/∂u∂v of the upright bell.
    share : (a·b,) array
    slope : (a·b, 5) array
    """
    u, v, half = grid.u, grid.v, 0.5 * grid.pitch
    su, sv, c = math.exp(shape[2]), math.exp(shape[3]), shape[4]
    x, y = np.empty(10), np.empty((v.shape[0], 10))
    for j in range(v.shape[0]):
        _segment((v[j] - shape[1] - half) / sv, (v[j] - shape[1] + half) / sv, y[j])
    for i in range(u.shape[0]):
        _segment((u[i] - shape[0] - half) / su, (u[i] - shape[0] + half) / su, x)
        for j in range(v.shape[0]):
            k, z = i * v.shape[0] + j, y[j]
            skew = _bell(x, z, 1, 1)
            share[k] = _bell(x, z, 0, 0) + c * skew
            slope[k, 0] = (_bell(x, z, 1, 0) + c * _bell(x, z, 2, 1)) / su
            slope[k, 1] = (_bell(x, z, 0, 1) + c * _bell(x, z, 1, 2)) / sv
            slope[k, 2] = _bell(x, z, 3, 0) + c * _bell(x, z, 4, 1)
            slope[k, 3] = _bell(x, z, 0, 3) + c * _bell(x, z, 1, 4)
            slope[k, 4] = skew


@njit(cache=True)
def _bell(x, y, i, j):
    """Return the upright bell, or one of its slopes, from the parts along u and v."""
    return x[i] * y[j] - FLATNESS * (x[5 + i] * y[j] + x[i] * y[5 + j])
