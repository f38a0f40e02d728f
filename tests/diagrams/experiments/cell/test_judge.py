"""Judging a run of the safe cell: contacts and limits of a log made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from experiments.cell.judge import CellRun, hits_of
from experiments.cell.scenario import CellScenario

from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.supervisor.law import CellState
from saphari_drake.simulation.people.skeleton import SEGMENTS
from saphari_drake.simulation.record.log import Log

HAND = [segment.region for segment in SEGMENTS].index("hand")


def run_of(robot, touches, states=(), v=0.0):
    """Return a run in which the first joint turns with a speed, touched on the flange at the given samples."""
    count = 400
    log = Log(0.001 * np.arange(count))
    velocity, touch = np.zeros((count, 7)), np.tile([0.0] * 6 + [-1.0, -1.0], (count, 1))
    velocity[:, 0] = v
    p = robot.kinematics(robot.home).p_WL[6]
    for k in touches:
        touch[k] = [0.0, -20.0, 0.0, *p, 6, HAND]
    state = np.zeros(count)
    for k, value in states:
        state[k:] = value
    for name, values in (
        ("position", np.tile(robot.home, (count, 1))), ("velocity", velocity), ("torque", np.zeros((count, 7))),
        ("touch", touch), ("state", state),
    ):  # fmt: skip
        log.add(name, values)
    rig = SimpleNamespace(robot=robot, scenario=CellScenario())
    return CellRun(rig, "supervised", 0, log, log, 1.0, hits_of(rig, log))


def test_the_energy_is_that_of_the_robot_with_the_persons_share(lwr4):
    """½ μ v² with μ = (1/m_H + uᵀJM⁻¹Jᵀu)⁻¹."""
    (hit,) = run_of(lwr4, range(100, 130), v=0.8).hits
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    row = terms.point(6, np.zeros(3)).Jv_WC[1]
    mass = 1.0 / (1.0 / 0.6 + row @ np.linalg.inv(terms.M) @ row)
    assert hit.segment == "left hand" and hit.time == pytest.approx(0.1) and not hit.clamped
    np.testing.assert_allclose(hit.energy, 0.5 * mass * (0.8 * row[0]) ** 2, rtol=1e-6)
    assert (hit.limit, hit.force, hit.force_limit) == (0.49, pytest.approx(20.0), 280.0)


def test_a_robot_that_goes_away_brings_no_energy(lwr4):
    assert run_of(lwr4, [50], v=-0.8).energy_share == 0.0


def test_contacts_that_follow_at_once_are_one(lwr4):
    assert len(run_of(lwr4, [50, 60, 90]).hits) == 1
    assert len(run_of(lwr4, [50, 60, 300]).hits) == 2
    assert run_of(lwr4, []).hits == []


def test_limits_and_stops_are_counted(lwr4):
    states = ((10, CellState.STOP), (20, CellState.SLOWED), (30, CellState.CONTACT), (40, CellState.GUIDING))
    run = run_of(lwr4, [], states)
    assert run.stops == 2 and run.violations == 0
    assert run_of(lwr4, [], v=1.01 * lwr4.v_max[0]).violations == 400
