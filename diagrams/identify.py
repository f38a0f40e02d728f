"""Friction, payload and inertias of an arm, identified from a motion of its own, as parameters of a robot.

The result, identified.yaml in the folder of a case, is what a `RobotModel` takes by `corrected`, and every script by
--set identified=FILE: inertias and payload for all its controllers, friction and bias for its momentum observer. The
plant of this script is realistic unless --plant says otherwise: an ideal one has nothing to find.
"""

import sys
from dataclasses import dataclass, field

import numpy as np
from experiments.identification import Recorded, best_excitation, build_identification, judged
from experiments.placement.excitation import place_excitation
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydrake.systems.framework import Diagram

from saphari_drake.estimation.excitation import ExcitationParameters
from saphari_drake.estimation.joint_identification import Identification, identify
from saphari_drake.parameters import require_non_negative
from saphari_drake.simulation.faults.registry import ARM
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.runner.results import Outcome
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters
from saphari_drake.simulation.view.figures import blank
from saphari_drake.simulation.world.position_servo import PositionServoParameters

CASES = {
    "arm": "friction of the joints, inertias of motors and links, and what the arm carries",
    "tool": "the same with a payload of 1 kg more",
}


@dataclass
class IdentifyScenario(PlantScenario):
    """Everything a run depends on; its length is that of the excitation, `duration` is not used."""

    case: str = "arm"
    plant: str = "realistic"
    # deg; posture about which the arm moves. Empty: the model's own home, as it is with --model.
    home: list[float] = field(default_factory=lambda: [0.0, 10.0, 0.0, 60.0, 0.0, 40.0, 0.0])
    # kg; payload beside that of the plant's profile.
    payload: float = 0.0
    excitation: ExcitationParameters = field(default_factory=ExcitationParameters)
    # Soft: what is measured is the torque, not how well the arm follows.
    servo: PositionServoParameters = field(
        default_factory=lambda: PositionServoParameters(stiffness=900.0, damping=60.0, period=0.001)
    )
    joint_sensor: JointSensorParameters = field(default_factory=lambda: JointSensorParameters(0.001, 1e-6))
    # Harmonics of the series that is fitted to positions.
    harmonics: int = 40

    def __post_init__(self) -> None:
        super().__post_init__()
        require_non_negative(self, "payload", "harmonics")


def scenario_for(case: str) -> IdentifyScenario:
    """Return the scenario of a case."""
    return IdentifyScenario(case=case, payload=1.0 if case == "tool" else 0.0)


def _recorded(scenario: IdentifyScenario) -> Recorded:
    return build_identification(scenario, best_excitation(scenario))


def build_diagram(scenario: IdentifyScenario) -> Diagram:
    """Return the diagram of a scenario."""
    return _recorded(scenario).diagram


def run(scenario: IdentifyScenario, options: RunOptions) -> Outcome:
    """Move the arm, identify it, and judge what was found by the simulated truth."""
    cell, p = _recorded(scenario), scenario.excitation
    simulation = Simulation(cell.diagram, scenario.case, options)
    simulation.to((1 + p.periods) * p.period + 0.01)
    log = simulation.log(cell.recorder)
    rows = np.flatnonzero(log.between(p.period, (1 + p.periods) * p.period))[::2]
    time, position, torque = log.time[rows], log["position_measured"][rows], log["torque"][rows]
    delays = scenario.truth(scenario.servo.period).profile.torque_delay * scenario.servo.period  # known of the drives
    found = identify(cell.robot, time, position, torque, p.period, scenario.harmonics, delays)
    return Outcome(
        judged(scenario, cell, found, log),
        log,
        lambda: figure(cell, found, log),
        files={"identified.yaml": found.found.text()},
    )


def figure(cell: Recorded, found: Identification, log: Log) -> Figure:
    """Return what was found of each joint against the truth, and the torque that is left over."""
    result, grid = blank(3, 1, "Friction and unexplained torque of the joints", (7.5, 7.5))
    axes: list[Axes] = list(grid[:, 0])
    joints = np.arange(cell.robot.n)
    for axis, name, unit, true in zip(axes[:2], ("coulomb", "viscous"), ("Nm", "Nms/rad"), cell.friction):
        axis.bar(joints - 0.2, getattr(found.found, name), 0.4, yerr=found.sigma[name], label="identified")
        axis.bar(joints + 0.2, true, 0.4, label="true")
        axis.set_ylabel(f"{name.capitalize()} friction [{unit}]")
    axes[2].bar(joints - 0.2, found.before, 0.4, label="by the model file")
    axes[2].bar(joints + 0.2, found.after, 0.4, label="identified")
    axes[2].set_ylabel("RMS torque left [Nm]")
    for axis in axes:
        axis.set_xticks(joints, cell.robot.joint_names)
        axis.legend(fontsize=8, loc="lower center", ncols=2)
    return result


def quick(scenario: IdentifyScenario) -> None:
    """Measure one period of the motion, the first that is drawn."""
    scenario.excitation.periods = scenario.excitation.trials = 1


EXPERIMENT = Experiment(
    "identify",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=place_excitation,
    parts=lambda case: ARM,
    quick=quick,
)

if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
