"""Rotations as 3×3 arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit


@njit(cache=True)
def skew(w: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the 3×3 matrix with ``skew(w) @ a == cross(w, a)``."""
    S = np.zeros((3, 3))
    S[0, 1], S[0, 2] = -w[2], w[1]
    S[1, 0], S[1, 2] = w[2], -w[0]
    S[2, 0], S[2, 1] = -w[1], w[0]
    return S


@njit(cache=True)
def axis_rotation(axis: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Return the rotation by `angle` (rad) about the unit vector `axis` (Rodrigues)."""
    s, c = np.sin(angle), np.cos(angle)
    K = skew(axis)
    return c * np.eye(3) + s * K + (1.0 - c) * np.outer(axis, axis)


def rotation_between(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shortest rotation R with ``R @ a`` along ``b``.

    Parameters
    ----------
    a, b : (3,) array
        Directions of any length but zero. Opposite directions turn about an axis normal to `a`.
    """
    a = np.asarray(a, dtype=float) / np.linalg.norm(a)
    b = np.asarray(b, dtype=float) / np.linalg.norm(b)
    axis = np.cross(a, b)
    angle = float(np.arctan2(np.linalg.norm(axis), a @ b))
    if angle > np.pi - 1e-12:
        axis = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    axis = axis - (axis @ a) * a  # for nearly opposite directions, rounding leaves it not quite normal to a
    length = float(np.linalg.norm(axis))
    return np.eye(3) if length < 1e-12 else np.asarray(axis_rotation(axis / length, angle))
