"""Guiding by hand at the end effector and, through a sensitive skin, at the body, eq. (47)–(50)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.control.hand_guiding.cycle import GuidingOutput, GuidingState, HandGuiding
from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.messages import SkinReading
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
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
        - torque_excess
        - acceleration_commanded
        - position_commanded
        - velocity_commanded
        - priority
        - status
        - force
        - point_position
        - velocity_desired
        - acceleration_desired
        - rank
        - unreachable_force
        - unreachable_direction

    Ports
    -----
    dynamics : abstract `DynamicsTerms`, of the measured state.
    skin : abstract `SkinReading`.
    wrench_measured : 6 (Nm, N), moment and force of the person on the robot at the tip, world axes.
    torque_commanded : n (Nm or N), within the robot's limits, for an arm that takes torques.
    torque_excess : n, what the limits cut off.
    acceleration_commanded : n (rad/s² or m/s²), q̈_c.
    position_commanded, velocity_commanded : n, q_c and q̇_c at the end of the cycle, for an arm that takes positions.
    priority : 1, a `GuidingPriority`.
    status : 1, a `GuidingStatus`.
    force : 6 (N), F_e and F_b as measured, world; zero while not known.
    point_position : 6 (m), p_e and p_b, world; zero for a point that nobody touches, as all that follow.
    velocity_desired, acceleration_desired : 6 (m/s, m/s²), ṗ_{c,d} of (48) and ẍ_{c,d} of (50), of e and b.
    rank : 2, number of directions in which e and b can move, the second point without disturbing the first.
    unreachable_force : 2 (N), size of the force on e and b in the other directions, where it has no effect.
    unreachable_direction : 6, unit vectors in which e and b move the least; zero at full rank.

    Nothing of a touch is remembered when it ends. A point starts from its own position and velocity at every touch and
    every change of the main point; steps of q̈_c are faded out over `fade_time`. While nobody touches, the motion dies
    out and the posture is kept. A reading that is lost, too old or not finite brakes the arm; guiding goes on after all
    hands have been taken off.
    """

    def __init__(self, robot: RobotModel, params: HandGuidingParameters | None = None) -> None:
        super().__init__()
        self._guiding = HandGuiding(robot, params or HandGuidingParameters())
        terms = evaluate_dynamics(robot, robot.home, np.zeros(robot.n))
        start = self._guiding.start(terms, fresh=True)
        first = self._guiding.step(start, terms, SkinReading(), np.zeros(6))
        self._guiding.compile()
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._skin = self.DeclareAbstractInputPort("skin", AbstractValue.Make(SkinReading()))
        self._wrench = self.DeclareVectorInputPort("wrench_measured", BasicVector(6))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(start))
        tickets = {port.ticket() for port in (self._dynamics, self._skin, self._wrench)}
        tickets.add(self.abstract_state_ticket(self._memory))
        self._cycle = declare_cache(self, "cycle", first, self._evaluate, tickets)
        n = robot.n

        def read(name: str) -> Any:
            return lambda result: getattr(result[1], name).ravel()

        sizes = {"torque": n, "torque_excess": n, "acceleration": n, "position": n, "velocity": n, "force": 6}
        sizes |= {"point_position": 6, "velocity_desired": 6, "acceleration_desired": 6, "rank": 2}
        sizes |= {"unreachable_force": 2, "unreachable_direction": 6}
        commanded = ("torque", "acceleration", "position", "velocity")
        readouts = {
            f"{name}_commanded" if name in commanded else name: (size, read(name)) for name, size in sizes.items()
        }
        readouts["priority"] = (1, lambda result: [float(result[1].priority)])
        readouts["status"] = (1, lambda result: [float(result[1].status)])
        declare_readouts(self, self._cycle, readouts)
        period = self._guiding.params.period
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)

    def _evaluate(self, context: Context) -> tuple[GuidingState, GuidingOutput]:
        state: GuidingState = context.get_abstract_state(int(self._memory)).get_value()
        terms: DynamicsTerms = self._dynamics.Eval(context)
        return self._guiding.step(state, terms, self._skin.Eval(context), np.array(self._wrench.Eval(context)))

    def _update(self, context: Context, state: State) -> None:
        following, _ = self._cycle.Eval(context)
        state.get_mutable_abstract_state(int(self._memory)).set_value(following)
