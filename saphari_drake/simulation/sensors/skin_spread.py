"""How a load on a skin spreads over its modules: the compiled pass of `SkinModules`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit

_POINTS = 400
_GOLDEN = 2.399963229728653  # rad, turn from one point of a sunflower to the next


class Patch(NamedTuple):
    """The modules of a patch, and the cover that spreads what presses on them."""

    rows: int
    columns: int
    pitch: float  # m, side of a module
    layer: float  # m, side of the square (≤ pitch) over which the soft cover spreads a point load


class Ellipse(NamedTuple):
    """Where a load presses."""

    centre: NDArray[np.float64]  # (2,) m, in surface coordinates
    radius: float  # m, geometric mean of the half axes
    aspect: float  # their ratio
    turn: float  # rad, angle of the longer one from u


@njit(cache=True)
def spread_load(patch, ellipse, exponent, share, lean):
    """Add up what each module carries of a unit load with the profile (1 − r²/a²)ᵉ on an ellipse.

    Each of 400 points of equal load presses on a square. What falls beside the patch is lost.

    Parameters
    ----------
    patch : Patch
    ellipse : Ellipse
    exponent : float
        e: 0.5 as in Hertz's contact, 0 uniform.
    share : (m,) array
        Filled with the share of each module, 0–1.
    lean : (m, 2) array
        Filled with where the load of a module acts: −1 … 1 from one edge to the other, zero without load.
    """
    share[:] = 0.0
    lean[:] = 0.0
    cos, sin = np.cos(ellipse.turn), np.sin(ellipse.turn)
    long, short = ellipse.radius * np.sqrt(ellipse.aspect), ellipse.radius / np.sqrt(ellipse.aspect)
    weight = np.empty(2)
    for k in range(_POINTS):
        r = np.sqrt(1.0 - (1.0 - (k + 0.5) / _POINTS) ** (1.0 / (exponent + 1.0)))
        a, b = long * r * np.cos(_GOLDEN * k), short * r * np.sin(_GOLDEN * k)
        # In pitches from the corner of the patch.
        x = (ellipse.centre[0] + cos * a - sin * b) / patch.pitch + 0.5 * patch.rows
        y = (ellipse.centre[1] + sin * a + cos * b) / patch.pitch + 0.5 * patch.columns
        half = 0.5 * patch.layer / patch.pitch
        i0, j0 = int(np.floor(x - half)), int(np.floor(y - half))
        for i in range(i0, i0 + 2):
            low, high = max(x - half, float(i)), min(x + half, i + 1.0)
            if high < low or i < 0 or i >= patch.rows:
                continue
            weight[0] = (high - low) / (2.0 * half) if half > 0.0 else (1.0 if i == i0 else 0.0)
            lean_u = low + high - 2.0 * i - 1.0
            for j in range(j0, j0 + 2):
                low_v, high_v = max(y - half, float(j)), min(y + half, j + 1.0)
                if high_v < low_v or j < 0 or j >= patch.columns:
                    continue
                weight[1] = (high_v - low_v) / (2.0 * half) if half > 0.0 else (1.0 if j == j0 else 0.0)
                w = weight[0] * weight[1] / _POINTS
                m = i * patch.columns + j
                share[m] += w
                lean[m, 0] += w * lean_u
                lean[m, 1] += w * (low_v + high_v - 2.0 * j - 1.0)
    for m in range(share.shape[0]):
        if share[m] > 0.0:
            lean[m, 0] /= share[m]
            lean[m, 1] /= share[m]
