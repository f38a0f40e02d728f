"""Rotations as 3×3 arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.products import apply


def are_rotations(R: NDArray[np.float64], tolerance: float = 1e-6) -> bool:
    """Whether all of (…, 3, 3) are rotations: finite, orthonormal and right-handed."""
    if not np.isfinite(R).all():
        return False
    apart = np.abs(np.einsum("...ij,...ik->...jk", R, R) - np.eye(3))
    right = np.einsum("...i,...i->...", np.cross(R[..., 0], R[..., 1]), R[..., 2])
    return bool(np.all(apart < tolerance) and np.all(right > 0.0))


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
    R = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            R[i, j] = (1.0 - c) * axis[i] * axis[j]
        R[i, i] += c
    R[0, 1] -= s * axis[2]
    R[0, 2] += s * axis[1]
    R[1, 0] += s * axis[2]
    R[1, 2] -= s * axis[0]
    R[2, 0] -= s * axis[1]
    R[2, 1] += s * axis[0]
    return R


@njit(cache=True)
def rotation_exp(e: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation matrix (3, 3) of a rotation vector."""
    angle = np.sqrt(np.sum(e * e))
    return axis_rotation(e / angle, angle) if angle > 0.0 else np.eye(3)


@njit(cache=True)
def rotation_log(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation vector (3,) of a rotation matrix, of length up to π."""
    axial = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = np.sqrt(np.sum(axial * axial)), 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6:
        return axial * (angle / sine)
    if cosine > 0.0:
        return axial
    B = 0.5 * (R + R.T) + np.eye(3)  # 2 u uᵀ at half a turn
    column = B[:, np.argmax(np.diag(B))]
    return column * (angle / np.sqrt(np.sum(column * column)))


@njit(cache=True)
def rotation_rate(
    e: NDArray[np.float64], w_desired: NDArray[np.float64], w: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return d/dt log(R_d Rᵀ)^∨ = J_l(e)⁻¹ ω_d − J_r(e)⁻¹ ω (3,)."""
    angle = np.sqrt(np.sum(e * e))
    c = 1.0 / 12.0 if angle < 1e-3 else 1.0 / angle**2 - 0.5 / (angle * np.tan(0.5 * angle))
    E, wrong = skew(e), w_desired - w
    return wrong - 0.5 * apply(E, w_desired + w) + c * apply(E, apply(E, wrong))


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
