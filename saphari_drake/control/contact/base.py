"""What the controllers of a contact share: their inputs, the postures without a contact, and the torque outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, State

from saphari_drake.control.contact.terms import TorqueTerms, posture_torque
from saphari_drake.math.task_space import consistent_inverse
from saphari_drake.messages import ContactPoint, Immutable, Interaction, InteractionMode
from saphari_drake.parameters import diagonal, positive_definite
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


class SharedParameters(Protocol):
    """Parameters that every controller of a contact has."""

    M_d: list[float]
    hold_stiffness: list[float] | float
    hold_damping: list[float] | float
    yield_damping: list[float] | float
    transition_time: float
    period: float


def inverse_inertia(params: SharedParameters) -> Array | None:
    """Return M_d⁻¹ (3, 3) in 1/kg, None for the natural inertia."""
    if not len(params.M_d):
        return None
    return np.array(np.linalg.inv(positive_definite(params.M_d, 3, "M_d")))


class ContactController(LeafSystem):
    """Base of the controllers of a contact.

    A subclass adds its own inputs and calls `_declare_outputs` at the end of its constructor.
    """

    def __init__(self, robot: RobotModel, params: SharedParameters) -> None:
        super().__init__()
        consistent_inverse(np.eye(3, robot.n), np.eye(robot.n), 1.0)  # compiled before the first control step
        self._robot, self._period = robot, params.period
        n = robot.n
        self._hold = diagonal(params.hold_stiffness, n, "hold_stiffness")
        self._hold_damping = diagonal(params.hold_damping, n, "hold_damping")
        self._yield_damping = diagonal(params.yield_damping, n, "yield_damping")
        self._fade = float(np.exp(-params.period / params.transition_time))
        self._terms_at_home = evaluate_dynamics(robot, robot.home, np.zeros(n))
        nobody = Interaction(InteractionMode.HOLD, ContactPoint(), robot.home, 0)
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(self._terms_at_home))
        self._interaction = self.DeclareAbstractInputPort("interaction", AbstractValue.Make(nobody))
        self._force = self.DeclareVectorInputPort("contact_force", BasicVector(3))
        self._misfit = self.DeclareVectorInputPort("misfit", BasicVector(n))

    def _declare_outputs(
        self,
        evaluate: Callable[[Context], Any],
        update: Callable[[Context, State], None],
        start: object,
        memory: Immutable,
        more_inputs: Sequence[InputPort],
        readouts: Mapping[str, tuple[int, Callable[[Any], Any]]],
    ) -> None:
        """Declare the state and its cycle, the cached evaluation, and the outputs read from it.

        What `evaluate` returns has at least ``terms`` (`TorqueTerms`), ``torque`` and ``excess``; `start` is one of it.
        """
        n = self._robot.n
        self._memory = self.DeclareAbstractState(AbstractValue.Make(memory))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._period), update=update)
        ports = self._dynamics, self._interaction, self._force, self._misfit, *more_inputs
        tickets = {port.ticket() for port in ports} | {self.abstract_state_ticket(self._memory)}
        self._output = declare_cache(self, "torque", start, evaluate, tickets)
        shared = {
            "torque_commanded": (n, lambda o: o.torque),
            "torque_excess": (n, lambda o: o.excess),
            "torque_terms": (len(TorqueTerms._fields) * n, lambda o: np.concatenate(o.terms)),
        }
        declare_readouts(self, self._output, {**shared, **readouts})

    def _held(self, terms: DynamicsTerms, interaction: Interaction) -> TorqueTerms:
        """Return the torque that holds the latched posture."""
        return posture_torque(terms, interaction.q_latched, self._hold, self._hold_damping)

    def _damped(self, terms: DynamicsTerms, damping: Array) -> TorqueTerms:
        """Return damping (1/s), Coriolis and gravity terms alone."""
        return posture_torque(terms, terms.q, self._hold, damping)
