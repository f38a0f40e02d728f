"""Decides what a contact means: hold, answer at a known point, return, yield, or stop."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.errors import ParameterError
from saphari_drake.messages import (
    CameraStatus,
    ContactPoint,
    Immutable,
    Interaction,
    InteractionMode,
    SystemStatus,
    status_of,
)
from saphari_drake.parameters import require_positive
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_outputs, declare_readouts

Array = NDArray[np.float64]
_CAMERA_WORKS = (CameraStatus.WAITING, CameraStatus.OK)


@dataclass
class ContactMonitorParameters:
    """When a contact is new, when a return is over."""

    # m; a contact point that moves farther than this over the robot, from frame to frame, is a new contact. One that
    # slides over the border of two links is not. While the touch lasts, the posture stays that in which it began.
    new_contact_distance: float = 0.05
    # s; how long a contact that is felt, but that no camera sees any more, is still answered; then the robot yields. A
    # law that pushes back needs this second sign that somebody is there.
    unseen_time: float = np.inf
    # m and rad/s; a return is over when the contact point is this near its latched position and the joints are slow;
    # after yielding, when they are slow,
    position_tolerance: float = 0.001
    velocity_tolerance: float = 0.02
    # s; for this long,
    settle_time: float = 0.2
    # s; or when it has lasted this long.
    return_timeout: float = 5.0
    # s; how long the camera must work again, and the state be known, before a stop ends.
    camera_recovery_time: float = 0.5
    # s; the control cycle.
    period: float = 0.005

    def __post_init__(self) -> None:
        if not self.unseen_time > 0.0:
            raise ParameterError("unseen_time", f"must be positive, got {self.unseen_time}")
        require_positive(
            self,
            "new_contact_distance",
            "position_tolerance",
            "velocity_tolerance",
            "settle_time",
            "return_timeout",
            "camera_recovery_time",
            "period",
        )


@dataclass(frozen=True)
class _Memory(Immutable):
    """State of the monitor: its decision and how long things have lasted (s); `works`: camera and known state."""

    interaction: Interaction
    in_mode: float = 0.0
    settled: float = 0.0
    left: float = 0.0  # since nobody touches the yielding robot
    unseen: float = 0.0  # since the contact was seen
    works: float = np.inf


class ContactMonitor(LeafSystem):
    """Decides the mode of physical interaction and latches what belongs to it.

    .. pydrake_system::

        name: ContactMonitor
        input_ports:
        - dynamics
        - contact
        - contact_point
        - camera_status
        output_ports:
        - interaction
        - active_contact
        - mode
        - system_status

    Ports
    -----
    dynamics : abstract `DynamicsTerms`.
    contact : 1, from `ContactDetector`.
    contact_point : abstract `ContactPoint`, from `ContactLocalizer`.
    camera_status : 1, a `CameraStatus`.
    interaction : abstract `Interaction`.
    active_contact : abstract `ContactPoint`, the one that is touched (CONTACT); not found in other modes: what is felt
        of nobody is no force.
    mode : 1, an `InteractionMode`.
    system_status : 1, a `SystemStatus`. What is not finite is a camera lost, a touch felt, or a point not seen.

    Rules, in this order: a lost camera, or a state that is not known, stops the robot, until both have been good for a
    while; a contact that is felt and seen is answered (CONTACT), one that is felt only makes the robot yield; a
    released contact point returns, and so does a robot that has yielded; a robot at rest holds. Every decision takes
    one period.
    """

    def __init__(self, robot: RobotModel, params: ContactMonitorParameters | None = None) -> None:
        super().__init__()
        self._robot, self._params = robot, params or ContactMonitorParameters()
        terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        self._dynamics = DynamicsInput(self, terms)
        self._contact = self.DeclareVectorInputPort("contact", BasicVector(1))
        self._point = self.DeclareAbstractInputPort("contact_point", AbstractValue.Make(ContactPoint()))
        self._camera = self.DeclareVectorInputPort("camera_status", BasicVector(1))
        start = Interaction(InteractionMode.HOLD, ContactPoint(), robot.home, 0)
        self._memory = self.DeclareAbstractState(AbstractValue.Make(_Memory(start)))
        self.DeclareInitializationUnrestrictedUpdateEvent(self._start)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._params.period), update=self._update)
        state, inputs = {self.abstract_state_ticket(self._memory)}, {self.all_input_ports_ticket()}
        decision = declare_cache(self, "interaction", start, self._interaction, state)
        reads = {"interaction": lambda decided: decided, "active_contact": _touched}
        declare_outputs(self, decision.Eval, decision.ticket(), start, reads)
        declare_readouts(self, decision, {"mode": (1, lambda interaction: [float(interaction.mode)])})
        status = declare_cache(self, "status", SystemStatus.OK, self._status, inputs)
        declare_readouts(self, status, {"system_status": (1, lambda status: [float(status)])})

    def _interaction(self, context: Context) -> Interaction:
        return context.get_abstract_state(int(self._memory)).get_value().interaction

    def _status(self, context: Context) -> SystemStatus:
        if not self._dynamics.Eval(context).finite:
            return SystemStatus.BAD_INPUT
        seen = self._point.Eval(context)
        if seen.found and not seen.usable(self._robot.n):
            return SystemStatus.BAD_INPUT
        return status_of(self._contact.Eval(context), self._camera.Eval(context), seen.p_LC)

    def _start(self, context: Context, state: State) -> None:
        terms, start = self._dynamics.Eval(context), self._interaction(context)
        known = terms.finite
        start = replace(start, q_latched=terms.q) if known else self._enter(InteractionMode.STOP, start, terms)
        state.get_mutable_abstract_state(int(self._memory)).set_value(_Memory(start))

    def _update(self, context: Context, state: State) -> None:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        terms, seen = self._dynamics.Eval(context), self._point.Eval(context)
        if not seen.usable(self._robot.n):
            seen = ContactPoint()
        # A touch that is not a number is no proof that nobody touches; a camera's status that is none is no camera.
        touched = not self._contact.Eval(context)[0] <= 0.5
        works = terms.finite and self._camera.Eval(context)[0] in _CAMERA_WORKS
        memory = self._with_clocks(memory, terms, touched, works, seen)
        interaction = self._decide(memory, terms, touched, works, seen)
        in_mode = memory.in_mode if interaction.mode == memory.interaction.mode else 0.0
        state.get_mutable_abstract_state(int(self._memory)).set_value(
            replace(memory, interaction=interaction, in_mode=in_mode)
        )

    def _with_clocks(
        self, memory: _Memory, terms: DynamicsTerms, touched: bool, works: bool, seen: ContactPoint
    ) -> _Memory:
        period, params, now = self._params.period, self._params, memory.interaction
        near = now.mode == InteractionMode.RETURN and self._latched_error(now, terms) < params.position_tolerance
        slow = float(np.max(np.abs(terms.v))) < params.velocity_tolerance
        left = now.mode == InteractionMode.YIELD and not touched
        return replace(
            memory,
            in_mode=memory.in_mode + period,
            settled=memory.settled + period if (near or left) and slow else 0.0,
            left=memory.left + period if left else 0.0,
            unseen=0.0 if seen.found else memory.unseen + period,
            works=memory.works + period if works else 0.0,
        )

    def _latched_error(self, now: Interaction, terms: DynamicsTerms) -> float:
        link, p_LC = now.contact.link, now.contact.p_LC
        p_desired = self._robot.kinematics(now.q_latched).position(link, p_LC)
        return float(np.linalg.norm(p_desired - terms.position(link, p_LC)))

    def _decide(
        self, memory: _Memory, terms: DynamicsTerms, touched: bool, works: bool, seen: ContactPoint
    ) -> Interaction:
        now, params = memory.interaction, self._params
        if not works or (now.mode == InteractionMode.STOP and memory.works < params.camera_recovery_time):
            return self._enter(InteractionMode.STOP, now, terms)
        if touched and seen.found:
            return self._answer(memory, terms, seen)
        if touched:  # felt, not seen: keep answering where the contact was, or yield
            known = now.mode == InteractionMode.CONTACT and memory.unseen < params.unseen_time
            return now if known else self._enter(InteractionMode.YIELD, now, terms)
        if now.mode == InteractionMode.CONTACT:
            return replace(now, mode=InteractionMode.RETURN)
        returned = memory.settled >= params.settle_time or memory.in_mode >= params.return_timeout
        if now.mode == InteractionMode.RETURN and not returned:
            return now
        if now.mode == InteractionMode.YIELD:  # to where it was felt, softly; held there at last
            over = memory.settled >= params.settle_time or memory.left >= params.return_timeout
            return replace(now, mode=InteractionMode.HOLD) if over else now
        return self._enter(InteractionMode.HOLD, now, terms)

    def _answer(self, memory: _Memory, terms: DynamicsTerms, seen: ContactPoint) -> Interaction:
        now, params = memory.interaction, self._params
        if now.mode in (InteractionMode.CONTACT, InteractionMode.RETURN):
            moved = _world(terms, seen) - _world(terms, now.contact)
            if np.linalg.norm(moved) < params.new_contact_distance:
                return replace(now, mode=InteractionMode.CONTACT, contact=seen)
        # A touch that has not ended began where it was felt, wherever it is seen now.
        began = now.mode in (InteractionMode.YIELD, InteractionMode.CONTACT)
        return Interaction(InteractionMode.CONTACT, seen, now.q_latched if began else terms.q, now.onset + 1)

    def _enter(self, mode: InteractionMode, now: Interaction, terms: DynamicsTerms) -> Interaction:
        if now.mode == mode:
            return now
        q = terms.q if terms.finite else now.q_latched
        return Interaction(mode, ContactPoint(), q, now.onset + 1)


def _world(terms: DynamicsTerms, contact: ContactPoint) -> Array:
    return terms.position(contact.link, contact.p_LC)


def _touched(decided: Interaction) -> ContactPoint:
    return decided.contact if decided.mode == InteractionMode.CONTACT else ContactPoint()
