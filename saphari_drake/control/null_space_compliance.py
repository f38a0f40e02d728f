"""Control of a main task whose body yields in the null space, Section 5, eq. (33)–(46)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, State

from saphari_drake.control.null_space_laws import (
    TaskGains,
    gamma_bound,
    null_space_torque,
    require_gamma,
    task_error,
    task_force,
)
from saphari_drake.control.null_space_parameters import TASKS, NullSpaceComplianceParameters
from saphari_drake.control.torque_limits import limit_torque
from saphari_drake.errors import ParameterError, StateError
from saphari_drake.leaf import cycle, declare_cache, declare_readouts
from saphari_drake.math.null_space import TaskSpace, task_space
from saphari_drake.math.tree_matrices import coriolis_matrix, frame_jacobian
from saphari_drake.parameters import diagonal
from saphari_drake.port_values import Immutable
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


class NullSpaceTorque(NamedTuple):
    """Named parts (n,) of the torque command (Nm); their sum is the command before limits."""

    task: Array
    compensation: Array
    null_space: Array
    coriolis: Array
    gravity: Array


@dataclass(frozen=True)
class _Memory(Immutable):
    X_WE: RigidTransform | None = None  # pose to hold without a desired one, latched in the first cycle
    yielding: float = 0.0


class _Output(NamedTuple):
    terms: NullSpaceTorque
    torque: Array
    excess: Array
    error: Array
    drive: Array
    above: float  # external torque over the threshold, in bands
    X_WE: RigidTransform


class NullSpaceComplianceController(LeafSystem):
    """Keeps a point or pose on its target while the body gives way to a touch.

    .. pydrake_system::

        name: NullSpaceComplianceController
        input_ports:
        - dynamics
        - torque_estimated
        - residual
        - desired_pose
        - desired_velocity
        - desired_acceleration
        - nominal_posture
        output_ports:
        - torque_commanded
        - torque_excess
        - torque_terms
        - task_error
        - observer_drive
        - yielding

    Ports
    -----
    dynamics : abstract `DynamicsTerms`.
    torque_estimated : n (Nm), τ̂ from `DisturbanceObserver`; needed with task_error and task_error_pd.
    residual : n (Nm), from `MomentumObserver`; needed with momentum. With the other observers optional, for the
        threshold alone, which otherwise sees τ̂, and nothing at all with the observer none.
    desired_pose : abstract `RigidTransform` in the world, optional; default: the pose at the start.
    desired_velocity, desired_acceleration : 6 ([ω; v] in the world, and its derivative), optional; default: zero.
    nominal_posture : n (rad or m), optional; the posture that the body tends to, default: the robot's home.
    torque_commanded : n (Nm), within the robot's limits.
    torque_excess : n (Nm), what the limits cut off.
    torque_terms : 5n (Nm), the parts of `NullSpaceTorque` one after the other.
    task_error : m ([rad and] m), desired minus actual, in the world.
    observer_drive : n, what `DisturbanceObserver` integrates; zero while torque is cut off or the task yields.
    yielding : 1, from 0 (the task is kept) to 1 (it yields: damping alone, no compensation).

    Law: τ = Jᵀ F + P_cᵀ(…) + C q̇ + g with F from `task_force` and the null space from `null_space_torque`.
    Above `torque_threshold` F turns smoothly into damping, so that the whole arm yields, and back below it.
    Stability (Propositions 1 to 3) holds for a constant external torque below the threshold, no torque cut off, and
    postures away from singularities of the task, near which it gives way instead of asking for large torque.
    """

    def __init__(self, robot: RobotModel, params: NullSpaceComplianceParameters | None = None) -> None:
        super().__init__()
        self._robot, self._params = robot, params or NullSpaceComplianceParameters()
        p, n = self._params, robot.n
        self.m = TASKS[p.task]
        if not n > self.m:
            raise ParameterError("task", f"{p.task} leaves no null space on {robot.name}, which has {n} joints")
        self._read(p)
        terms = evaluate_dynamics(robot, robot.home, np.zeros(n))
        if p.observer == "task_error_pd":
            require_gamma(p.gamma, self._gamma_bound())
        self._dynamics = self.DeclareAbstractInputPort("dynamics", AbstractValue.Make(terms))
        self._estimated = self.DeclareVectorInputPort("torque_estimated", BasicVector(n))
        self._residual = self.DeclareVectorInputPort("residual", BasicVector(n))
        self._pose = self.DeclareAbstractInputPort("desired_pose", AbstractValue.Make(RigidTransform()))
        self._velocity = self.DeclareVectorInputPort("desired_velocity", BasicVector(6))
        self._acceleration = self.DeclareVectorInputPort("desired_acceleration", BasicVector(6))
        self._posture = self.DeclareVectorInputPort("nominal_posture", BasicVector(n))
        self._memory = self.DeclareAbstractState(AbstractValue.Make(_Memory()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(p.period), update=self._update)
        zero = np.zeros(n)
        start = _Output(NullSpaceTorque(*[zero] * 5), zero, zero, np.zeros(self.m), zero, 0.0, RigidTransform())
        ports = (
            self._dynamics, self._estimated, self._residual, self._pose, self._velocity, self._acceleration,
            self._posture,
        )  # fmt: skip
        tickets = {port.ticket() for port in ports} | {self.abstract_state_ticket(self._memory)}
        self._output = declare_cache(self, "torque", start, self._evaluate, tickets)
        readouts = {
            "torque_commanded": (n, lambda o: o.torque),
            "torque_excess": (n, lambda o: o.excess),
            "torque_terms": (len(NullSpaceTorque._fields) * n, lambda o: np.concatenate(o.terms)),
            "task_error": (self.m, lambda o: o.error),
            "observer_drive": (n, lambda o: o.drive),
        }
        declare_readouts(self, self._output, readouts)
        self.DeclareVectorOutputPort(
            "yielding",
            BasicVector(1),
            lambda context, output: output.SetFromVector([self._remembered(context).yielding]),
            {self.abstract_state_ticket(self._memory)},
        )

    def _read(self, p: NullSpaceComplianceParameters) -> None:
        def gain(linear, angular, name: str) -> Array:
            values = diagonal(linear, 3, name)
            return values if self.m == 3 else np.concatenate([diagonal(angular, 3, f"{name}_rotation"), values])

        self.gains = TaskGains(
            gain(p.P, p.P, "P"),
            gain(p.K, p.K_rotation, "K"),
            gain(p.D, p.D_rotation, "D"),
            gain(p.K_x, p.K_x_rotation, "K_x"),
            p.gamma,
            gain(p.K_v, p.K_v, "K_v"),
            gain(p.K_p, p.K_p, "K_p"),
            gain(1.0, p.rotation_length, "scale"),
            p.period,
        )
        self._fade = float(np.exp(-p.period / p.yield_time))
        self._max_mass = gain(p.max_effective_mass, p.max_effective_inertia, "max_effective_mass")
        self._stiffness = diagonal(p.null_stiffness, self._robot.n, "null_stiffness")
        self._damping = diagonal(p.null_damping, self._robot.n, "null_damping")
        self._link, X_LE = self._robot.frame(p.frame or self._robot.link_names[-1])
        if self._link < 0:
            raise ParameterError("frame", f"'{p.frame}' does not move")
        self._R_LE, self._p_LE = X_LE.rotation().matrix(), np.array(X_LE.translation())

    def kinematics(self, terms: DynamicsTerms) -> tuple[TaskSpace, Array, Array, Array]:
        """Return task space, rotation (3, 3), position (3,) and velocity [ω; v] (6,) of the frame at a state."""
        t, link = self._robot.tree, self._link
        J, Jdot = frame_jacobian(t.parent, terms.S, terms.V, terms.R_WL, terms.p_WL, link, self._p_LE)
        C = coriolis_matrix(t.parent, t.mass, t.com, t.inertia, terms.R_WL, terms.p_WL, terms.S, terms.V)
        rows = slice(6 - self.m, 6)
        task = task_space(J[rows], Jdot[rows], terms.M, C, terms.v, self._max_mass)
        R_WL = terms.R_WL[link]
        return task, R_WL @ self._R_LE, terms.p_WL[link] + R_WL @ self._p_LE, J @ terms.v

    def _gamma_bound(self, samples: int = 40) -> float:
        """Evaluate the bound of γ on postures around home, in metres, and μ_x for motions along each task direction."""
        robot, coriolis, inertia, scale = self._robot, 0.0, [], self.gains.scale
        unit = np.outer(scale, scale)
        for offset in np.random.default_rng(0).uniform(-1.0, 1.0, (samples, robot.n)) * self._params.gamma_region:
            q = np.clip(robot.home + offset, robot.q_min, robot.q_max)
            rest = self.kinematics(evaluate_dynamics(robot, q, np.zeros(robot.n)))[0]
            inertia.append(rest.Lambda / unit)
            for k in range(self.m):
                moving = self.kinematics(evaluate_dynamics(robot, q, rest.J_inv[:, k] / scale[k]))[0]
                mu = np.column_stack([moving.coriolis(w) for w in np.eye(self.m)])
                coriolis = max(coriolis, float(np.linalg.norm(mu / unit, 2)))
        return gamma_bound(np.array(inertia), self.gains.K_x / scale**2, self.gains.D / scale**2, coriolis)

    def _remembered(self, context: Context) -> _Memory:
        memory: _Memory = context.get_abstract_state(int(self._memory)).get_value()
        return memory

    def _estimates(self, context: Context) -> tuple[Array, Array]:
        """Return τ̂ for the task, and what is known of the external torque for the threshold (n,)."""
        observer, zero = self._params.observer, np.zeros(self._robot.n)
        seen = -self._residual.Eval(context) if self._residual.HasValue(context) else None
        if observer == "momentum":
            if seen is None:
                raise StateError("residual: not connected, but the observer 'momentum' needs it")
            return seen, seen
        if observer == "none":
            return zero, zero if seen is None else seen
        if not self._estimated.HasValue(context):
            raise StateError(f"torque_estimated: not connected, but the observer '{observer}' needs it")
        estimate = self._estimated.Eval(context)
        return estimate, estimate if seen is None else seen

    def _evaluate(self, context: Context) -> _Output:
        p, robot, memory = self._params, self._robot, self._remembered(context)
        terms: DynamicsTerms = self._dynamics.Eval(context)
        task, R, p_WE, V = self.kinematics(terms)
        X_WE = memory.X_WE or RigidTransform(RotationMatrix(R), p_WE)
        desired = self._pose.Eval(context) if self._pose.HasValue(context) else X_WE
        V_d, A_d = (_value(port, context, np.zeros(6)) for port in (self._velocity, self._acceleration))
        e = task_error(R, p_WE, V, desired.rotation().matrix(), desired.translation(), V_d, A_d, self.m)
        estimate, external = self._estimates(context)
        force = task_force(p.observer, task, e, estimate, terms.v, self.gains)
        keep = 1.0 - memory.yielding
        loose = -task.Lambda @ (task.Jdot @ terms.v + p.yield_damping * V[-self.m :])
        parts = NullSpaceTorque(
            task.J.T @ (keep * force.task + memory.yielding * loose),
            task.J.T @ (keep * force.compensation),
            null_space_torque(
                task, _value(self._posture, context, robot.home) - terms.q, terms.M, self._stiffness, self._damping,
                p.period,
            ),
            terms.Cv,
            terms.g,
        )  # fmt: skip
        torque, excess = limit_torque(np.sum(parts, axis=0), robot.tau_max)
        idle = memory.yielding > 0.0 or bool(np.any(excess != 0.0))
        drive = np.zeros(robot.n) if idle else force.drive
        above = (float(np.max(np.abs(external))) - p.torque_threshold) / p.threshold_band
        return _Output(parts, torque, excess, e.error, drive, above, X_WE)

    def _update(self, context: Context, state: State) -> None:
        now: _Output = self._output.Eval(context)
        a = float(np.clip(now.above, 0.0, 1.0))
        target = a * a * (3.0 - 2.0 * a)
        yielding = target + (self._remembered(context).yielding - target) * self._fade
        memory = _Memory(now.X_WE, 0.0 if target == 0.0 and yielding < 1e-3 else yielding)
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)


def _value(port: InputPort, context: Context, default: Array) -> Array:
    return port.Eval(context) if port.HasValue(context) else default
