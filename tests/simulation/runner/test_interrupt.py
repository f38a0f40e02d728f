"""A run that is told to end keeps what was recorded so far, and says so."""

import os
import signal
import threading
from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LinearSystem

from saphari_drake.simulation.record.files import own_folder
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.experiment import Experiment, main
from saphari_drake.simulation.runner.interrupt import STOP
from saphari_drake.simulation.runner.simulation import Simulation, advance


@dataclass
class Long:
    case: str = "long"
    seed: int = 0
    duration: float = 1e9
    robot: str = "mass"


def swing(way):
    """Return an experiment that does not end by itself, and tells after 0.3 s that it has begun."""

    def run(scenario, options):
        builder = DiagramBuilder()
        mass = builder.AddSystem(LinearSystem(np.eye(2), np.zeros((2, 0)), np.eye(2), np.zeros((2, 0))))
        Recorder(builder, 0.01).add("state", mass.get_output_port(), "m, m/s")
        Recorder(builder, 0.1).add("slow", mass.get_output_port(), "m, m/s")
        Recorder(builder, 0.01).add("again", mass.get_output_port(), "m, m/s")
        diagram = builder.Build()
        threading.Timer(0.3, os.kill, (os.getpid(), way)).start()
        if scenario.case == "long":
            Simulation(diagram, "long", options).to(scenario.duration)
        advance(Simulator(diagram), scenario.duration)
        raise AssertionError("it came to its end")

    cases = {"long": "by a simulation", "bare": "by a simulator"}
    return Experiment("swing", "A mass.", cases, lambda case: replace(Long(), case=case), run)


@pytest.mark.parametrize(("way", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("case", ["long", "bare"])
def test_a_signal_keeps_the_log_so_far(tmp_path, capsys, way, status, case):
    """With the signals of one time axis; the handlers of before are back afterwards."""
    before = signal.getsignal(way)
    assert main(swing(way), ["--case", case, "--out", str(tmp_path)]) == status
    told, folder = capsys.readouterr().err.strip(), tmp_path / case
    assert told.startswith(f"swing: case {case}: interrupted after ") and str(folder / "log.npz") in told
    log = Log.load(folder / "log.npz")
    assert log.time.size > 10 and list(log) == ["state", "again"]
    np.testing.assert_allclose(np.diff(log.time), 0.01)
    assert sorted(path.name for path in folder.iterdir()) == ["log.npz", "scenario.yaml"]
    assert signal.getsignal(way) is before


def test_a_signal_while_nothing_advances_ends_at_once():
    with pytest.raises(KeyboardInterrupt), STOP.heard():
        signal.raise_signal(signal.SIGTERM)
    assert STOP.status == 143


def test_two_runs_do_not_write_to_one_folder(tmp_path, capsys):
    """The second one is told, and touches nothing."""
    folder = tmp_path / "long"
    with own_folder(folder):
        assert main(swing(signal.SIGINT), ["--case", "long", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"swing: error: case long: --out: another run is writing to '{folder}'\n"
    assert list(folder.iterdir()) == []
