"""Addresses of robots, and what is said where there is none."""

import builtins

import pytest

from saphari_drake.errors import ParameterError, SensorError
from saphari_drake.stations.arm import connect
from saphari_drake.stations.process import StationProcess


@pytest.mark.parametrize("address", ["", "fci://", "tcp://10.0.0.1", "sim"])
def test_an_unknown_address_lists_those_that_exist(address):
    with pytest.raises(ParameterError, match=r"fci://HOST, lcm"):
        connect(address, 7)


def test_another_number_of_joints_is_refused():
    with pytest.raises(ParameterError, match="7 joints"):
        connect("fci://127.0.0.1", 6)


def test_a_missing_package_is_named(monkeypatch):
    imported = builtins.__import__

    def refuse(name, *rest):
        if name == "pylibfranka":
            raise ImportError("none")
        return imported(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(SensorError, match=r"saphari_drake\[franka\]"):
        connect("fci://127.0.0.1", 7)


def test_a_robot_that_does_not_answer_is_one_line(lwr4):
    """The loop's own process says why it ends."""
    with pytest.raises(SensorError, match="no IIWA_STATUS"):
        StationProcess("lcm://memq://", lwr4)
