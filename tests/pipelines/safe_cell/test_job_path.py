"""A job is resumed where it was left, and waits for the arm."""

import numpy as np
import pytest
from bench import Bench

from saphari_drake.errors import ParameterError
from saphari_drake.pipelines.safe_cell.job_path import Job, JobPath
from saphari_drake.robots.dynamics import evaluate_dynamics

T = 0.1


@pytest.fixture(scope="module")
def rig(lwr4):
    terms = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7))
    start = terms.p_WL[6]
    job = Job("link_7", lambda time: (np.eye(3), start + [0.01 * time, 0.0, 0.0]), 3.0)
    return JobPath(lwr4, job, T, 5), terms


@pytest.fixture
def b(rig):
    return Bench(rig[0], dynamics=rig[1], speed_limit=1.0)


def test_it_goes_on_from_where_it_was(b):
    b.run(100)
    done = b.read("progress")
    assert 0.45 < done <= 0.5
    b.run(200, speed_limit=0.0)
    assert b.read("progress") == done
    p = b.read("reference").p_WE
    np.testing.assert_array_equal(p, np.tile(p[0], (len(p), 1)))
    b.run(100, speed_limit=1.0)
    assert b.read("progress") == pytest.approx(done + 0.5, abs=0.05)


def test_the_reference_looks_ahead_as_fast_as_it_may(b):
    b.run(101, speed_limit=0.5)
    p = b.read("reference").p_WE
    assert len(p) == 7
    np.testing.assert_allclose(np.diff(p[:, 0]), 0.5 * T * 0.01, rtol=0.1)


def test_it_waits_for_an_arm_that_lags_or_is_not_known(b, lwr4):
    b.run(20)
    done = b.read("progress")
    b.run(100, dynamics=evaluate_dynamics(lwr4, lwr4.home + 0.3, np.zeros(7)))
    assert b.read("progress") == pytest.approx(done, abs=0.1)
    stays = b.read("progress")
    b.run(100, dynamics=evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).unknown())
    assert b.read("progress") == stays
    b.run(100, speed_limit=np.nan)
    assert b.read("progress") == stays


def test_it_ends(b):
    b.run(1000)
    assert b.read("progress") == pytest.approx(3.0)


def test_a_lag_that_cannot_be_used_is_told(lwr4, rig):
    with pytest.raises(ParameterError, match="lag"):
        JobPath(lwr4, rig[0]._job, T, 5, lag=0.0)
