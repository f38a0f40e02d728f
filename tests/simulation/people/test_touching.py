"""Contact with a person's capsules: nearest points, forces that push apart, and giving way."""

import numpy as np

from saphari_drake.safety.nearness import pair, posed, surface_of
from saphari_drake.simulation.people.touching import Flesh, given_way, nearest_on_segment, touches


def flesh(count=1, **changes):
    values = {"radius": 0.04, "stiffness": 1e4, "mass": 1.0, "hold": 500.0, "damping": 40.0} | changes
    return Flesh(*(np.full(count, value) for value in values.values()), 0.0)


def test_the_nearest_point_is_no_farther_than_any_other(lwr4):
    rng, surface = np.random.default_rng(0), surface_of(lwr4)
    poses, p = posed(surface, lwr4.kinematics(lwr4.home).motion), np.empty(3)
    for s in range(len(surface.link)):
        a, b = rng.uniform(-1, 1, (2, 3))
        nearest_on_segment(surface, poses, s, a, b, p)
        others = [pair(surface, poses, s, a + x * (b - a))[0] for x in np.linspace(0, 1, 60)]
        assert pair(surface, poses, s, p)[0] <= min(others) + 1e-3


def pressed(lwr4, depth):
    """A short limb beside the flange, so deep in it."""
    motion = lwr4.kinematics(lwr4.home).motion
    middle = lwr4.kinematics(lwr4.home).p_WL[6] + [0.0, 0.04 + 0.04 - depth, 0.0]
    ends = np.array([[middle - [0.02, 0.0, 0.0], middle + [0.02, 0.0, 0.0]]])
    return touches(surface_of(lwr4), motion, ends, np.zeros((1, 2, 3)), flesh())


def test_a_contact_pushes_apart_as_a_spring(lwr4):
    """Deeper is harder, by the stiffness; apart there is nothing."""
    found = [pressed(lwr4, depth) for depth in (0.0, 0.003)]
    for force, _, link, gap in found:
        np.testing.assert_allclose(np.linalg.norm(force), 1e4 * max(-gap[0], 0.0), rtol=1e-6)
        assert force[0, 1] < 0.0 and link[0] in (5, 6)
    assert found[1][3][0] < found[0][3][0]
    apart = pressed(lwr4, -0.05)
    assert np.linalg.norm(apart[0]) == 0.0 and apart[2][0] == -1 and 0.0 < apart[3][0] < 0.05


def test_a_segment_gives_way_to_where_its_spring_holds_the_force():
    x, v, rest = np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3))
    for _ in range(5000):
        given_way(x, v, np.array([[0.0, -10.0, 0.0]]), rest, flesh(), 0.001)
    np.testing.assert_allclose(x, [[0.0, 10.0 / 500.0, 0.0]], atol=1e-6)
