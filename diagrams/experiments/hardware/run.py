"""Runs a case on a simulated robot, or on a real one by its own clock."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator

from experiments.hardware.cell import SIM, HardwareScenario, Setup, build
from experiments.hardware.server import FrankaSim
from saphari_drake.errors import ParameterError, SensorError
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.runner.simulation import RunOptions, Simulation
from saphari_drake.stations.follow import Followed, follow
from saphari_drake.stations.process import StationProcess

Array = NDArray[np.float64]


@dataclass
class Cycles:
    """What became of the cycles of a real robot."""

    followed: Followed
    missed: int  # on the robot's clock
    late: int  # on the computer's
    longest: float  # s
    success: float  # share of the robot's last cycles that got a command; NaN: not told
    said: str  # why the loop ended, if it did


@dataclass
class Run:
    """A finished run."""

    setup: Setup
    log: Log
    cycles: Cycles | None = None  # of a real robot
    truth: tuple[Array, Array] | None = None  # force along the rod's rail (N) at times of the log (s), where known


def run_case(scenario: HardwareScenario, options: RunOptions | None = None) -> Run:
    """Run a scenario where its address says."""
    scenario, options = deepcopy(scenario), options or RunOptions()
    if scenario.address != SIM:
        if scenario.plant != "ideal":
            raise ParameterError("plant", f"is that of a simulated robot; '{scenario.address}' is what it is")
        return run_station(scenario)
    robot = scenario.known(scenario.loaded(scenario.home))
    setup = build(scenario, robot, meshcat=options.meshcat)
    simulation = Simulation(setup.diagram, scenario.case, options)
    simulation.to(scenario.duration)
    log = simulation.log(setup.recorder)
    direction = np.asarray(scenario.rod.direction) / np.linalg.norm(scenario.rod.direction)
    return Run(setup, log, truth=(log.time, log["contact_truth"] @ direction))


def run_station(scenario: HardwareScenario, begin: Callable[[], None] = lambda: None) -> Run:
    """Run a scenario on a real robot, whose home becomes the posture in which it is; `begin()` is called at the start.

    Raises
    ------
    SensorError
        If the robot does not answer, or is lost before it has begun.
    """
    robot = scenario.known(scenario.loaded(scenario.home))
    scenario.station.period = scenario.pipeline.period
    with StationProcess(scenario.address, robot, scenario.station) as process:
        told = process.link.reading.read()
        if told is None or not np.isfinite(told["position"]).all():
            raise SensorError(process.said() or "the robot tells no position")
        setup = build(scenario, robot.with_home(told["position"]), process.link)
        simulator = Simulator(setup.diagram)
        begun = False

        def first() -> bool:
            nonlocal begun
            if not begun:
                begin()
                begun = True
            return False

        followed = follow(simulator, process, scenario.station, scenario.duration, first)
        last = process.link.reading.read() or {}
        log = setup.recorder.log(setup.diagram, simulator.get_context())
        counts = {name: float(last[name][0]) for name in ("missed", "late", "longest", "success")}
        said = "" if followed.running else process.said()
    cycles = Cycles(followed, int(counts["missed"]), int(counts["late"]), counts["longest"], counts["success"], said)
    return Run(setup, log, cycles)


def run_franka_sim(scenario: HardwareScenario, enforce: bool = True) -> tuple[Run, list[str]]:
    """Run a scenario over the FCI on MuJoCo's arm, with what was true; return it and what the server found wrong."""
    scenario = deepcopy(scenario)
    scenario.address = f"fci://{FrankaSim.HOST}"
    with FrankaSim(scenario.loaded(scenario.home), scenario.rod, enforce) as server:
        run = run_station(scenario, server.begin)
        warnings, truth = server.warnings(), server.close()
    run.truth = (truth["time"] - lag(run.log, truth, scenario.pipeline.period), truth["force"])
    return run, warnings


def lag(log: Log, truth: dict[str, Array], period: float) -> float:
    """Return how much later (s) the truth's clock shows the same posture than the log's: the best of -0.1 to 2 s.

    A row of the log holds the sample of the period before.
    """
    rows, best = log.time > 0.2, (np.inf, 0.0)
    for shift in np.arange(-100, 2001) * 1e-3:
        at = np.searchsorted(truth["time"], log.time[rows] - period + shift - 5e-4)
        error = np.abs(truth["q"][np.minimum(at, len(truth["time"]) - 1)] - log["position_measured"][rows]).max()
        best = min(best, (float(error), float(shift)))
    return best[1]
