"""Where a limb points: from readings of a cylinder, against the plain twin, and what cannot be told."""

import numpy as np
import pytest

from saphari_drake.math.primitives import Primitives
from saphari_drake.perception.contact.pointing import limb_ray, ray_costs


@pytest.fixture(scope="module")
def shapes(lwr4):
    s = lwr4.shapes
    return Primitives(s.kind, s.size, np.arange(s.count), s.R_LS, s.p_LS + np.outer(np.arange(s.count), [9.0, 0, 0]))


def cylinder(rng, c, u, first, last, radius, count=80):
    """Readings of the near side of a cylinder, as a camera at the origin sees it."""
    t = np.cross(u, c)
    t /= np.linalg.norm(t)
    near = np.cross(t, u)
    near *= -np.sign(near @ c)
    angle, along = rng.uniform(-1.2, 1.2, (count, 1)), rng.uniform(first, last, (count, 1))
    return c + along * u + radius * (np.sin(angle) * t + np.cos(angle) * near) + 0.002 * rng.normal(size=(count, 3))


def test_axis_from_the_end_at_the_robot(shapes):
    rng, errors = np.random.default_rng(0), []
    for _ in range(10):
        to_robot = shapes.p[0] + rng.normal(size=3) * 0.05
        u = rng.normal(size=3)
        u /= np.linalg.norm(u)
        c = to_robot - 0.3 * u
        point = cylinder(rng, c, u, -0.15, 0.15, 0.035)
        shown, end, direction, length, radius = limb_ray(shapes, point)
        assert shown and length == pytest.approx(0.3, abs=0.03) and radius == pytest.approx(0.035, abs=0.015)
        assert np.linalg.norm(end - to_robot) < np.linalg.norm(end - direction * length - to_robot)
        errors.append(np.arccos(min(abs(direction @ u), 1.0)))
    assert np.median(errors) < 0.1


def test_a_fist_alone_or_few_readings_show_no_direction(shapes):
    rng, c = np.random.default_rng(1), shapes.p[0] + [0.1, 0.2, 0.1]
    u = np.array([1.0, 0.0, 0.0])
    assert not limb_ray(shapes, cylinder(rng, c, u, -0.02, 0.02, 0.04))[0]
    assert not limb_ray(shapes, cylinder(rng, c, u, -0.15, 0.15, 0.04, count=8))[0]
    assert not limb_ray(shapes, np.zeros((0, 3)))[0]


def test_cost_equals_its_plain_twin_and_is_bounded():
    rng = np.random.default_rng(2)
    end, u, length, radius, sigma, bend, most = (
        rng.normal(size=3),
        np.array([0.6, 0.0, 0.8]),
        0.2,
        0.03,
        0.01,
        0.2,
        12.0,
    )
    p, a = end + rng.normal(size=(400, 3)) * 0.05, rng.normal(size=(400, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    p[0] = end + 0.05 * u
    cost = ray_costs(p, a, end, u, length, radius, sigma, bend, most)
    along = (p - end) @ u
    across = np.linalg.norm(p - end - along[:, None] * u, axis=1)
    ahead = np.where(a @ u > -0.2, (across / (sigma + bend * along)) ** 2, most)
    behind = (np.maximum(across - radius, 0.0) ** 2 + np.maximum(-along - length, 0.0) ** 2) / sigma**2
    np.testing.assert_allclose(cost, np.minimum(np.where(along > 0.0, ahead, behind), most), atol=1e-9)
    assert cost.max() == most and ray_costs(p[:1], u[None], end, u, length, radius, sigma, bend, most)[0] < 1e-9
