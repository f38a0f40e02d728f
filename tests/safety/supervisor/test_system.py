"""The supervisor as a system: its ports, what is not finite, its Context, and the choice of the torque."""

import numpy as np
import pytest
from bench import Bench

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.messages import CommandMode, Selection
from saphari_drake.safety.supervisor.law import CellState, Event
from saphari_drake.safety.supervisor.parameters import SupervisorParameters
from saphari_drake.safety.supervisor.system import CONTACT, GUIDING, JOB, Supervisor, TorqueChoice


def working(**params):
    """Return a bench of a supervisor at work, which has two statuses to watch."""
    b = Bench(
        Supervisor(SupervisorParameters(fault_names=["camera", "arm"], **params)), speed_scale=1.0, faults=[0.0, 0.0]
    )
    b.run(80)
    assert b.read("state") == CellState.FREE
    return b


def test_it_says_whose_torque_is_taken():
    b = working()
    assert (b.read("source"), b.read("selection").mode, b.read("speed_limit")) == (JOB, CommandMode.PASS, 1.0)
    own = Selection(CommandMode.YIELD, np.ones(7), (3,))
    b.run(6, touched=1.0, contact_selection=own)
    assert b.read("source") == CONTACT and b.read("speed_limit") == 0.0
    assert b.read("selection").mode == CommandMode.YIELD and b.read("selection").key == (CellState.CONTACT, 3)
    b.run(60, taken=1.0)
    assert b.read("source") == GUIDING and b.read("selection").mode == CommandMode.PASS
    b.run(200, touched=0.0, taken=0.0)
    assert b.read("source") == JOB and b.read("state") == CellState.FREE


def test_the_limit_acts_in_the_next_cycle():
    b = working()
    b.run(1, speed_scale=0.3)
    assert b.read("speed_limit") == 0.3
    assert b.read("state") == CellState.SLOWED and b.read("reason") == Event.NEAR


def test_each_law_hands_over():
    """Keys differ wherever the torque comes from another source."""
    b = working()
    keys = [b.read("selection").key]
    b.run(6, touched=1.0)
    keys.append(b.read("selection").key)
    b.run(60, taken=1.0)
    keys.append(b.read("selection").key)
    assert len(set(keys)) == 3


@pytest.mark.parametrize("port", ["speed_scale", "touched", "taken", "faults", "recover"])
def test_what_is_not_finite_is_a_fault(port):
    b = working()
    b.run(1, **{port: [0.0, np.nan] if port == "faults" else np.nan})
    assert b.read("state") == CellState.FAULT and b.read("selection").mode == CommandMode.BRAKE
    assert b.read("fault") == (1 if port == "faults" else 2)
    assert b.read("speed_limit") == 0.0
    b.run(1, **{port: [0.0, 0.0] if port == "faults" else 1.0 if port == "speed_scale" else 0.0})
    b.run(300)
    assert b.read("state") == CellState.FAULT, "recovery is explicit"
    b.run(100, recover=1.0)
    assert b.read("state") == CellState.FREE


def test_a_touch_can_be_answered_by_a_stop():
    b = working(answer="stop")
    b.run(6, touched=1.0)
    assert b.read("selection").mode == CommandMode.BRAKE


def test_a_clone_of_the_context_goes_its_own_way():
    b = working()
    other = b.clone()
    b.run(6, touched=1.0)
    assert (b.read("state"), other.read("state")) == (CellState.CONTACT, CellState.FREE)
    other.run(6)
    assert other.read("time_in_state") > 0.0 and other.read("state") == CellState.FREE


def test_the_torque_is_that_of_the_source():
    torques = {name: np.full(2, k) for k, name in enumerate(("torque_job", "torque_contact"))}
    b = Bench(TorqueChoice(2), source=0.0, **torques)
    for source, expected in ((0.0, 0.0), (1.0, 1.0), (2.0, np.nan), (7.0, np.nan), (np.nan, np.nan)):
        b.set(source=source)
        np.testing.assert_array_equal(b.read("torque_commanded"), np.full(2, expected))


def test_numbers_that_cannot_be_used_are_named():
    for name, value in (("slow_below", 0.999), ("touch_time", -1.0), ("stop_below", 0.5)):
        with pytest.raises(ParameterError, match=name):
            SupervisorParameters(**{name: value})
    with pytest.raises(UnknownNameError, match="comply"):
        SupervisorParameters(answer="run")
