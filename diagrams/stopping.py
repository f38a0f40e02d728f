"""Stopping times and distances of a robot at full braking, as speed and separation monitoring takes them.

The result, stopping.yaml in the folder of a case, lies beside the robot's model file. Each run compares new stops with
the table that is stored there.
"""

import sys
from dataclasses import dataclass

import numpy as np
from experiments.cell.stops import Stop, StopRig, build_stop_rig, random_stop, share_of_table, table_of
from experiments.placement.arm import keep
from matplotlib.figure import Figure
from pydrake.systems.framework import Diagram

from saphari_drake.parameters import require_positive
from saphari_drake.robots import catalog
from saphari_drake.safety.speed_separation.stopping import EXTENSIONS, FILE, StoppingTable, stopping_of
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.plant_scenario import PlantScenario
from saphari_drake.simulation.runner.quick import shorten
from saphari_drake.simulation.runner.results import Metric, Outcome
from saphari_drake.simulation.runner.simulation import RunOptions
from saphari_drake.simulation.view.figures import blank

CASES = {"fixed": "a LWR4 on a fixed base", "mobile": "the omniRob with its arm"}


@dataclass
class StoppingScenario(PlantScenario):
    """Everything a run depends on; its length is that of the stops, `duration` is not used."""

    case: str = "fixed"
    # Stops; the tables beside the models are of 1000.
    trials: int = 30
    # A table is the worst that was measured times this, for what was not; assumed. A table of 300 stops without it was
    # exceeded by a quarter in 30 others.
    margin: float = 1.25

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "trials", "margin")


def scenario_for(case: str) -> StoppingScenario:
    """Return the scenario of a case."""
    return StoppingScenario(case=case, robot="lwr4" if case == "fixed" else "omnirob")


def _rig(scenario: StoppingScenario) -> StopRig:
    return build_stop_rig(scenario.known(catalog.load(scenario.robot)), scenario.truth(0.001))


def build_diagram(scenario: StoppingScenario) -> Diagram:
    """Return the diagram of a scenario."""
    return _rig(scenario).diagram


def run(scenario: StoppingScenario, options: RunOptions) -> Outcome:
    """Measure stops, make the table of them, and compare them with the stored one."""
    rig = _rig(scenario)
    stops = [random_stop(rig, np.random.default_rng([scenario.seed, k]), k % 3) for k in range(scenario.trials)]
    made = f"{rig.robot.name}, {len(stops)} random stops, {scenario.plant} plant, seed {scenario.seed}"
    table = table_of(rig, stops, f"{made}; worst times {scenario.margin:g}", scenario.margin)
    shares = np.zeros((len(stops), 2))
    if rig.robot.path.with_name(FILE).is_file():
        shares = np.array([share_of_table(stopping_of(rig.robot), stop) for stop in stops])
    log = Log(np.arange(len(stops), dtype=float))
    for name, unit in (("extension", "1"), ("speed", "m/s"), ("time", "s"), ("distance", "m")):
        log.add(f"stop_{name}", [getattr(stop, name) for stop in stops], unit)
    metrics = [
        Metric("time_over_table_max", shares[:, 0].max(), "1", high=1.0),
        Metric("distance_over_table_max", shares[:, 1].max(), "1", high=1.0),
        Metric("stopping_time_max_s", max(stop.time for stop in stops), "s"),
        Metric("stopping_distance_max_m", max(stop.distance for stop in stops), "m"),
        Metric("speed_max_m_s", max(stop.speed for stop in stops), "m/s"),
        Metric("trials", float(len(stops)), "1"),
    ]
    return Outcome(metrics, log, lambda: figure(table, stops), files={FILE: table.text()})


def figure(table: StoppingTable, stops: list[Stop]) -> Figure:
    """Return the stops and the lines above them."""
    result, grid = blank(2, 1, "Stops at full braking (dots), and their table (lines)", (7.5, 6.5))
    for axis, name, unit in zip(grid[:, 0], ("time", "distance"), ("s", "m")):
        for k, limit in enumerate(EXTENSIONS):
            own = [stop for stop in stops if np.searchsorted(EXTENSIONS, min(stop.extension, 1.0) - 1e-9) == k]
            axis.plot([stop.speed for stop in own], [getattr(stop, name) for stop in own], f"C{k}.")
            axis.plot(table.speed, getattr(table, name)[k], f"C{k}-", label=f"extension up to {limit:.2f}")
        axis.set_ylabel(f"Stopping {name} [{unit}]")
        axis.legend(fontsize=8)
    grid[-1, 0].set_xlabel("Speed of the fastest end [m/s]")
    return result


EXPERIMENT = Experiment(
    "stopping",
    __doc__,
    CASES,
    scenario_for,
    run,
    build_diagram,
    adapt=keep,
    quick=lambda scenario: shorten(scenario, trials=3),
)  # one of each kind


if __name__ == "__main__":
    sys.exit(main(EXPERIMENT))
