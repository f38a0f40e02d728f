"""A robot as a system: what it tells is what the loop wrote; what is asked goes out in the same cycle."""

import time

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from saphari_drake.stations.parameters import StationParameters
from saphari_drake.stations.ports import StationPorts
from saphari_drake.stations.shared import StationStatus, open_link
from saphari_drake.stations.station import RobotStation


@pytest.fixture
def link(lwr4):
    link = open_link(lwr4.n)
    yield link
    link.path.unlink()


@pytest.fixture
def station(lwr4, link):
    return RobotStation(lwr4, link, StationParameters())


def tell(link, q, status=StationStatus.OK, age=0.0):
    link.reading.write(
        position=q, velocity=0.1, torque_measured=1.0, torque_acting=2.0, torque_external=3.0, missed=4.0, late=5.0,
        success=0.98, time=3.0, status=status, stamp=time.monotonic() - age,
    )  # fmt: skip


def started(station):
    simulator = Simulator(station)
    station.GetInputPort("torque_applied").FixValue(simulator.get_mutable_context(), np.arange(7.0))
    simulator.Initialize()
    return simulator


def read(station, simulator, name):
    return station.GetOutputPort(name).Eval(simulator.get_context())


def test_all_stations_have_the_same_ports(station):
    names = [port.get_name() for port in station.ports]
    assert names == list(StationPorts._fields)


def test_it_tells_what_the_loop_wrote_once_a_cycle(station, link):
    tell(link, 0.5)
    simulator = started(station)
    assert np.all(read(station, simulator, "position_measured") == 0.5)
    tell(link, 0.7)
    assert np.all(read(station, simulator, "position_measured") == 0.5)
    simulator.AdvanceTo(0.002 + 2e-6)
    told = {name: read(station, simulator, name)[0] for name in ("position_measured", "velocity_measured",
            "torque_measured", "torque_acting", "torque_external", "status", "missed_cycles", "late_cycles",
            "success_rate")}  # fmt: skip
    assert list(told.values()) == [0.7, 0.1, 1.0, 2.0, 3.0, 0.0, 4.0, 5.0, 0.98]


def test_a_command_goes_out_in_its_own_cycle(station, link):
    """Between the sample and the command lies a microsecond of simulated time; nothing goes out at the start."""
    tell(link, 0.5)
    simulator = started(station)
    assert link.command.read()["time"][0] == 0.0
    simulator.AdvanceTo(0.002 + 1.5e-6)
    assert link.command.read()["time"][0] == 0.0
    simulator.AdvanceTo(0.002 + 3e-6)
    told = link.command.read()
    assert np.array_equal(told["torque"], np.arange(7.0))
    assert told["time"][0] == 3.0, "the sample that it answers"


@pytest.mark.parametrize("what", ["silent", "lost", "nan", "nothing"])
def test_a_robot_that_is_lost_gives_nan_and_says_so(station, link, what):
    if what != "nothing":
        tell(link, np.nan if what == "nan" else 0.5, StationStatus.LOST if what == "lost" else StationStatus.OK,
             1.0 if what == "silent" else 0.0)  # fmt: skip
    simulator = started(station)
    assert read(station, simulator, "status")[0] == StationStatus.LOST
    assert np.isnan(read(station, simulator, "position_measured")).all()
    tell(link, 0.5)
    simulator.AdvanceTo(0.002 + 3e-6)
    assert read(station, simulator, "status")[0] == StationStatus.OK


def test_a_clone_keeps_its_sample(station, link):
    tell(link, 0.5)
    simulator = started(station)
    clone = simulator.get_context().Clone()
    tell(link, 0.7)
    simulator.AdvanceTo(0.002 + 3e-6)
    assert np.all(station.GetOutputPort("position_measured").Eval(clone) == 0.5)
    assert np.all(read(station, simulator, "position_measured") == 0.7)
