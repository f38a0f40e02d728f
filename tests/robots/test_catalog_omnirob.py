"""The omniRob against the Denavit-Hartenberg table of the published problem."""

import numpy as np
import pytest
from experiments.nmpc.jobs import OMNIROB_POINTS
from pydrake.multibody.plant import MultibodyPlant

from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics

MOUNT = [0.25, 0.0, 0.70]
D = [0.3105, 0.0, 0.4, 0.0, 0.39, 0.0, 0.078]
ALPHA = np.deg2rad([90, -90, -90, 90, 90, -90, 0])
# Frame (0: platform, i: after DH joint i) and offset of each test point, as the published problem has them.
POINTS = {
    "platform_front": (0, [0.3, 0, 0.35]),
    "platform_rear": (0, [-0.3, 0, 0.35]),
    "shoulder": (1, [0, 0, 0]),
    "upper_arm": (2, [0, 0, 0.2]),
    "elbow": (3, [0, 0, 0]),
    "forearm_1": (4, [0, 0, 0.13]),
    "forearm_2": (4, [0, 0, 0.26]),
    "wrist": (5, [0, 0, 0]),
    "hand": (6, [0, 0, 0.04]),
    "flange": (7, [0, 0, 0]),
}


def turn_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0, 0.0], [s, c, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def dh_frames(q):
    """Poses (8, 4, 4) of the platform and of the seven Denavit-Hartenberg frames."""
    X = turn_z(q[2])
    X[:2, 3] = q[:2]
    frames = [X]
    mount = np.eye(4)
    mount[:3, 3] = MOUNT
    X = X @ mount
    for angle, d, alpha in zip(q[3:], D, ALPHA):
        c, s = np.cos(alpha), np.sin(alpha)
        X = X @ turn_z(angle) @ np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, d], [0, 0, 0, 1.0]])
        frames.append(X)
    return np.array(frames)


@pytest.fixture(scope="module")
def omnirob():
    return catalog.omnirob()


@pytest.fixture(scope="module")
def postures(omnirob):
    return np.random.default_rng(0).uniform(-3.0, 3.0, (50, omnirob.n))


def test_flange_is_where_the_table_has_it(omnirob, postures):
    """The pose of the last link equals that of the table's last frame."""
    link = omnirob.link_index("link_7")
    for q in postures:
        terms, frames = evaluate_dynamics(omnirob, q, np.zeros(omnirob.n)), dh_frames(q)
        np.testing.assert_allclose(terms.p_WL[link], frames[7, :3, 3], atol=1e-12)
        np.testing.assert_allclose(terms.R_WL[link], frames[7, :3, :3], atol=1e-12)


def test_test_points_are_where_the_problem_has_them(omnirob, postures):
    """Every test point, given in a link frame, is the same point as in the problem's own frames."""
    assert [point.name for point in OMNIROB_POINTS] == list(POINTS)
    for q in postures:
        terms, frames = evaluate_dynamics(omnirob, q, np.zeros(omnirob.n)), dh_frames(q)
        for point in OMNIROB_POINTS:
            link, (frame, offset) = omnirob.link_index(point.frame), POINTS[point.name]
            mine = terms.p_WL[link] + terms.R_WL[link] @ np.array(point.p_FC)
            np.testing.assert_allclose(mine, frames[frame, :3, :3] @ offset + frames[frame, :3, 3], atol=1e-12)


def test_limits_are_those_of_the_sources(omnirob):
    """The platform has speed and force limits and no position limits; the arm has those of the LWR4."""
    assert omnirob.joint_names[:3] == ("px", "py", "pz")
    np.testing.assert_array_equal(omnirob.v_max[:3], [0.5, 0.5, 0.6])
    np.testing.assert_allclose(omnirob.v_max[3:], np.deg2rad([110, 110, 128, 128, 204, 184, 184]), atol=1e-12)
    assert np.all(np.isinf(omnirob.q_min[:3])) and np.all(np.isinf(omnirob.q_max[:3]))
    np.testing.assert_allclose(omnirob.q_max[3:], np.deg2rad([170, 120, 170, 120, 170, 120, 170]), atol=1e-12)
    assert np.all(np.isfinite(omnirob.tau_max))


def test_whole_mass_moves_with_the_platform(omnirob, lwr4):
    """The platform's inertia along x and y is the mass of all links; its arm weighs what the LWR4 weighs."""
    plant = MultibodyPlant(0.0)
    instance = omnirob.add_to(plant)
    plant.Finalize()
    mass = plant.CalcTotalMass(plant.CreateDefaultContext(), [instance])
    M = evaluate_dynamics(omnirob, omnirob.home, np.zeros(omnirob.n)).M
    np.testing.assert_allclose(M[:2, :2], mass * np.eye(2), atol=1e-9)
    gravity = evaluate_dynamics(lwr4, lwr4.home, np.zeros(7)).g
    np.testing.assert_allclose(evaluate_dynamics(omnirob, omnirob.home, np.zeros(10)).g[3:], gravity, atol=1e-9)
