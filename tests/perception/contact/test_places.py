"""Places where a person is near: against the plain twin and the known contact."""

import numpy as np
import pytest
from camera_scene import HandScene, likeliest, noisy, place_finder
from scipy import ndimage

from saphari_drake.math.primitives import CAPSULE, CYLINDER, surface_point
from saphari_drake.perception.camera.model import camera_pose, ray_tables


@pytest.fixture(scope="module")
def scene():
    return HandScene(radius=0.010)


@pytest.fixture(scope="module")
def finder(scene):
    return place_finder(scene)


# ---- the plain twin ------------------------------------------------------------------------------------------------


def distances_twin(shapes, R, p, points):
    """Distances (points, shapes) in float64, from textbook formulas."""
    columns = []
    for s in range(shapes.count):
        local = (points - p[s]) @ R[s]
        size = shapes.size[s]
        if shapes.kind[s] == CAPSULE:
            local[:, 2] -= np.clip(local[:, 2], -size[1], size[1])
            columns.append(np.linalg.norm(local, axis=1) - size[0])
            continue
        if shapes.kind[s] == CYLINDER:
            q = np.column_stack([np.hypot(local[:, 0], local[:, 1]) - size[0], np.abs(local[:, 2]) - size[1]])
        else:
            q = np.abs(local) - size
        columns.append(np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0))
    return np.column_stack(columns)


def localize_twin(shapes, camera, params, depth, background, R_WL, p_WL):
    """Link, distance and surface point in the link, without region, float32 or compiled code."""
    X_WC = camera_pose(camera)
    valid = (depth > 0.0) & np.isfinite(depth)
    z = np.where(valid, depth, 1.0).astype(float)
    margin = params.background_margin * np.maximum((background / params.scale_depth) ** 2, params.least_scale)
    limit = np.full(depth.shape, np.inf)
    np.subtract(background, margin, out=limit, where=np.isfinite(background))
    valid &= z < limit
    x, y = ray_tables(camera)
    points = np.stack([x * z, y[:, None] * z, z], axis=-1)[valid] @ X_WC.rotation().matrix().T + X_WC.translation()
    R, p = shapes.in_world(R_WL, p_WL)
    to_shapes = distances_twin(shapes, R, p, points)
    d, owner = np.full(depth.shape, np.nan), np.full(depth.shape, -1)
    d[valid], owner[valid] = to_shapes.min(axis=1), to_shapes.argmin(axis=1)
    scale = np.maximum((z / params.scale_depth) ** 2, params.least_scale)
    strong = valid & (d > params.seed_distance * scale)
    human = valid & (d > params.grow_distance * scale) & ndimage.maximum_filter(strong, 9, mode="constant")
    depths = np.pad(np.where(human, z, np.inf), 2, constant_values=np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(depths, (5, 5))
    alike = np.abs(windows - z[..., None, None]) < params.support_step * scale[..., None, None]
    human &= (alike.sum(axis=(2, 3)) >= params.support) | (d > params.reach)
    labels, _ = ndimage.label(human, np.ones((3, 3)))
    human &= np.bincount(labels.ravel())[labels] >= params.component
    human &= (d < params.reach) & (shapes.link[owner] >= 0)
    index = np.flatnonzero(human[valid])
    if len(index) < params.rank:
        return -1, np.inf, None
    distance, points, owner = d[valid][index], points[index], owner[valid][index]
    order = np.argsort(distance, kind="stable")
    anchor = order[params.rank - 1]
    link = shapes.link[owner[anchor]]
    projections = np.array(
        [surface_point(shapes.kind[s], shapes.size[s], R[s], p[s], a)[1] for s, a in zip(owner, points)]
    )
    weight = np.exp(-np.maximum(distance - distance[anchor], 0.0) / params.softness)
    weight[shapes.link[owner] != link] = 0.0
    weight[distance >= distance[anchor] + 6.0 * params.softness] = 0.0
    weight[np.linalg.norm(projections - projections[anchor], axis=1) >= params.spread] = 0.0
    mean = weight @ projections / weight.sum()
    ray = (mean - X_WC.translation()) / np.linalg.norm(mean - X_WC.translation())

    def on_link(point):
        found = [
            surface_point(shapes.kind[s], shapes.size[s], R[s], p[s], point)
            for s in np.flatnonzero(shapes.link == link)
        ]
        return min(found, key=lambda entry: entry[0])[1:]

    surface, normal = on_link(mean)
    across = np.cross(normal, ray) / np.linalg.norm(np.cross(normal, ray))
    width = np.std(projections[weight > 0.0] @ across)
    behind = np.clip(params.thickness * width, params.least_thickness, params.most_thickness)
    surface, _ = on_link(surface + behind * (ray - (ray @ normal) * normal))
    return link, distance[anchor], R_WL[link].T @ (surface - p_WL[link])


@pytest.mark.parametrize("seed", range(6))
def test_kernels_equal_the_plain_twin(scene, finder, seed):
    touch = scene.random_touch(np.random.default_rng(100 + seed))
    image = scene.image(touch.q, touch)
    image = noisy(image, seed) if seed % 2 else image
    result = finder.look(image, touch.R_WL, touch.p_WL).places[0]  # as something thin
    everywhere = np.full(image.shape, np.inf)
    link, distance, p_LC = localize_twin(
        scene.robot.shapes, scene.camera, finder.params, image, everywhere, touch.R_WL, touch.p_WL
    )
    assert result.link == link
    assert result.distance == pytest.approx(distance, abs=1e-5)
    np.testing.assert_allclose(result.p_LC, p_LC, atol=1e-4)


# ---- physical truth ------------------------------------------------------------------------------------------------


def test_noisy_touches_are_found_within_a_centimetre(scene, finder):
    rng = np.random.default_rng(7)
    errors, right, found = [], [], []
    for seed in range(20):
        touch = scene.random_touch(rng)
        result, error = likeliest(finder, noisy(scene.image(touch.q, touch), seed), touch)
        errors.append(error)
        right.append(result.link == touch.link)
        found.append(result.distance < finder.params.gate)
    assert np.median(errors) < 0.007
    assert np.quantile(errors, 0.9) < 0.015
    assert np.mean(right) >= 0.9
    assert np.mean(found) >= 0.9


def test_exact_images_of_a_fine_finger_give_the_point_within_3_mm():
    scene = HandScene(radius=0.008)
    finder = place_finder(scene)
    rng = np.random.default_rng(11)
    errors = []
    for _ in range(12):
        touch = scene.random_touch(rng)
        result, error = likeliest(finder, scene.image(touch.q, touch), touch)
        assert result.link == touch.link
        errors.append(error)
    assert np.median(errors) < 0.003


def test_result_is_on_the_surface_with_its_normal(scene, finder):
    touch = scene.random_touch(np.random.default_rng(5))
    result, _ = likeliest(finder, scene.image(touch.q, touch), touch)
    p_LC, n_L = scene.robot.shapes.nearest_on(result.link, result.p_LC + 0.01 * result.n_L)
    np.testing.assert_allclose(p_LC, result.p_LC, atol=1e-9)
    np.testing.assert_allclose(n_L, result.n_L, atol=1e-9)
    assert n_L @ (touch.R_WL[result.link].T @ touch.n_W) > 0.95


def test_nobody_is_seen_without_a_person(scene, finder):
    rng = np.random.default_rng(2)
    for seed in range(5):
        q = scene.robot.home + rng.uniform(-0.5, 0.5, scene.robot.n)
        view = finder.look(noisy(scene.image(q), seed), *scene.poses(q))
        assert all(place.distance >= finder.params.gate for place in view.places)
        assert view.person.seen > 0.8
