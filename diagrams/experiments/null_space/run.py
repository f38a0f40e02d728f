"""What the experiments of Section 5 do alike: build, record, run, compare with a reference run, draw and replay."""

from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.yaml import yaml_dump_typed
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Diagram, DiagramBuilder

from experiments.null_space.cell import NullSpaceCell, NullSpaceCellParameters, add_null_space_cell
from experiments.null_space.motion import StraightMotionParameters, straight_motion
from saphari_drake.errors import ParameterError
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.injection import inject_into
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.record.robot import record_limits, record_robot
from saphari_drake.simulation.runner.limits import limit_metrics
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.runner.results import Metric
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation
from saphari_drake.simulation.view.replay import Arrow, show, write_replay
from saphari_drake.simulation.world.cell import contact_truth

Array = NDArray[np.float64]
CASES = {
    "none": "no observer: task-space PD+ and null-space impedance",
    "task_error": "observer from the task error, Proposition 1",
    "task_error_pd": "PD+ with observer from the task error, Proposition 2",
    "momentum": "observer from the generalized momentum, Proposition 3",
}
RECORD_PERIOD = 0.01  # s


@dataclass
class NullSpaceScenario(PlantScenario):
    """Everything a run depends on; the seed is also of where the obstacle touches and from which direction."""

    case: str = "momentum"
    duration: float = 16.0
    # deg; posture at the start, and rest posture of the body. Empty: the model's own home, as it is with --model.
    home: list[float] = field(default_factory=lambda: [0.0, -30.0, 0.0, 90.0, 0.0, 60.0, 0.0])
    # m; the obstacle misses the aimed point by up to this along the link.
    aim_spread: float = 0.01
    # deg; and its direction differs from the given one by up to this.
    direction_spread: float = 5.0
    # Whether the end effector moves along `motion`, or stays.
    moving: bool = False
    motion: StraightMotionParameters = field(default_factory=StraightMotionParameters)
    system: NullSpaceCellParameters = field(default_factory=NullSpaceCellParameters)


@dataclass
class Setup:
    """A diagram and what is needed to run and judge it."""

    scenario: NullSpaceScenario
    robot: RobotModel
    diagram: Diagram
    parts: NullSpaceCell
    recorder: Recorder
    fast: Recorder  # every step of the plant


@dataclass
class Run:
    """A finished run."""

    setup: Setup
    log: Log
    fast: Log  # velocity and torque_excess at every step of the plant
    wall: float  # s
    cpu: float  # s; time of the processor, which other programs do not lengthen

    def task_forces(self) -> tuple[Array, Array, Array]:
        """Return J_M^{#T}τ (T, m) of the true external torque, of τ̂ and of −r: what the main task feels of each."""
        log, controller, robot = self.log, self.setup.parts.pipeline.controller, self.setup.robot
        rows: list[list[Array]] = [[], [], []]
        torques = -log["contact_torque"], log["torque_estimated"], -log["residual"]
        for k, (q, v) in enumerate(zip(log["position"], log["velocity"])):
            J_inv = controller.kinematics(evaluate_dynamics(robot, q, v)).task.J_inv
            for row, torque in zip(rows, torques):
                row.append(J_inv.T @ torque[k])
        return np.array(rows[0]), np.array(rows[1]), np.array(rows[2])

    def elbow(self) -> Array:
        """Return the displacement (T,) of the end of the touched link (origin of the next one) from the start (m)."""
        cell, robot = self.setup.scenario.system.cell, self.setup.robot
        touch = cell.wall.touch if cell.obstacle == "wall" else cell.ball.touch
        link = min(robot.link_index(touch.link) + 1, robot.n - 1)
        path = np.array([robot.kinematics(q).p_WL[link] for q in self.log["position"]])
        return np.asarray(np.linalg.norm(path - path[0], axis=1))

    def error(self) -> Array:
        """Return the distance from the desired position (T,) (m)."""
        return np.asarray(np.linalg.norm(self.log["task_error"][:, -3:], axis=1))


def build(scenario: NullSpaceScenario, meshcat: Meshcat | None = None) -> Setup:
    """Build the diagram of a scenario, with its recorder."""
    # The controller makes up for friction by what the observer takes for a push: none is taken out of that.
    robot = scenario.known(scenario.loaded(scenario.home))
    builder = DiagramBuilder()
    truth = scenario.truth(scenario.system.period)
    parts = add_null_space_cell(builder, robot, aimed(scenario), truth)
    if scenario.moving:
        start = parts.pipeline.controller.kinematics(evaluate_dynamics(robot, robot.home, np.zeros(robot.n)))
        motion = straight_motion(RigidTransform(RotationMatrix(start.R), start.p), scenario.motion)
        builder.AddNamedSystem("motion", motion)
        for name in ("desired_pose", "desired_velocity", "desired_acceleration"):
            builder.Connect(motion.GetOutputPort(name), parts.pipeline.controller.GetInputPort(name))
    recorder = _record(builder, parts)
    fast = record_limits(builder, parts.cell, parts.pipeline.envelope.GetOutputPort("torque_excess"))
    inject_into(builder, parts.cell, truth)
    show(builder, parts.cell.scene_graph, meshcat)
    return Setup(scenario, robot, builder.Build(), parts, recorder, fast)


def aimed(scenario: NullSpaceScenario) -> NullSpaceCellParameters:
    """Return the system's parameters with the obstacle shifted along the touched link and turned by the seed."""
    system: NullSpaceCellParameters = deepcopy(scenario.system)
    rng = np.random.default_rng(scenario.seed)
    shift, turn = scenario.aim_spread * rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0) * np.pi
    tilt = np.tan(np.deg2rad(scenario.direction_spread * rng.uniform()))
    for touch in (system.cell.ball.touch, system.cell.wall.touch):
        touch.aim = [*touch.aim[:2], touch.aim[2] + float(shift)]
        R_WD = RotationMatrix.MakeFromOneVector(touch.direction, 2)
        touch.direction = R_WD.multiply([tilt * np.cos(turn), tilt * np.sin(turn), 1.0]).tolist()
    return system


def _record(builder: DiagramBuilder, parts: NullSpaceCell) -> Recorder:
    cell, p = parts.cell, parts.pipeline
    recorder = record_robot(builder, cell, RECORD_PERIOD)
    recorder.add("contact_torque", cell.contact_torque, "Nm")
    recorder.add("contact", cell.contact_results, "N, m", lambda results: contact_truth(results, cell)[:6], 6)
    recorder.add("residual", p.momentum.GetOutputPort("torque_external"), "Nm")
    recorder.add("torque_estimated", p.disturbance.GetOutputPort("torque_external"), "Nm", lambda torque: -torque)
    recorder.add("torque_commanded", p.torque_output, "Nm")
    recorder.add("torque_excess", p.envelope.GetOutputPort("torque_excess"), "Nm")
    for name, unit in (("task_error", "m"), ("yielding", "1")):
        recorder.add(name, p.controller.GetOutputPort(name), unit)
    return recorder


def require_dwell(scenario: NullSpaceScenario) -> None:
    """Demand a run that lasts until the ball departs, since the error is judged just before."""
    end = scenario.system.cell.ball.departure
    if scenario.duration < end:
        raise ParameterError("duration", f"must reach the departure of the ball at {end:.2f} s, or shorten ball.dwell")


def speed(*runs: Run) -> list[Metric]:
    """Return how much faster than real time the slowest run is, on the clock and on one core for itself."""
    wall, core = (min(run.setup.scenario.duration / getattr(run, name) for run in runs) for name in ("wall", "cpu"))
    return [
        Metric("real_time_factor", wall, "1", 1.0, decides=False),
        Metric("real_time_factor_one_core", core, "1", 1.0, decides=False),
    ]


def limits(*runs: Run) -> list[Metric]:
    """Return how far the runs use the joints' limits, at every step of the plant."""
    velocity, excess = (np.vstack([run.fast[name] for run in runs]) for name in ("velocity", "torque_excess"))
    return limit_metrics(runs[0].setup.robot, velocity, excess)


class Runs:
    """Runs of one process, each made once: a case and the runs that it is compared with."""

    def __init__(self) -> None:
        self._done: dict[str, Run] = {}

    def get(self, scenario: NullSpaceScenario, options: RunOptions | None = None, **changes: Any) -> Run:
        """Return the run of a scenario, with its case (`observer`) or its `obstacle` changed."""
        scenario = deepcopy(scenario)
        observer = changes.get("observer", scenario.case)
        scenario.case = scenario.system.controller.observer = observer
        scenario.system.cell.obstacle = changes.get("obstacle", scenario.system.cell.obstacle)
        key = yaml_dump_typed(scenario)
        if key not in self._done:
            options = options or RunOptions()
            setup = build(scenario, options.meshcat)
            run = Simulation(setup.diagram, observer, options)
            run.to(scenario.duration)
            self._done[key] = Run(setup, run.log(setup.recorder), run.log(setup.fast), run.wall, run.cpu)
        return self._done[key]


def replay(run: Run, path: Path, title: str) -> None:
    """Write the run as a page that plays offline, with the contact force as an arrow."""
    log, cell, scale = run.log, run.setup.parts.cell, 0.01
    force, point = log["contact"][:, :3], log["contact"][:, 3:]
    arrow = Arrow("force", point - scale * force, force, scale, (0.0, 0.62, 0.45), np.any(force != 0.0, axis=1))
    positions = log["plant_position" if "plant_position" in log else "position"]  # a wall does not move
    camera = ((1.6, 1.6, 1.2), (0.2, 0.0, 0.5))
    write_replay(path, cell.copy_to, log.time, positions, [arrow], camera=camera, title=title)
