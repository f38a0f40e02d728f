"""Runs of the guiding cell: scenario, hands, recording, and the runs that a case is compared with."""

from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder

from experiments.guiding.cell import GuidingCell, GuidingCellParameters, add_guiding_cell
from saphari_drake.errors import ParameterError
from saphari_drake.messages import SkinReading
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.skin.layout import SkinLayout
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.simulation.faults.injection import inject_into
from saphari_drake.simulation.people.force_recording import ForceRecording, RecordingParameters
from saphari_drake.simulation.people.guiding_hands import Grip, Hand, Profile
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.record.robot import record_limits, record_robot
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation
from saphari_drake.simulation.view.replay import show

Array = NDArray[np.float64]


@dataclass
class GuidingRecordingParameters(RecordingParameters):
    """How a recorded force is played to the end effector. All assumed."""

    peak: float = 8.0
    # Whether its mean is taken out, so that the arm comes back to about where it started.
    centred: bool = True
    # s; when it begins, how long it takes to rise and to fall, and the longest part that is played.
    start: float = 0.6
    blend: float = 0.3
    longest: float = 4.8

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "blend", "longest")
        require_non_negative(self, "start")

    def profile(self, recording: ForceRecording) -> tuple[Profile, float]:
        """Return the force in the world (N) over time (s), and when it ends."""
        length = min(recording.duration, self.longest)
        rows = recording.time <= length
        part = replace(recording, time=recording.time[rows], force=recording.force[rows])
        played, end = part.scaled(self.peak, self.centred)[0], self.start + length

        def at(now: float) -> Array:
            weight = min(max(min(now - self.start, end - now) / self.blend, 0.0), 1.0)
            return weight * played.at(now - self.start)

        return at, end


@dataclass
class GuidingScenario(PlantScenario):
    """Everything a run depends on; the seed is also of the sensors, and of where and how hard the hands press."""

    case: str = "end_effector_first"
    duration: float = 5.4
    # deg; posture at the start. Empty: the model's own home posture, as it is with --model.
    home: list[float] = field(default_factory=lambda: [90.0, -35.0, 0.0, 68.0, 0.0, -30.0, 0.0])
    # m; the hand misses the middle of the skin by up to this in each direction along the surface.
    aim_spread: float = 0.012
    # Share by which the forces of both hands differ from those below.
    force_spread: float = 0.1
    # Force of the hand that comes second, as a multiple of its pulls.
    second_scale: float = 1.0
    # Pulls in the world. Those at the body: along the skin, around it, and outwards, as it lies at the start.
    end_effector: Hand = field(default_factory=Hand)
    body: Hand = field(default_factory=Hand)
    recording: GuidingRecordingParameters = field(default_factory=GuidingRecordingParameters)
    system: GuidingCellParameters = field(default_factory=GuidingCellParameters)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_non_negative(self, "aim_spread", "second_scale")
        require_non_negative(self, "force_spread")
        if self.force_spread >= 1.0:
            raise ParameterError("force_spread", f"must be below 1, got {self.force_spread}")

    @property
    def main(self) -> int:
        """Which hand comes first: 0 at the end effector, 1 at the body."""
        return 1 if self.case == "body_first" else 0


@dataclass
class GuidingSetup:
    """A diagram and what is needed to run and judge it."""

    scenario: GuidingScenario
    robot: RobotModel
    grips: list[Grip]
    diagram: Diagram
    cell: GuidingCell
    recorder: Recorder  # every cycle
    fast: Recorder  # every step of the plant


@dataclass
class GuidingRun:
    """A finished run."""

    setup: GuidingSetup
    log: Log
    fast: Log  # velocity and torque_excess at every step of the plant
    wall: float  # s


def build(scenario: GuidingScenario, synthetic: Path, meshcat: Meshcat | None = None) -> GuidingSetup:
    """Build the diagram of a scenario, with its recorder; `synthetic` is the recording played if none is given."""
    robot = scenario.known(scenario.loaded(scenario.home))
    system = deepcopy(scenario.system)
    system.skin_sensor.seed = system.force_sensor.seed = system.skin_sensor.modules.seed = scenario.seed
    layout = SkinLayout(robot, system.skin_layout)
    grips = hands_of(scenario, system, robot, layout, synthetic)
    builder = DiagramBuilder()
    truth = scenario.truth(system.pipeline.period)
    cell = add_guiding_cell(builder, robot, grips, system, layout, truth)
    recorder, fast = (
        record(builder, cell, system.pipeline.period),
        record_limits(builder, cell.cell, cell.torque_excess),
    )
    inject_into(builder, cell.cell, truth)
    show(builder, cell.cell.scene_graph, meshcat)
    return GuidingSetup(scenario, robot, grips, builder.Build(), cell, recorder, fast)


def hands_of(
    scenario: GuidingScenario, system: GuidingCellParameters, robot: RobotModel, layout: SkinLayout, synthetic: Path
) -> list[Grip]:
    """Return both hands as this seed has them."""
    rng = np.random.default_rng([scenario.seed, 7])
    hands = [deepcopy(scenario.end_effector), deepcopy(scenario.body)]
    for k, hand in enumerate(hands):
        scale = scenario.second_scale if k != scenario.main else 1.0
        for pull in hand.pulls:
            own = 1.0 + scenario.force_spread * rng.uniform(-1.0, 1.0, 3)
            pull.size = (scale * own * np.asarray(pull.size)).tolist()
    uv = scenario.aim_spread * rng.uniform(-1.0, 1.0, 2)
    p_LC, R_LC = layout.surface(uv)
    # A person's force does not turn with the link.
    R_WC = evaluate_dynamics(robot, robot.home, np.zeros(robot.n)).R_WL[layout.link] @ R_LC
    for pull in hands[1].pulls:
        pull.size = (R_WC @ np.asarray(pull.size)).tolist()
    link, X_LF = robot.frame(system.pipeline.wrist.tip_frame)
    tip = X_LF @ np.asarray(system.pipeline.wrist.tip_point, dtype=float)
    profile = None
    if scenario.case == "recorded":
        profile, _ = scenario.recording.profile(scenario.recording.read(synthetic))
    return [Grip(link, tip, hands[0], profile=profile), Grip(layout.link, p_LC, hands[1])]


def record(builder: DiagramBuilder, cell: GuidingCell, period: float) -> Recorder:
    """Record, once a cycle, what the figures and the judgement need."""
    recorder = record_robot(builder, cell.cell, period)
    recorder.add("truth", cell.hands.GetOutputPort("truth"), "N, m, m/s")
    if cell.pipeline.skin is not None:
        recorder.add("skin", cell.pipeline.skin.GetOutputPort("skin_reading"), "m, N", strongest_contact, 6)
    units = {
        "torque_commanded": "Nm", "priority": "GuidingPriority", "status": "GuidingStatus",
        "force": "N", "velocity_desired": "m/s", "acceleration_desired": "m/s²", "rank": "1",
        "unreachable_force": "N", "position_commanded": "rad",
    }  # fmt: skip
    recorder.add("torque_excess", cell.torque_excess, "Nm")
    for name, unit in units.items():
        recorder.add(name, cell.pipeline.controller.GetOutputPort(name), unit)
    return recorder


def strongest_contact(reading: SkinReading) -> Array:
    """Return point (m) and force (N) of the strongest contact in the link frame (6,), zeros without one."""
    if not reading.contacts:
        return np.zeros(6)
    return np.concatenate([reading.contacts[0].p_LC, reading.contacts[0].f_L])


class GuidingRuns:
    """Runs of one scenario: as it is, without the second hand, and with the second hand three times as strong."""

    def __init__(self, scenario: GuidingScenario, synthetic: Path, options: RunOptions | None = None) -> None:
        self._scenario, self._synthetic, self._options = scenario, synthetic, options or RunOptions()
        self._done: dict[float, GuidingRun] = {}

    def get(self, second_scale: float = 1.0) -> GuidingRun:
        """Return the run with the second hand's force multiplied; 0: without it. Each is made once."""
        if second_scale not in self._done:
            scenario = deepcopy(self._scenario)
            scenario.second_scale *= second_scale
            options = self._options if second_scale == 1.0 else RunOptions()
            setup = build(scenario, self._synthetic, options.meshcat)
            words = {0.0: "without the second hand", 1.0: ""}.get(second_scale, f"second force × {second_scale:g}")
            run = Simulation(setup.diagram, f"{scenario.case} {words}".strip(), options)
            run.to(scenario.duration)
            self._done[second_scale] = GuidingRun(setup, run.log(setup.recorder), run.log(setup.fast), run.wall)
        return self._done[second_scale]
