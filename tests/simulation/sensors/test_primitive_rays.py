"""Depths along rays: hits lie on a surface, nothing nearer is missed, and looking at fewer pixels changes nothing."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from saphari_drake.math.primitives import BOX, CAPSULE, CYLINDER, Primitives, bounding_capsules, surface_point
from saphari_drake.perception.camera.model import Pinhole
from saphari_drake.perception.segmentation.regions import region_near
from saphari_drake.simulation.sensors.primitive_rays import ELLIPSOID, HALF_SPACE, draw, within

ROWS, COLUMNS, FOCAL = 60, 80, 70.0
X = (np.arange(COLUMNS) + 0.5 - COLUMNS / 2) / FOCAL
Y = (np.arange(ROWS) + 0.5 - ROWS / 2) / FOCAL


def shapes(rng, count=6):
    """Return random capsules, spheres, cylinders and boxes before the camera, some partly beside the image."""
    kind = rng.choice([CAPSULE, CYLINDER, BOX], count)
    size = rng.uniform(0.03, 0.3, (count, 3))
    size[(kind == CAPSULE) & (rng.random(count) < 0.3), 1] = 0.0  # a sphere
    X_CS = [
        RigidTransform(RollPitchYaw(*rng.uniform(-3, 3, 3)), [*rng.uniform(-0.8, 0.8, 2), rng.uniform(0.8, 2.5)])
        for _ in range(count)
    ]
    R = np.array([pose.rotation().matrix() for pose in X_CS])
    return kind, size, R, np.array([pose.translation() for pose in X_CS])


def drawn(kind, size, R, p, everywhere=True):
    depth = np.full((ROWS, COLUMNS), np.inf, dtype=np.float32)
    left, right = np.zeros((len(kind), ROWS), dtype=np.int64), np.full((len(kind), ROWS), COLUMNS, dtype=np.int64)
    if not everywhere:
        pinhole = Pinhole(FOCAL, FOCAL, COLUMNS / 2, ROWS / 2, X.astype(np.float32), Y.astype(np.float32))
        left, right, *_ = region_near(Primitives(kind, size, kind, R, p), bounding_capsules(kind, size), 0.0, pinhole)
    draw(depth, kind, size, R, p, left, right, X, Y)
    return depth


def signed_distance(kind, size, R, p, point):
    return min(surface_point(k, s, R_i, p_i, point)[0] for k, s, R_i, p_i in zip(kind, size, R, p))


@pytest.mark.parametrize("seed", range(6))
def test_rays_end_at_the_first_surface(seed):
    """At its depth a ray is on a surface; before it, outside of all shapes; without a hit, outside everywhere."""
    rng = np.random.default_rng(seed)
    scene = shapes(rng)
    depth = drawn(*scene)
    assert 0.1 < np.isfinite(depth).mean() < 1.0
    for r, c in zip(rng.integers(0, ROWS, 80), rng.integers(0, COLUMNS, 80)):
        ray = np.array([X[c], Y[r], 1.0])
        if np.isfinite(depth[r, c]):
            assert abs(signed_distance(*scene, depth[r, c] * ray)) < 1e-6
        end = min(float(depth[r, c]), 4.0)
        assert all(signed_distance(*scene, z * ray) > -1e-6 for z in np.linspace(0.0, end, 200)[:-1])


@pytest.mark.parametrize("seed", range(40))
def test_looking_around_the_shapes_alone_misses_nothing(seed):
    scene = shapes(np.random.default_rng(100 + seed))
    np.testing.assert_array_equal(drawn(*scene, everywhere=False), drawn(*scene))


def test_an_ellipsoid_satisfies_its_equation():
    size = np.array([[0.1, 0.25, 0.4]])
    pose = RigidTransform(RollPitchYaw(0.4, -0.9, 2.0), [0.1, -0.05, 1.2])
    R, p = np.ascontiguousarray(pose.rotation().matrix()), pose.translation()
    depth = drawn(np.array([ELLIPSOID]), size, R[None], p[None].copy())
    rays = np.stack([*np.meshgrid(X, Y), np.ones((ROWS, COLUMNS))], axis=-1)
    hit = np.isfinite(depth)
    assert hit.sum() > 300
    on_S = (depth[hit, None] * rays[hit] - p) @ R
    np.testing.assert_allclose(np.sum((on_S / size) ** 2, axis=-1), 1.0, atol=1e-5)
    assert np.all(np.sum((on_S / size**2) * (rays[hit] @ R), axis=-1) < 1e-4)  # where the ray enters


def test_a_half_space_is_seen_from_above_alone():
    down = np.diag([1.0, -1.0, -1.0])  # its z points at the camera
    size, p = np.ones((1, 3)), np.array([[0.0, 0.0, 1.5]])
    np.testing.assert_allclose(drawn(np.array([HALF_SPACE]), size, down[None], p), 1.5, atol=1e-6)
    assert np.isinf(drawn(np.array([HALF_SPACE]), size, np.eye(3)[None], p)).all()


def test_what_is_behind_the_camera_is_not_seen():
    kind, size, R, p = shapes(np.random.default_rng(3))
    p[:, 2] *= -1.0
    assert np.isinf(drawn(kind, size, R, p)).all()


def test_outside_the_range_nothing_is_read():
    """Both ends belong to it, and what is no number stays none."""
    depth = np.array([[0.1, 0.4, 1.0, 5.0, 5.1, np.inf, np.nan]], dtype=np.float32)
    within(depth, np.float32(0.4), 5.0)
    np.testing.assert_array_equal(depth, np.array([[0.0, 0.4, 1.0, 5.0, np.inf, np.inf, np.nan]], dtype=np.float32))
