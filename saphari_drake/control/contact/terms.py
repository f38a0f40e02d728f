"""What the controllers of a contact share: named torque terms, laws without a contact, and changes without a jump."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.messages import Immutable
from saphari_drake.robots.dynamics import DynamicsTerms

Array = NDArray[np.float64]
Law = tuple[str, int, int]  # name, onset and link of the contact


class TorqueTerms(NamedTuple):
    """Named parts (n,) of a torque command (Nm); their sum is the command before limits."""

    task: Array
    force: Array
    misfit: Array
    null_space: Array
    coriolis: Array
    gravity: Array
    transition: Array

    def total(self) -> Array:
        """Return the sum of all parts."""
        return np.sum(self, axis=0)


def posture_torque(terms: DynamicsTerms, q_desired: Array, stiffness: Array, damping: Array) -> TorqueTerms:
    """Return the computed torque M(K(q_d − q) − D q̇) + C q̇ + g, with K in 1/s² and D in 1/s, (n,)."""
    zero = np.zeros(len(terms.q))
    task = terms.M @ (stiffness * (q_desired - terms.q) - damping * terms.v)
    return TorqueTerms(task, zero, zero, zero, terms.Cv, terms.g, zero)


def misfit_torque(misfit: Array, F: Array, lever: float) -> Array:
    """Return −(r − J_cᵀF̂), each joint bounded by `lever` ‖F̂‖ (n,).

    It is zero for a force at the assumed point. A point that is wrong by some millimetres leaves a steady torque, which
    the law at the contact opposes in the null space by damping alone, so that a light wrist turns away under the hand.

    Parameters
    ----------
    misfit : (n,) array
        r − J_cᵀF̂, the part of the residual that the estimated force does not explain (Nm).
    F : (3,) array
        Estimated force (N).
    lever : float
        Error of the contact point that would explain as much (m).
    """
    bound = lever * float(np.linalg.norm(F))
    return np.clip(-misfit, -bound, bound)


@dataclass(frozen=True)
class Handover(Immutable):
    """Law, torque and fading offset of the cycle before, for a change of law without a jump."""

    law: Law | None
    torque: Array
    offset: Array

    def into(self, law: Law, parts: TorqueTerms) -> TorqueTerms:
        """Return the parts of `law` with the offset that continues the torque of the cycle before."""
        same = self.law is None or self.law == law
        return parts._replace(transition=self.offset if same else self.torque - parts.total())
