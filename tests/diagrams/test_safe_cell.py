"""The safe cell from sensors to torque: it starts, is told what its cameras see, and works."""

import numpy as np
import pytest
from experiments.cell.build import build_cell
from experiments.cell.scenario import CellScenario

from saphari_drake.safety.supervisor.law import CellState
from saphari_drake.simulation.runner.simulation import Simulation


@pytest.fixture(scope="module")
def started():
    scenario = CellScenario()
    rig = build_cell(scenario)
    run = Simulation(rig.diagram)
    run.to(0.5)
    return rig, run.log(rig.fast), run.log(rig.slow)


def test_it_goes_to_work_when_all_sensors_tell_something(started):
    rig, fast, slow = started
    assert fast["state"][-1, 0] == CellState.FREE and np.all(fast["fault"] == -1.0)
    assert slow["progress"][-1, 0] > 0.05
    assert np.all(np.abs(fast["torque"]) <= rig.robot.tau_max)


def test_the_person_is_seen_where_it_is(started):
    """The cameras' separation is about the true distance of a person who stands two metres away."""
    rig, _, slow = started
    ends, q = slow["ends"][-1].reshape(-1, 3), slow["position"][-1]
    shapes = rig.robot.kinematics(q).p_WL
    true = np.linalg.norm(shapes[:, None] - ends[None], axis=2).min()
    assert slow["people_seen"][-1, 0] > 10
    assert abs(slow["separation"][-1, 0] - true) < 0.35


@pytest.mark.parametrize("fault", ["encoder_freeze", "torque_stuck"])
def test_a_joint_that_is_not_what_it_seems_brakes_all_within_their_limits(fault):
    """The servo would drive on a joint whose encoder reads that it stands; second encoders and torque sensors tell."""
    rig = build_cell(CellScenario(faults=[fault], fault_time=1.2))
    run = Simulation(rig.diagram)
    run.to(1.8)
    fast = run.log(rig.fast)
    share = np.abs(fast["velocity"]) / rig.robot.v_max
    assert share[fast.time < 1.2, 0].max() > 0.05  # it moved
    assert share.max() <= 1.0
    assert share[-1].max() < 1e-3 and fast["state"][-1, 0] == CellState.FAULT
