"""What a tree of links would weigh on its joints if masses were not quite those of the model."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit


@njit(cache=True)
def weight_regressor(motion, mass, com, gravity):
    """Return (n, n + 4) columns whose sum with factors θ is the gravity torque that is added.

    Column k is the gravity torque of link k alone, θ_k its relative error of mass. The last four are those of a tool
    in the last link: its mass (kg), and its first moments about the origin of that link (kg m), in the link's frame.

    Parameters
    ----------
    motion : TreeMotion
    mass, com : (n,) and (n, 3) arrays
        Of each link (kg, and m in its frame).
    gravity : (3,) array
        In the world (m/s²).
    """
    n = len(mass)
    W = np.zeros((n, n + 4))
    c = np.empty(3)
    for k in range(n):
        R, p = motion.R_WL[k], motion.p_WL[k]
        for i in range(3):
            c[i] = p[i] + R[i, 0] * com[k, 0] + R[i, 1] * com[k, 1] + R[i, 2] * com[k, 2]
        j = k
        while j >= 0:
            S = motion.S[j]
            W[j, k] = -mass[k] * _lift(S, c, gravity)
            if k == n - 1:
                W[j, n] = -_lift(S, p, gravity)
                # −gᵀ(w × R e_i) = −(g × w)ᵀ R e_i
                x = gravity[1] * S[2] - gravity[2] * S[1]
                y = gravity[2] * S[0] - gravity[0] * S[2]
                z = gravity[0] * S[1] - gravity[1] * S[0]
                for i in range(3):
                    W[j, n + 1 + i] = -(x * R[0, i] + y * R[1, i] + z * R[2, i])
            j = motion.parent[j]
    return W


@njit(cache=True)
def _lift(S, c, gravity):
    """Return gᵀ(w × c + v), the velocity of point c along gravity for a unit velocity of a joint."""
    return (
        gravity[0] * (S[1] * c[2] - S[2] * c[1] + S[3])
        + gravity[1] * (S[2] * c[0] - S[0] * c[2] + S[4])
        + gravity[2] * (S[0] * c[1] - S[1] * c[0] + S[5])
    )
