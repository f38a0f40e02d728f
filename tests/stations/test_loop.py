"""The loop at the robot: it counts what it misses, and ends when it is told to, with a robot that stands."""

import os

import numpy as np
import pytest

from saphari_drake.errors import SensorError
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.stations.arm import ArmReading
from saphari_drake.stations.guard import Guard
from saphari_drake.stations.loop import Cadence, serve
from saphari_drake.stations.parameters import StationParameters
from saphari_drake.stations.shared import StationStatus, open_link

T = 0.001


class ModelArm:
    """An arm that is its model, without a clock; `during(k)` is called in cycle k."""

    def __init__(self, robot, v, during=lambda k: None):
        self.robot, self.q, self.v, self.k, self.during = robot, robot.home.copy(), v, 0, during
        self.speeds = []

    def read(self):
        self.during(self.k)
        self.k += 1
        assert self.k < 5000, "the loop does not end"
        return ArmReading(self.q, self.v, np.full(7, np.nan), self.k * T)

    def write(self, torque, gravity):
        terms = evaluate_dynamics(self.robot, self.q, self.v)
        assert np.allclose(gravity, terms.g)
        self.v = self.v + T * np.linalg.solve(terms.M, torque - terms.Cv - terms.g)
        self.q = self.q + T * self.v
        self.speeds.append(np.abs(self.v).max())


@pytest.fixture
def link():
    link = open_link(7)
    yield link
    link.path.unlink()


def test_missed_and_late_cycles_are_counted():
    cadence, clock = Cadence(T), 10.0
    for k in (0, 1, 2, 5, 6):
        clock += 0.004 if k == 6 else T
        cadence.tick(3.0 + k * T, clock)
    assert (cadence.missed, cadence.late) == (2, 1)
    assert cadence.longest == pytest.approx(0.004)


@pytest.mark.parametrize("commanded", [False, True])
def test_closing_ends_with_a_robot_that_stands(lwr4, link, commanded):
    """Whether or not it was ever commanded."""

    def during(k):
        if commanded and k < 3:
            weight = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g
            link.command.write(torque=weight, time=1e12)  # from now on always fresh
        if k == 10:
            link.command.write(close=1.0)

    arm = ModelArm(lwr4, 0.2 * np.ones(7), during)
    params = StationParameters()
    serve(arm, Guard(lwr4, params), link, params, os.getppid())
    assert arm.k < 1000 and arm.speeds[-1] <= params.standing_speed
    told = link.reading.read()
    assert told["status"][0] == StationStatus.STALE and told["missed"][0] == 0.0


def test_an_orphan_stops_the_robot_and_ends(lwr4, link):
    """Another parent than at the start: the diagram's process is dead, however fresh its command."""
    link.command.write(torque=np.zeros(7), time=1e12)
    arm, params = ModelArm(lwr4, 0.2 * np.ones(7)), StationParameters()
    serve(arm, Guard(lwr4, params), link, params, -1)
    assert arm.speeds[-1] <= params.standing_speed
    assert arm.k * T >= params.end_time


def test_a_robot_that_ends_is_an_error(lwr4, link):
    def during(k):
        if k == 3:
            raise SensorError("the robot has stopped")

    params = StationParameters()
    with pytest.raises(SensorError, match="stopped"):
        serve(ModelArm(lwr4, np.zeros(7), during), Guard(lwr4, params), link, params, os.getppid())
