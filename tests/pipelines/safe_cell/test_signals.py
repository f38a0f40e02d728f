"""The small systems of the safe cell: who holds it, what is broken, how fast it goes."""

import numpy as np
import pytest
from bench import Bench

from saphari_drake.errors import UnknownNameError
from saphari_drake.messages import SkinContact, SkinReading
from saphari_drake.pipelines.safe_cell.signals import (
    CellSignalParameters,
    FaultGate,
    HoldDetector,
    ScaledVelocity,
    SpeedChoice,
)

Z = np.array([0.0, 0.0, 1.0])


def test_a_hand_on_skin_or_tool_is_felt():
    b = Bench(HoldDetector(), wrench_measured=np.zeros(6), skin=SkinReading())
    assert b.read("taken") == 0.0
    b.set(wrench_measured=[0.0, 0.0, 0.0, 0.0, 5.0, 5.0])
    assert b.read("taken") == 1.0
    b.set(wrench_measured=np.zeros(6), skin=SkinReading((SkinContact(2, Z, Z, -4.0 * Z),)))
    assert b.read("taken") == 1.0
    b.set(wrench_measured=np.full(6, np.nan), skin=SkinReading())
    assert np.isnan(b.read("taken"))


def test_a_status_is_broken_when_it_lasts():
    b = Bench(FaultGate({"camera": (2, 3), "arm": (1,)}), camera=0.0, arm=0.0)
    b.run(5, camera=2.0)
    np.testing.assert_array_equal(b.read("faults"), 0.0)
    b.run(60)
    np.testing.assert_array_equal(b.read("faults"), [1.0, 0.0])
    b.run(1, camera=0.0)
    np.testing.assert_array_equal(b.read("faults"), 0.0)
    b.run(1, arm=np.nan)
    np.testing.assert_array_equal(b.read("faults"), 0.0)
    b.run(3)
    np.testing.assert_array_equal(b.read("faults"), [0.0, 1.0])


@pytest.mark.parametrize(("limit", "expected"), [("both", 0.6), ("separation", 0.2), ("force", 0.6)])
def test_which_monitor_leaves_speed(limit, expected):
    b = Bench(SpeedChoice(CellSignalParameters(limit=limit)), scale_separation=0.2, scale_force=0.6)
    assert b.read("speed_scale") == expected
    with pytest.raises(UnknownNameError, match="force"):
        CellSignalParameters(limit="none")


def test_a_share_of_a_velocity_is_never_more_than_it():
    b = Bench(ScaledVelocity(2), velocity_commanded=[1.0, -2.0], speed_limit=0.5)
    np.testing.assert_array_equal(b.read("velocity_applied"), [0.5, -1.0])
    for limit, expected in ((3.0, [1.0, -2.0]), (-1.0, [0.0, 0.0]), (np.nan, [0.0, 0.0])):
        b.set(speed_limit=limit)
        np.testing.assert_array_equal(b.read("velocity_applied"), expected)
    b.set(velocity_commanded=[np.nan, 1.0], speed_limit=1.0)
    np.testing.assert_array_equal(b.read("velocity_applied"), 0.0)
