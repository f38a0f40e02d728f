"""The predictive controller as a Drake system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from saphari_drake.control.nmpc.kinematics import joint_velocity, ramped
from saphari_drake.control.nmpc.law import NmpcMemory, at_rest, nmpc_step
from saphari_drake.control.nmpc.parameters import NmpcParameters, NmpcReference, TestPoint
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle

Array = NDArray[np.float64]


class NmpcController(LeafSystem):
    """Joint velocities that make an end effector follow a reference and keep the robot clear of obstacles.

    .. pydrake_system::

        name: NmpcController
        input_ports:
        - position_measured
        - reference
        - obstacles
        output_ports:
        - velocity_commanded
        - predicted_motion
        - status
        - slack
        - min_clearance
        - base_twist

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    reference : abstract `NmpcReference`. Without it the end effector keeps the pose of the robot's home posture.
    obstacles : abstract `ObstaclePoints`, optional; without it there are none.
    velocity_commanded : n (rad/s or m/s), within the limits. It is held over a period, but for a platform that cannot
        slip, whose x and y turn with the measured θ, so that its command never points sideways, and but for a `ramp`
        at the beginning of the period.
    predicted_motion : (N + 1) n (rad or m), positions at the stages 0 … N, one stage after the other.
    status : 1, `NmpcStatus`.
    slack : 1 (m), largest violation of a minimum distance that the prediction had to accept.
    min_clearance : 1 (m), smallest distance beyond the minimum ones in the period that begins, as predicted.
    base_twist : 2 (m/s, rad/s), forward speed and turning rate. Only for a platform that cannot slip.

    Each period `law.nmpc_step` solves its problem and applies the velocity of the first stage, or brakes. State: its
    `NmpcMemory`, whose predicted motion is the next guess.
    """

    def __init__(
        self,
        robot: RobotModel,
        end_effector: str,
        test_points: Sequence[TestPoint],
        params: NmpcParameters | None = None,
        X_FE: RigidTransform | None = None,
    ) -> None:
        super().__init__()
        self.problem = problem = NmpcProblem(robot, end_effector, test_points, params, X_FE)
        R_home, p_home = problem.end_effector_pose(robot.home)
        self._home = NmpcReference(p_home[None].copy(), R_home[None].copy())
        self._none = ObstaclePoints()
        self._position = self.DeclareVectorInputPort("position_measured", BasicVector(robot.n))
        self._reference = self.DeclareAbstractInputPort("reference", AbstractValue.Make(self._home))
        self._obstacles = self.DeclareAbstractInputPort("obstacles", AbstractValue.Make(self._none))
        memory = at_rest(problem, robot.home)
        # One step here compiles the kernels before the first control step.
        far = ObstaclePoints(np.full((1, 3), 1e3), np.zeros((1, 3)), np.zeros(1), 0.0)
        nmpc_step(problem, memory, robot.home, self._home, far, 0.0)
        self._memory = self.DeclareAbstractState(AbstractValue.Make(memory))
        ticket = self.abstract_state_ticket(self._memory)
        prerequisites = {ticket, self._position.ticket()} if problem.params.nonholonomic else {ticket}
        if problem.params.ramp > 0.0:
            prerequisites.add(self.time_ticket())
        self.DeclareVectorOutputPort(
            "velocity_commanded", BasicVector(robot.n), self._calc_velocity, prerequisites_of_calc=prerequisites
        )
        readouts = {
            "predicted_motion": ((problem.N + 1) * robot.n, lambda m: m.motion.ravel()),
            "status": (1, lambda m: [float(m.status)]),
            "slack": (1, lambda m: [m.slack]),
            "min_clearance": (1, lambda m: [m.clearance]),
        }
        if problem.params.nonholonomic:
            x, _, theta = problem.data.base
            readouts["base_twist"] = (2, lambda m: m.command[[x, theta]])
        for name, (size, read) in readouts.items():
            self.DeclareVectorOutputPort(
                name,
                BasicVector(size),
                lambda context, output, read=read: output.SetFromVector(read(self._state(context))),
                prerequisites_of_calc={ticket},
            )
        self.DeclareInitializationUnrestrictedUpdateEvent(self._update)
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(problem.params.period), update=self._update)

    def _state(self, context: Context) -> NmpcMemory:
        return context.get_abstract_state(int(self._memory)).get_value()

    def _command(self, context: Context) -> Array:
        """Return the command (n,) at this time; see `kinematics.advance`."""
        memory, params = self._state(context), self.problem.params
        now = ramped(memory.before, memory.command, params.ramp * params.period, context.get_time() - memory.since)
        return np.array(now)

    def _calc_velocity(self, context: Context, output: BasicVector) -> None:
        data, command = self.problem.data, self._command(context)
        if not len(data.base):
            output.SetFromVector(np.clip(command, -data.v_max, data.v_max))
            return
        q = np.array(self._position.Eval(context))
        output.SetFromVector(joint_velocity(data, q, command) if np.all(np.isfinite(q)) else 0.0 * command)

    def _update(self, context: Context, state: State) -> EventStatus:
        q = np.array(self._position.Eval(context))
        reference = self._reference.Eval(context) if self._reference.HasValue(context) else self._home
        obstacles, age = self._none, 0.0
        if self._obstacles.HasValue(context):
            obstacles = self._obstacles.Eval(context)
            age = obstacles.age(context.get_time())
        memory = nmpc_step(self.problem, self._state(context), q, reference, obstacles, age)
        memory = replace(memory, since=context.get_time())
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
        return EventStatus.Succeeded()
