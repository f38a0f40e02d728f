"""Guiding by hand at the end effector and, through a sensitive skin, at the body, eq. (47)–(50)."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.control.hand_guiding.law import GuidingOutput, GuidingState, HandGuiding
from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.control.hand_guiding.stability import check_hand
from saphari_drake.control.hand_guiding.touch import GuidingStatus, HandForces
from saphari_drake.messages import SkinReading, SkinStatus, SystemStatus
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


class HandGuidingController(LeafSystem):
    """Lets one or two hands lead the robot, the point that was touched first with priority.

    .. pydrake_system::

        name: HandGuidingController
        input_ports:
        - dynamics
        - skin
        - wrench_measured
        output_ports:
        - torque_commanded
        - acceleration_commanded
        - position_commanded
        - velocity_commanded
        - force
        - point_position
        - velocity_desired
        - acceleration_desired
        - rank
        - unreachable_force
        - unreachable_direction
        - priority
        - status
        - system_status

    Ports
    -----
    dynamics : abstract `DynamicsTerms`, of the measured state.
    skin : abstract `SkinReading`; optional: the end effector alone is guided.
    wrench_measured : 6 (Nm, N), moment and force of the person on the robot at the tip, world axes; NaN: not known.
    torque_commanded : n (Nm or N), for an arm that takes torques; NaN while the joint state is not known.
    acceleration_commanded : n (rad/s² or m/s²), q̈_c.
    position_commanded, velocity_commanded : n, q_c and q̇_c at the end of the cycle, for an arm that takes positions.
    force : 6 (N), F_e and F_b as measured, world; zero while not known.
    point_position : 6 (m), p_e and p_b, world; zero for a point that nobody touches, as all that follow.
    velocity_desired, acceleration_desired : 6 (m/s, m/s²), ṗ_{c,d} of (48) and ẍ_{c,d} of (50), of e and b.
    rank : 2, number of directions in which e and b can move, the second point without disturbing the first.
    unreachable_force : 2 (N), size of the force on e and b in the other directions, where it has no effect.
    unreachable_direction : 6, unit vectors in which e and b move the least; zero at full rank.
    priority : 1, a `GuidingPriority`.
    status : 1, a `GuidingStatus`.
    system_status : 1, a `SystemStatus`: BAD_INPUT while a force or the joint state is not known.

    Nothing of a touch is remembered when it ends. A point starts from its own position and velocity at every touch and
    every change of the main point; steps of q̈_c are faded out over `fade_time`.

    What comes to rest does so in the law, along the commanded motion, for arms that take positions have no other: while
    nobody touches, the motion dies out and the posture is kept; a force that is lost, too old or not finite brakes the
    arm, and guiding goes on after all hands have been taken off. A joint state that is not finite leaves an arm that
    takes torques to whoever comes after, and guiding starts again, at rest, where the arm is then; with
    `feedback` = "commanded" it brakes as for a lost force. Nothing is saturated here.
    """

    def __init__(self, robot: RobotModel, params: HandGuidingParameters | None = None) -> None:
        super().__init__()
        self._guiding = HandGuiding(robot, params or HandGuidingParameters())
        if self._guiding.params.hand_stiffness > 0.0:
            check_hand(robot, self._guiding.params, *self._guiding.tip)
        n, terms = robot.n, evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        start = replace(self._guiding.start(terms), q_start=np.full(n, np.nan), fresh=True)
        first = self._guiding.step(start, terms, sense(terms, SkinReading(), np.zeros(6), self._guiding.tip))
        self._dynamics = DynamicsInput(self, terms)
        self._skin = self.DeclareAbstractInputPort("skin", AbstractValue.Make(SkinReading()))
        self._wrench = self.DeclareVectorInputPort("wrench_measured", BasicVector(6))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(start))
        tickets = {port.ticket() for port in (self._dynamics, self._skin, self._wrench)}
        tickets.add(self.abstract_state_ticket(self._memory))
        self._cycle = declare_cache(self, "cycle", first, self._evaluate, tickets)

        def read(name: str) -> Any:
            return lambda result: np.ravel(getattr(result[1], name)).astype(float)

        readouts = {f"{name}_commanded": (n, read(name)) for name in ("torque", "acceleration", "position", "velocity")}
        sizes = {"force": 6, "point_position": 6, "velocity_desired": 6, "acceleration_desired": 6, "rank": 2}
        sizes |= {"unreachable_force": 2, "unreachable_direction": 6, "priority": 1, "status": 1}
        readouts |= {name: (size, read(name)) for name, size in sizes.items()}
        readouts["system_status"] = (1, _system_status)
        declare_readouts(self, self._cycle, readouts)
        period = self._guiding.params.period
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def _evaluate(self, context: Context) -> tuple[GuidingState, GuidingOutput]:
        state: GuidingState = context.get_abstract_state(int(self._memory)).get_value()
        terms: DynamicsTerms = self._dynamics.Eval(context)
        reading, fresh = SkinReading(), True
        if self._skin.HasValue(context):
            reading = self._skin.Eval(context)
            fresh = state.now - max(reading.stamp, 0.0) <= self._guiding.params.timeout
        hands = sense(terms, reading, np.array(self._wrench.Eval(context)), self._guiding.tip, fresh)
        return self._guiding.step(state, terms, hands)

    def _update(self, context: Context, state: State) -> None:
        following, _ = self._cycle.Eval(context)
        state.get_mutable_abstract_state(int(self._memory)).set_value(following)


def _system_status(result: tuple[GuidingState, GuidingOutput]) -> list[float]:
    lost = result[1].status == GuidingStatus.SENSOR_LOST
    return [float(SystemStatus.BAD_INPUT if lost else SystemStatus.OK)]


def sense(
    terms: DynamicsTerms, reading: SkinReading, wrench: Array, tip: tuple[int, Array], fresh: bool = True
) -> HandForces:
    """Return the forces of the hands on both points; not known, and zero, if a sensor does not know its own.

    Contacts on the link of the strongest one act together, at their force-weighted centroid. The moment at the wrist is
    not used, as in (47): about the last joint the sensor feels the whole inertia that it turns, and a torque that
    answered it would answer itself.

    Parameters
    ----------
    terms : DynamicsTerms
    reading : SkinReading
    wrench : (6,) array
        Moment (Nm) and force (N) of the person on the robot at the tip, world axes.
    tip : (int, (3,) array)
        The guided point of the end effector: link, and position in it (m).
    fresh : bool
        Whether the reading is young enough.
    """
    n, contacts, force, point, weight = len(terms.q), reading.contacts, np.zeros((2, 3)), np.zeros(3), 0.0
    known = fresh and reading.status != SkinStatus.LOST and terms.finite and np.isfinite(wrench).all()
    if not (known and all(contact.usable(n) for contact in contacts)):
        return HandForces(force, np.zeros(n), -1, point, False)
    force[0] = wrench[3:]
    torque = terms.point(*tip).Jv_WC.T @ force[0]
    for contact in contacts:
        f_W = terms.R_WL[contact.link] @ contact.f_L
        torque += terms.point(contact.link, contact.p_LC).Jv_WC.T @ f_W
        if contact.link == contacts[0].link:
            size = np.sqrt(f_W @ f_W)
            force[1] += f_W
            point += size * contact.p_LC
            weight += size
    if weight == 0.0:
        return HandForces(force, torque, -1, point, True)
    return HandForces(force, torque, contacts[0].link, point / weight, True)
