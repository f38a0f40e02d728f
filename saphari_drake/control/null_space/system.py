"""Control of a main task whose body yields in the null space, Section 5, eq. (33)–(46)."""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, State

from saphari_drake.control.null_space.law import (
    Desired,
    Frame,
    FrameState,
    Gains,
    JointState,
    Yielding,
    advance_offset,
    command_terms,
    frame_state,
)
from saphari_drake.control.null_space.parameters import TASKS, NullSpaceComplianceParameters, Observer
from saphari_drake.control.null_space.stability import gamma_bound_around, require_gamma
from saphari_drake.errors import ParameterError, StateError
from saphari_drake.math.task_space import TaskSpace
from saphari_drake.messages import Immutable, SystemStatus, status_of
from saphari_drake.parameters import diagonal
from saphari_drake.robots.dynamics import DynamicsInput, DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]
TERMS = ("task", "compensation", "null_space", "coriolis", "gravity")  # named parts of the torque command


@dataclass(frozen=True)
class _Memory(Immutable):
    X_WD: RigidTransform | None = None  # desired pose of the last cycle, held where none is connected
    yielding: float = 0.0
    offset: Array = field(default_factory=lambda: np.zeros(6))  # of the target from the desired pose (rad, m)
    speed: Array = field(default_factory=lambda: np.zeros(2))  # at which it comes back (rad/s, m/s)


class _Output(NamedTuple):
    terms: Array  # (5, n), by TERMS; their sum is the command
    error: Array
    drive: Array
    above: float  # external torque over the threshold, in bands
    X_WD: RigidTransform | None  # desired pose
    status: SystemStatus = SystemStatus.OK


class NullSpaceComplianceController(LeafSystem):
    """Keeps a point or pose on its target while the body gives way to a touch.

    .. pydrake_system::

        name: NullSpaceComplianceController
        input_ports:
        - dynamics
        - torque_external
        - torque_external_task
        - desired_pose
        - desired_velocity
        - desired_acceleration
        - nominal_posture
        output_ports:
        - torque_commanded
        - torque_terms
        - task_error
        - observer_drive
        - system_status
        - yielding

    Ports
    -----
    dynamics : abstract `DynamicsTerms`.
    torque_external : n (Nm), r from `MomentumObserver`; needed with momentum, and with the others for the threshold,
        unless it is infinite.
    torque_external_task : n (Nm), −τ̂ from `DisturbanceObserver`; needed with task_error and task_error_pd.
    desired_pose : abstract `RigidTransform` in the world, optional; default: the pose at the start.
    desired_velocity, desired_acceleration : 6 ([ω; v] in the world, and its derivative), optional; default: zero.
    nominal_posture : n (rad or m), optional; the posture that the body tends to, default: the robot's home.
    torque_commanded : n (Nm), without limits; NaN while an input is not finite, as terms and error.
    torque_terms : 5n (Nm), the parts named in `TERMS` one after the other.
    task_error : m ([rad and] m), desired minus actual, in the world.
    observer_drive : n, what `DisturbanceObserver` integrates; zero while the task yields or returns.
    system_status : 1, a `SystemStatus`; nothing that is remembered changes while it is BAD_INPUT.
    yielding : 1, from 0 (the task is kept) to 1 (it yields: damping alone, no compensation).

    Law: τ = Jᵀ F + P_cᵀ(…) + C q̇ + g with F from `task_force` and the null space from `null_space_torque`.
    Above `torque_threshold` F turns smoothly into damping, so that the whole arm yields, and back below it; its target
    is then where the frame was pushed, and returns with no more than `return_speed`.
    Stability (Propositions 1 to 3) holds for a constant external torque below the threshold, no torque cut off, and
    postures away from singularities of the task, near which it gives way instead of asking for large torque.
    """

    def __init__(self, robot: RobotModel, params: NullSpaceComplianceParameters | None = None) -> None:
        super().__init__()
        self._robot, self.params = robot, params or NullSpaceComplianceParameters()
        p, n = self.params, robot.n
        self.m, self.observer = TASKS[p.task], Observer[p.observer.upper()]
        if not n > self.m:
            raise ParameterError("task", f"{p.task} leaves no null space on {robot.name}, which has {n} joints")
        self._read(p)
        terms = evaluate_dynamics(robot, robot.home, np.zeros(n))
        self._zero, self._rest = zero, rest = np.zeros(n), np.zeros(6)
        self._command(terms, RigidTransform(), rest, rest, zero, _Memory(), robot.home)  # compiles
        if self.observer == Observer.TASK_ERROR_PD:
            g = self.gains
            require_gamma(p.gamma, gamma_bound_around(robot, self._task_at, g.K_x, g.D, g.scale, p.gamma_region))
        self._dynamics = DynamicsInput(self, terms)
        self._external = self.DeclareVectorInputPort("torque_external", BasicVector(n))
        self._disturbance = self.DeclareVectorInputPort("torque_external_task", BasicVector(n))
        self._pose = self.DeclareAbstractInputPort("desired_pose", AbstractValue.Make(RigidTransform()))
        self._velocity = self.DeclareVectorInputPort("desired_velocity", BasicVector(6))
        self._acceleration = self.DeclareVectorInputPort("desired_acceleration", BasicVector(6))
        self._posture = self.DeclareVectorInputPort("nominal_posture", BasicVector(n))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(_Memory()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(p.period), update=self._update)
        nan = np.full((len(TERMS), n), np.nan)
        self._unknown = _Output(nan, np.full(self.m, np.nan), zero, 0.0, None, SystemStatus.BAD_INPUT)
        state = self.abstract_state_ticket(self._memory)
        self._output = declare_cache(
            self, "torque", self._unknown, self._evaluate, {self.all_input_ports_ticket(), state}
        )
        readouts = {
            "torque_commanded": (n, lambda o: o.terms.sum(axis=0)),
            "torque_terms": (len(TERMS) * n, lambda o: o.terms.ravel()),
            "task_error": (self.m, lambda o: o.error),
            "observer_drive": (n, lambda o: o.drive),
            "system_status": (1, lambda o: [o.status]),
        }
        declare_readouts(self, self._output, readouts)
        yielding = declare_cache(self, "yielding", 0.0, lambda context: self._remembered(context).yielding, {state})
        declare_readouts(self, yielding, {"yielding": (1, lambda share: [share])})

    def _read(self, p: NullSpaceComplianceParameters) -> None:
        def gain(linear, angular, name: str) -> Array:
            values = diagonal(linear, 3, name)
            return values if self.m == 3 else np.concatenate([diagonal(angular, 3, f"{name}_rotation"), values])

        self.gains = Gains(
            int(self.observer),
            gain(p.P, p.P, "P"),
            gain(p.K, p.K_rotation, "K"),
            gain(p.D, p.D_rotation, "D"),
            gain(p.K_x, p.K_x_rotation, "K_x"),
            float(p.gamma),
            gain(p.K_v, p.K_v, "K_v"),
            gain(p.K_p, p.K_p, "K_p"),
            gain(1.0, p.rotation_length, "scale"),
            diagonal(p.null_stiffness, self._robot.n, "null_stiffness"),
            diagonal(p.null_damping, self._robot.n, "null_damping"),
            float(p.yield_damping),
            float(p.period),
        )
        self._return = p.return_turn, p.return_speed
        self._fade = float(np.exp(-p.period / p.yield_time))
        link, X_LE = self._robot.frame(p.frame or self._robot.link_names[-1])
        if link < 0:
            raise ParameterError("frame", f"'{p.frame}' does not move")
        max_mass = gain(p.max_effective_mass, p.max_effective_inertia, "max_effective_mass")
        R_LE = np.array(X_LE.rotation().matrix(), order="C")
        self._frame = Frame(link, R_LE, np.array(X_LE.translation()), max_mass)

    def kinematics(self, terms: DynamicsTerms) -> FrameState:
        """Return pose and velocity of the controlled frame, and its task space, at a state."""
        state: FrameState = frame_state(self._robot.tree, terms.motion, terms.v, terms.M, self._frame)
        return state

    def _task_at(self, q: Array, v: Array) -> TaskSpace:
        return self.kinematics(evaluate_dynamics(self._robot, q, v)).task

    def _pose_of(self, terms: DynamicsTerms) -> RigidTransform:
        state = self.kinematics(terms)
        return RigidTransform(RotationMatrix(state.R), state.p)

    def _command(
        self, d: DynamicsTerms, X: RigidTransform, V: Array, A: Array, estimate: Array, memory: _Memory, q_d: Array
    ) -> tuple[Array, Array, Array]:
        # Arrays from ports are copied: numba compiles anew for other strides and for what is read-only.
        R = np.array(X.rotation().matrix(), order="C")
        desired = Desired(R, np.array(X.translation()), np.array(V), np.array(A), np.array(q_d))
        yielding = Yielding(memory.yielding, memory.offset, memory.speed)
        joints, estimate = JointState(d.q, d.v, d.M, d.Cv + self._robot.viscous * d.v, d.g), np.array(estimate)
        result: tuple[Array, Array, Array] = command_terms(
            self._robot.tree, d.motion, joints, self._frame, desired, yielding, estimate, self.gains
        )
        return result

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _estimates(self, context: Context) -> tuple[Array, Array]:
        """Return τ̂ for the task, and what the residual says of the external torque for the threshold (n,)."""
        name, seen = self.params.observer, self._zero
        if self._external.HasValue(context):
            seen = -self._external.Eval(context)
        elif self.observer == Observer.MOMENTUM:
            raise StateError(f"torque_external: not connected, but the observer '{name}' needs it")
        elif math.isfinite(self.params.torque_threshold):
            raise StateError("torque_external: not connected, but torque_threshold needs it (inf: do without)")
        if self.observer in (Observer.MOMENTUM, Observer.NONE):
            return seen if self.observer == Observer.MOMENTUM else self._zero, seen
        if not self._disturbance.HasValue(context):
            raise StateError(f"torque_external_task: not connected, but the observer '{name}' needs it")
        return -self._disturbance.Eval(context), seen

    def _evaluate(self, context: Context) -> _Output:
        p, memory = self.params, self._remembered(context)
        terms: DynamicsTerms = self._dynamics.Eval(context)
        estimate, external = self._estimates(context)
        V, A = (_value(port, context, self._rest) for port in (self._velocity, self._acceleration))
        q_d, X_WD = _value(self._posture, context, self._robot.home), _value(self._pose, context, memory.X_WD)
        target = self._zero if X_WD is None else X_WD.GetAsMatrix34()
        if not terms.finite or status_of(estimate, external, V, A, q_d, target) != SystemStatus.OK:
            return self._unknown
        X_WD = X_WD or self._pose_of(terms)
        parts, error, drive = self._command(terms, X_WD, V, A, estimate, memory, q_d)
        if memory.yielding > 0.0 or memory.speed.any():
            drive = self._zero
        above = (float(np.abs(external).max()) - p.torque_threshold) / p.threshold_band
        return _Output(parts, error, drive, above, X_WD)

    def _update(self, context: Context, state: State) -> None:
        now: _Output = self._output.Eval(context)
        if now.status != SystemStatus.OK:
            return
        a = min(max(now.above, 0.0), 1.0)
        target = a * a * (3.0 - 2.0 * a)
        before = self._remembered(context)
        yielding = target + (before.yielding - target) * self._fade
        yielding = 0.0 if target == 0.0 and yielding < 1e-3 else yielding
        offset, speed = before.offset.copy(), before.speed.copy()
        for k, limit in enumerate(self._return):
            if k == 0 and self.m == 3:
                continue
            part = slice(3 * k, 3 * k + 3)
            away = -(now.error[part] if self.m == 6 else now.error)
            offset[part], speed[k] = advance_offset(offset[part], speed[k], away, yielding, limit, self.params.period)
        memory = _Memory(now.X_WD, yielding, offset, speed)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)


def _value(port: InputPort, context: Context, default: Any) -> Any:
    return port.Eval(context) if port.HasValue(context) else default
