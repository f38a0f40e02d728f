"""Redundancy resolution in reverse priority with hard and soft unilateral constraints, eq. (23)–(32)."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from saphari_drake.control.reverse_priority.scaling import Change
from saphari_drake.control.reverse_priority.stack import REFERENCE_SIZE, PriorityStack, StackResult, evaluate_component
from saphari_drake.control.reverse_priority.tasks import FrameTask, Kind, Level
from saphari_drake.errors import ParameterError
from saphari_drake.math.tree_matrices import world_point
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle, declare_cache, declare_readouts

Array = NDArray[np.float64]


@dataclass
class ReversePriorityParameters:
    """Numbers of the method; A unless marked."""

    # s; the control cycle.
    period: float = 0.005
    # rad/s² or m/s², largest acceleration of the command, one value or one a joint; infinite: any, as published.
    acceleration_max: list[float] = field(default_factory=lambda: [np.inf])
    # 0 … 1, share of the command before that is kept where no task decides, eq. (27); "equal or close to 1".
    decay: float = 0.95
    # λ_s, in the unit of the task Jacobians: a singular value well below it is damped.
    damping: float = 0.1
    # μ, strength of that damping.
    task_damping: float = 1.0

    def __post_init__(self) -> None:
        require_positive(self, "period", "damping", "task_damping")
        require_non_negative(self, "decay")
        if not np.all(np.asarray(self.acceleration_max, dtype=float) > 0.0):
            raise ParameterError("acceleration_max", f"must be positive, got {self.acceleration_max}")
        if self.decay > 1.0:
            raise ParameterError("decay", f"must not exceed 1, got {self.decay}")


def frame_reference(X_WF: RigidTransform, V_WF: Sequence[float] | Array = (0.0,) * 6) -> Array:
    """Return the reference (18,) of a `FrameTask`: desired pose, and spatial velocity [ω; v], in the world."""
    return np.concatenate([X_WF.rotation().matrix().ravel(), X_WF.translation(), np.asarray(V_WF, dtype=float)])


def position_reference(p: Sequence[float] | Array, v: Sequence[float] | Array = (0.0,) * 3) -> Array:
    """Return the reference (18,) of a `FrameTask` without orientation: desired position (m) and velocity (m/s)."""
    return np.concatenate([np.eye(3).ravel(), np.asarray(p, dtype=float), np.zeros(3), np.asarray(v, dtype=float)])


def scalar_reference(value: float, rate: float = 0.0) -> Array:
    """Return the reference (18,) of a `ScalarTask`: desired value and velocity, in the unit of its component."""
    return np.concatenate([[value, rate], np.zeros(REFERENCE_SIZE - 2)])


class ReversePriorityController(LeafSystem):
    """Joint velocities for a stack of tasks and unilateral constraints.

    .. pydrake_system::

        name: ReversePriorityController
        input_ports:
        - position_measured
        - references
        - targets
        output_ports:
        - velocity_commanded
        - activation
        - task_error
        - smallest_singular_value
        - constraint_excess
        - task_scale
        - status

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    references : 18 a task, in the order of the stack; see `frame_reference`, `position_reference`, `scalar_reference`.
        Without it, every task keeps what it has at the home posture.
    targets : 6 a target (m, m/s, world), position and velocity. Only if the stack refers to any.
    velocity_commanded : n (rad/s or m/s), within velocity limits and, but for status INVALID, acceleration limits.
    activation : h of each constraint, in the order of ``stack.sides``; 1 number, 0, if there is none.
    task_error : reference minus value of each task row (m, rad, or the unit of the component).
    smallest_singular_value : of each task's Jacobian.
    constraint_excess : x − x̄ of each constraint; positive beyond the bound. 1 number, 0, if there is none.
    task_scale : 1, factor on what the tasks asked for, below 1 while the velocity limits need that.
    status : 1, a `PriorityStatus`. LATE, while the acceleration limits hold back more than the tasks: hard constraints
        hold as far as their buffers leave room to slow down, see `scaling`. INVALID, while an input is not finite: no
        motion, and NaN for what is not known.

    From the lowest level up, each adds the step of (24) in its regularised form; the velocity below all of them is
    λ times the command before, eq. (27), which is the only state. The velocity limits scale what the tasks ask for,
    never single joints, and the hard constraints are put on after that. They hold while status is OK or SCALED; between
    two cycles and with a servo that lags, they hold up to what the arm moves in that time: give the bounds that margin.
    """

    def __init__(
        self, robot: RobotModel, levels: Sequence[Level], params: ReversePriorityParameters | None = None
    ) -> None:
        super().__init__()
        self._params = params or ReversePriorityParameters()
        self.stack = PriorityStack(robot, levels, self._params.damping, self._params.task_damping)
        stack, n = self.stack, robot.n
        limits = np.asarray(self._params.acceleration_max, dtype=float)
        if limits.shape not in ((), (1,), (n,)):
            raise ParameterError("acceleration_max", f"needs 1 or {n} entries, got {limits.size}")
        self._most = np.ascontiguousarray(np.broadcast_to(self._params.period * limits, (n,)))
        self._home = home_references(stack)
        self._position = self.DeclareVectorInputPort("position_measured", BasicVector(n))
        self._references = self.DeclareVectorInputPort("references", BasicVector(max(self._home.size, 1)))
        tickets = {self._position.ticket(), self._references.ticket()}
        self._targets = None
        if stack.num_targets:
            self._targets = self.DeclareVectorInputPort("targets", BasicVector(6 * stack.num_targets))
            tickets.add(self._targets.ticket())
        self._before = self.DeclareDiscreteState(n)
        tickets.add(self.discrete_state_ticket(self._before))
        far = np.full((stack.num_targets, 6), 1e3)
        # Solved here once, which compiles the kernels before the first control step.
        first = stack.solve(robot.home, np.zeros(n), self._home, far, self._params.period)
        self._output = declare_cache(self, "command", first, self._evaluate, tickets)
        count, ends = max(len(stack.sides), 1), np.cumsum([len(task.rows()) for task in stack.tasks], dtype=int)
        declare_readouts(
            self,
            self._output,
            {
                "velocity_commanded": (n, lambda r: r.v),
                "activation": (count, lambda r: _or_zero(r.activation)),
                "task_error": (len(first.error), lambda r: r.error),
                "smallest_singular_value": (len(stack.tasks), lambda r: smallest_singular_values(r.J_tasks, ends)),
                "constraint_excess": (count, lambda r: _or_zero(r.x - stack.bounds)),
                "task_scale": (1, lambda r: [r.scale]),
                "status": (1, lambda r: [float(r.status)]),
            },
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(self._params.period), update=self._update)

    def _evaluate(self, context: Context) -> StackResult:
        stack, references = self.stack, self._home
        if self._references.HasValue(context):
            references = np.array(self._references.Eval(context)).reshape(-1, REFERENCE_SIZE)
        targets = np.zeros((0, 6))
        if self._targets is not None:
            targets = np.array(self._targets.Eval(context)).reshape(-1, 6)
        before = np.array(context.get_discrete_state(self._before).value())
        q, v_start, change = self._position.Eval(context), self._params.decay * before, Change(before, self._most)
        return stack.solve(q, v_start, references, targets, self._params.period, change=change)

    def _update(self, context: Context, state: State) -> None:
        now: StackResult = self._output.Eval(context)
        state.get_mutable_discrete_state(self._before).SetFromVector(now.v)


def home_references(stack: PriorityStack) -> Array:
    """Return the references (tasks, 18) that hold frames, joints and distances to planes as at home; others are 0."""
    home = stack.robot.home
    motion, references = stack.robot.kinematics(home).motion, np.zeros((len(stack.tasks), REFERENCE_SIZE))
    for reference, task in zip(references, stack.tasks):
        if isinstance(task, FrameTask):
            R_WL = motion.R_WL[task.link] if task.link >= 0 else np.eye(3)
            reference[:9] = (R_WL @ np.reshape(task.R_LF, (3, 3))).ravel()
            reference[9:12] = world_point(motion, task.link, np.array(task.p_LC))
        elif task.component.kind in (Kind.JOINT, Kind.PLANE):
            reference[0] = evaluate_component(stack.robot, task.component, home, np.zeros((0, 6)))[0]
    return references


def smallest_singular_values(J: Array, ends: NDArray[np.int64]) -> list[float]:
    """Return the smallest singular value of each task, whose rows end at `ends`; NaN where they are not known."""
    parts = np.split(J, ends)[:-1]
    return [
        float(np.sqrt(max(np.linalg.eigvalsh(part @ part.T)[0], 0.0))) if np.isfinite(part).all() else np.nan
        for part in parts
    ]


def _or_zero(values: Array) -> Array:
    return values if len(values) else np.zeros(1)
