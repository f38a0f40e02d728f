"""Distances to primitives, against Drake's own distance queries and by their properties."""

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    GeometryInstance,
    ProximityProperties,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw

from saphari_drake.math.primitives import (
    BOX,
    CAPSULE,
    CYLINDER,
    bounding_capsules,
    nearest_surface_point,
    surface_point,
)

POSE = RigidTransform(RollPitchYaw(0.4, -0.7, 1.1), [0.3, -0.2, 0.5])
SHAPES = {
    "sphere": (CAPSULE, [0.07, 0.0, 0.0], Sphere(0.07)),
    "capsule": (CAPSULE, [0.06, 0.1, 0.0], Capsule(0.06, 0.2)),
    "cylinder": (CYLINDER, [0.08, 0.05, 0.0], Cylinder(0.08, 0.1)),
    "flat cylinder": (CYLINDER, [0.04, 0.015, 0.0], Cylinder(0.04, 0.03)),
    "box": (BOX, [0.1, 0.05, 0.2], Box(0.2, 0.1, 0.4)),
}


def project(name, point):
    kind, size, _ = SHAPES[name]
    return surface_point(kind, np.array(size), POSE.rotation().matrix(), POSE.translation(), point)


def random_points(count, seed=0):
    return POSE.translation() + np.random.default_rng(seed).uniform(-0.3, 0.3, (count, 3))


@pytest.mark.parametrize("name", SHAPES)
def test_distance_and_projection_equal_drakes(name):
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("test")
    instance = GeometryInstance(POSE, SHAPES[name][2], "shape")
    instance.set_proximity_properties(ProximityProperties())
    scene_graph.RegisterAnchoredGeometry(source, instance)
    query = scene_graph.get_query_output_port().Eval(scene_graph.CreateDefaultContext())
    for point in random_points(300):
        distance, nearest, normal = project(name, point)
        (expected,) = query.ComputeSignedDistanceToPoint(point)
        assert distance == pytest.approx(expected.distance, abs=1e-9)
        p_WN = POSE @ expected.p_GN
        np.testing.assert_allclose(nearest, p_WN, atol=1e-7)
        np.testing.assert_allclose(normal, expected.grad_W, atol=1e-6)


@pytest.mark.parametrize("name", SHAPES)
def test_projection_is_on_the_surface_and_normal_leads_to_the_point(name):
    for point in random_points(300, seed=1):
        distance, nearest, normal = project(name, point)
        np.testing.assert_allclose(nearest + distance * normal, point, atol=1e-12)
        assert abs(project(name, nearest)[0]) < 1e-12
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        assert project(name, nearest + 1e-6 * normal)[0] == pytest.approx(1e-6, abs=1e-12)


@pytest.mark.parametrize("name", SHAPES)
def test_centre_gives_a_finite_answer(name):
    distance, nearest, normal = project(name, POSE.translation())
    assert distance < 0.0
    assert np.all(np.isfinite(nearest))
    assert np.linalg.norm(normal) == pytest.approx(1.0)


def test_nearest_surface_point_counts_the_chosen_shapes_only():
    kind = np.array([CAPSULE, BOX])
    size = np.array([[0.1, 0.0, 0.0], [0.1, 0.1, 0.1]])
    R = np.stack([np.eye(3)] * 2)
    p = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    point = np.array([0.3, 0.0, 0.0])
    assert nearest_surface_point(kind, size, R, p, np.array([True, True]), point)[0] == 0
    shape, distance, nearest, normal = nearest_surface_point(kind, size, R, p, np.array([False, True]), point)
    assert (shape, distance) == (1, pytest.approx(0.6))
    np.testing.assert_allclose(nearest, [0.9, 0.0, 0.0])
    np.testing.assert_allclose(normal, [-1.0, 0.0, 0.0])
    assert nearest_surface_point(kind, size, R, p, np.array([False, False]), point)[0] == -1


def test_bounding_capsules_contain_the_shapes():
    names = list(SHAPES)
    kind = np.array([SHAPES[name][0] for name in names])
    size = np.array([SHAPES[name][1] for name in names])
    radius, half, axis = bounding_capsules(kind, size)
    for s, name in enumerate(names):
        for point in random_points(200, seed=2):
            _, nearest, _ = project(name, point)
            local = POSE.inverse() @ nearest
            along = np.clip(local[axis[s]], -half[s], half[s])
            local[axis[s]] -= along
            assert np.linalg.norm(local) <= radius[s] + 1e-12
