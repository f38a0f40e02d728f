"""A run of a diagram: its time, clocks and logs."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.simulation.record.recorder import Recorder
from saphari_drake.simulation.runner.simulation import Simulation
from saphari_drake.simulation.world.references import Reference


def clock():
    builder = DiagramBuilder()
    source = builder.AddSystem(Reference({"time": lambda t: np.array([t])}))
    recorders = [Recorder(builder, period) for period in (0.05, 0.1)]
    for recorder in recorders:
        recorder.add("now", source.get_output_port(), "s")
    return builder.Build(), recorders


def test_a_run_goes_on_from_where_it_is_and_keeps_all_logs():
    diagram, (fine, coarse) = clock()
    run = Simulation(diagram, "clock")
    for end in (0.25, 0.25, 0.62):
        assert run.to(end).get_time() == pytest.approx(end)
    for recorder, period in ((fine, 0.05), (coarse, 0.1)):
        log = run.log(recorder)
        np.testing.assert_allclose(log["now"][:, 0], log.time, atol=1e-12)
        np.testing.assert_allclose(log.time, period * np.arange(round(0.6 / period) + 1), atol=1e-12)


def test_its_clocks_add_up():
    diagram, _ = clock()
    run = Simulation(diagram)
    run.to(0.2)
    first = run.wall
    run.to(0.5)
    assert 0.0 < first < run.wall and 0.0 < run.cpu
    assert run.real_time_factor == pytest.approx(0.5 / run.wall)


def test_each_run_starts_anew():
    diagram, (fine, _) = clock()
    Simulation(diagram).to(0.3)
    run = Simulation(diagram)
    run.to(0.1)
    assert run.log(fine).time[-1] == pytest.approx(0.1)
