"""Where the links of a robot are and how they move: the one way to positions and Jacobians."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import StateError
from saphari_drake.math.tree import TreeMotion
from saphari_drake.math.tree_matrices import point_kinematics
from saphari_drake.messages import Immutable

Array = NDArray[np.float64]


class PointKinematics(NamedTuple):
    """Motion of a point C fixed in a link, in the world frame."""

    p_WC: Array  # (3,) position, m
    v_WC: Array  # (3,) velocity, m/s
    Jv_WC: Array  # (3, n) Jacobian, v_WC = Jv_WC q̇
    Jdotv_WC: Array  # (3,) J̇q̇, m/s²


@dataclass(frozen=True)
class Kinematics(Immutable):
    """Kinematics of all links at one state.

    Attributes
    ----------
    R_WL, p_WL : (n, 3, 3) and (n, 3) arrays
        Poses of the links in the world.
    S, V, A : (n, 6) arrays
        Joint axes, link velocities, and link accelerations for q̈ = 0: spatial [ω; v], at the world origin.
    parent : (n,) array of int
        Link that carries each joint (−1: the world).
    """

    R_WL: Array
    p_WL: Array
    S: Array
    V: Array
    A: Array
    parent: NDArray[np.int64]

    @property
    def motion(self) -> TreeMotion:
        """Poses and motion of the links, as the compiled laws take them."""
        return TreeMotion(self.R_WL, self.p_WL, self.S, self.V, self.A, self.parent)

    def position(self, link: int, p_LC: Array) -> Array:
        """Return the position (3,) in the world of point p_LC (m, link frame) of a link."""
        self._require(link, p_LC)
        return self.p_WL[link] + self.R_WL[link] @ p_LC

    def in_link(self, link: int, p_W: Array) -> Array:
        """Return a point of the world (3,) in the frame of a link (m)."""
        self._require(link, p_W)
        return self.R_WL[link].T @ (p_W - self.p_WL[link])

    def point(self, link: int, p_LC: Array) -> PointKinematics:
        """Return position, velocity, Jacobian and J̇q̇ of point p_LC (m, link frame) of a link.

        Raises
        ------
        StateError
            If there is no such link, or the point is not three numbers; a compiled law would read what lies behind.
        """
        self._require(link, p_LC)
        return PointKinematics(*point_kinematics(self.motion, link, p_LC))

    def _require(self, link: int, p: Array) -> None:
        links = len(self.p_WL)
        if not (isinstance(link, int | np.integer) and 0 <= link < links):
            raise StateError(f"link: there are 0 … {links - 1}, got {link!r}")
        if np.shape(p) != (3,):
            raise StateError(f"point: needs three numbers, got shape {np.shape(p)}")
