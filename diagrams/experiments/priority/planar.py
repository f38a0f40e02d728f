"""The planar arm of Fig. 4: its stack, its diagram, what is judged, and the same job by Drake's differential IK."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, DiagramBuilder

from experiments.priority.drake_ik import DifferentialIK, median_seconds
from experiments.priority.kinematic_arm import KinematicArm
from experiments.priority.switches import Switch, find_switches
from experiments.priority.waypoints import WaypointPath
from saphari_drake.control.reverse_priority.stack import evaluate_component
from saphari_drake.control.reverse_priority.system import (
    ReversePriorityController,
    ReversePriorityParameters,
    position_reference,
)
from saphari_drake.control.reverse_priority.tasks import Bound, Level, plane_distance, position_task
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.injection import inject
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.world.profile import Truth
from saphari_drake.simulation.world.references import Reference

Array = NDArray[np.float64]
NO_TARGETS = np.zeros((0, 6))


@dataclass
class PlanarParameters:
    """The job of Fig. 4. Points and bounds: the deliverable; the rest: assumed."""

    # m; points in the plane that the end effector goes to, one after the other.
    goals: list[list[float]] = field(default_factory=lambda: [[4.0, 3.0], [2.0, -3.0]])
    # m; hard upper and soft lower bound of y at the end of the fourth link.
    upper: float = 0.5
    lower: float = -0.5
    # m/s, mean speed along the lines, and s, rest at each goal.
    speed: float = 0.5
    dwell: float = 3.0
    # 1/s, on the position error of the end effector.
    gain: float = 10.0
    # m and m/s; buffers β_p and β_v of the activation.
    buffer: float = 0.05
    velocity_buffer: float = 0.1
    controller: ReversePriorityParameters = field(default_factory=ReversePriorityParameters)

    def __post_init__(self) -> None:
        require_positive(self, "speed", "buffer", "velocity_buffer")
        require_non_negative(self, "dwell", "gain")


class PlanarCell(NamedTuple):
    """A diagram and what is needed to run and judge it."""

    robot: RobotModel
    params: PlanarParameters
    path: WaypointPath
    controller: ReversePriorityController
    diagram: Diagram
    recorder: Recorder


def planar_levels(robot: RobotModel, params: PlanarParameters, case: str) -> list[Level]:
    """Return the stack of a case: the upper bound above the task, the lower one below it."""
    y4 = plane_distance(robot, "link_5", [0.0, 1.0, 0.0])
    task = position_task(robot, "tip", "xy", params.gain)
    upper = Bound(y4, upper=params.upper, buffer=params.buffer, velocity_buffer=params.velocity_buffer)
    lower = Bound(y4, lower=params.lower, buffer=params.buffer, velocity_buffer=params.velocity_buffer)
    stacks: dict[str, list[Level]] = {
        "constrained": [[upper], task, [lower]],
        "soft_off": [[upper], task],
        "unconstrained": [task],
    }
    return stacks[case]


def tip_position(robot: RobotModel, q: Array) -> Array:
    """Return the position of the end effector (m)."""
    link, X_LF = robot.frame("tip")
    return robot.kinematics(q).position(link, X_LF.translation())


def build_planar(robot: RobotModel, params: PlanarParameters, case: str, truth: Truth | None = None) -> PlanarCell:
    """Build the diagram: path, controller and an arm that follows exactly."""
    period = params.controller.period
    start = tip_position(robot, robot.home)
    path = WaypointPath([start, *([*goal, start[2]] for goal in params.goals)], params.speed, params.dwell)
    builder = DiagramBuilder()
    controller = builder.AddNamedSystem(
        "controller", ReversePriorityController(robot, planar_levels(robot, params, case), params.controller)
    )
    arm = builder.AddNamedSystem("arm", KinematicArm(robot, period, truth))
    source = builder.AddNamedSystem("path", Reference({"value": lambda t: position_reference(*path(t))}, period))
    builder.Connect(source.GetOutputPort("value"), controller.GetInputPort("references"))
    builder.Connect(controller.GetOutputPort("velocity_commanded"), arm.GetInputPort("velocity_commanded"))
    builder.Connect(arm.GetOutputPort("position_measured"), controller.GetInputPort("position_measured"))
    recorder = Recorder(builder, period)
    recorder.add("position", arm.GetOutputPort("position_measured"), "rad")
    recorder.add("reference", source.GetOutputPort("value"), "m, m/s", lambda r: np.append(r[9:12], r[15:18]))
    recorder.add("velocity", controller.GetOutputPort("velocity_commanded"), "rad/s")
    recorder.add("activation", controller.GetOutputPort("activation"), "1")
    recorder.add("task_error", controller.GetOutputPort("task_error"), "m")
    recorder.add("singular_value", controller.GetOutputPort("smallest_singular_value"), "m")
    recorder.add("task_scale", controller.GetOutputPort("task_scale"), "1")
    recorder.add("status", controller.GetOutputPort("status"), "1")
    inject(builder, robot, truth or Truth(), encoders=arm.GetOutputPort("position_measured"))
    return PlanarCell(robot, params, path, controller, builder.Build(), recorder)


def add_derived(cell: PlanarCell, log: Log) -> None:
    """Add to a log what follows from the positions: y₄, the end effector, and the norm of the task error."""
    y4 = plane_distance(cell.robot, "link_5", [0.0, 1.0, 0.0])
    log.add("y4", [evaluate_component(cell.robot, y4, q, NO_TARGETS.reshape(0, 6))[0] for q in log["position"]], "m")
    log.add("tip", [tip_position(cell.robot, q) for q in log["position"]], "m")
    log.add("task_error_norm", np.linalg.norm(log["task_error"], axis=1), "m")


def planar_switches(cell: PlanarCell, log: Log) -> list[Switch]:
    """Return the entries and releases of the constraints."""
    stack, controller = cell.controller.stack, cell.params.controller
    if not stack.sides:
        return []
    references = np.array([[position_reference(r[:3], r[3:])] for r in log["reference"]])
    before = np.vstack([np.zeros((1, cell.robot.n)), log["velocity"][:-1]])
    targets = np.zeros((len(log.time), 0, 6))
    args = log["position"], controller.decay * before, references, targets, log["activation"]
    return find_switches(stack, *args, controller.period)


def judge_planar(cell: PlanarCell, log: Log, case: str) -> list[Metric]:
    """Return the metrics of a case; bounds for the constrained one, the expected values for the others."""
    p, y4 = cell.params, log["y4"][:, 0]
    errors = goal_errors(cell, log.time, log["tip"])
    jump = np.abs(np.diff(log["activation"], axis=0)).max()
    switches = planar_switches(cell, log)
    inf = np.inf
    high4 = {"constrained": p.upper, "soft_off": p.upper}.get(case, inf)
    goal1 = (0.4982, 0.5022) if case == "constrained" else (-inf, inf)
    metrics = [
        Metric("max_y4", y4.max(), "m", high=high4, reported="never exceeds 0.5" if case != "unconstrained" else "")
    ]
    for i, error in enumerate(errors):
        low, high = goal1 if i == 0 else ((-inf, 0.001) if case == "constrained" else (-inf, inf))
        text = {0: "not reached", 1: "reached"}.get(i, "") if case == "constrained" else ""
        metrics.append(Metric(f"error_goal{i + 1}_m", error, "m", low, high, text))
    metrics += [
        Metric("min_y4", y4.min(), "m", low=-1.01 if case == "constrained" else -inf),
        Metric("max_joint_speed", np.abs(log["velocity"]).max(), "rad/s", high=8.0 if case == "constrained" else inf),
        Metric("activation_jump_max", jump, "1", high=0.5),
        Metric("switch_velocity_step_max", max((s.step for s in switches), default=0.0), "rad/s"),
        Metric("switch_velocity_share_max", max((s.share for s in switches), default=0.0), "1", high=1.0),
        Metric("velocity_step_max", np.abs(np.diff(log["velocity"], axis=0)).max(), "rad/s"),
        Metric("singular_value_min", log["singular_value"].min(), "m"),
        Metric("task_scale_min", log["task_scale"].min(), "1"),
        # The arm has no torques, and moves at each commanded velocity for a whole cycle.
        *limit_metrics(cell.robot, log["velocity"], None),
    ]
    return metrics


def goal_errors(cell: PlanarCell, times: Array, tips: Array) -> list[float]:
    """Return the distance of the end effector to each goal at the end of the rest there; NaN where not reached."""
    errors = []
    for goal, arrival in zip(cell.params.goals, cell.path.arrivals):
        row = int(np.searchsorted(times, arrival + 1e-9, side="right")) - 1
        reached = times[-1] >= arrival - 2.0 * cell.params.controller.period
        errors.append(float(np.linalg.norm(tips[row, :2] - goal)) if reached else float("nan"))
    return errors


def drake_baseline(cell: PlanarCell, log: Log, case: str) -> list[Metric]:
    """Run the same path through Drake's differential IK, upper bound as its constraint, and time both on its states.

    It has no priorities: the soft lower bound cannot be given to it.
    """
    robot, p = cell.robot, cell.params
    period = p.controller.period
    y4 = plane_distance(robot, "link_5", [0.0, 1.0, 0.0])
    ik = DifferentialIK(robot, period, np.array([p.upper if case != "unconstrained" else 1e6]))
    link, X_LF = robot.frame("tip")
    q, v = robot.home.copy(), np.zeros(robot.n)
    count = len(log.time)
    tips, values, velocities = np.empty((count, 3)), np.empty(count), np.empty((count, robot.n))
    unsolved = 0
    for k in range(count):
        point = evaluate_dynamics(robot, q, v).point(link, X_LF.translation())
        x, J_C, _ = evaluate_component(robot, y4, q, NO_TARGETS)
        tips[k], values[k] = point.p_WC, x
        reference = log["reference"][k]
        rate = reference[3:5] + p.gain * (reference[:2] - point.p_WC[:2])
        step = ik.step(q, v, point.Jv_WC[:2], rate, np.array([x]), J_C[None])
        unsolved += not step.solved
        v = step.v
        velocities[k] = v
        q = q + period * v
    errors = goal_errors(cell, log.time, tips)
    stack, references = cell.controller.stack, np.zeros((1, 18))
    own = median_seconds(lambda: stack.solve(robot.home, np.zeros(robot.n), references, NO_TARGETS, period))
    point = evaluate_dynamics(robot, robot.home, 0.0 * v).point(link, X_LF.translation())
    arguments = robot.home, 0.0 * v, point.Jv_WC[:2], np.array([0.1, 0.1]), np.zeros(1), J_C[None]
    other = median_seconds(lambda: ik.step(*arguments))
    return [
        Metric("drake_max_y4", values.max(), "m"),
        *(Metric(f"drake_error_goal{i + 1}_m", error, "m") for i, error in enumerate(errors)),
        Metric("drake_max_joint_speed", np.abs(velocities).max(), "rad/s"),
        Metric("drake_velocity_step_max", np.abs(np.diff(velocities, axis=0)).max(), "rad/s"),
        Metric("drake_unsolved_steps", unsolved, "1"),
        Metric("step_ms_median", 1e3 * own, "ms"),
        Metric("drake_step_ms_median", 1e3 * other, "ms"),
    ]
