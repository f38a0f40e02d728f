"""How far readings are from the robot: the compiled pass against exact distances, and defined everywhere."""

import numpy as np
import pytest
from camera_scene import HandScene, noisy, place_finder

from saphari_drake.math.primitives import BOX, CAPSULE, CYLINDER, Primitives, surface_point
from saphari_drake.perception.segmentation.distances import BORDER, _shape_row


@pytest.mark.parametrize("kind", [CAPSULE, CYLINDER, BOX])
def test_row_kernel_equals_exact_distances(kind):
    rng = np.random.default_rng(kind)
    size, z = np.array([0.07, 0.12, 0.05]), rng.uniform(1.0, 2.0, 400).astype(np.float32)
    x, y = rng.uniform(-0.3, 0.3, 400).astype(np.float32), np.float32(0.07)
    R, p = np.linalg.qr(rng.normal(size=(3, 3)))[0], np.array([0.02, 0.1, 1.5])
    R *= np.linalg.det(R)
    best, owner = np.full(400, np.inf, np.float32), np.full(400, -1, np.int32)
    shapes = Primitives(*(np.array([value] * 4) for value in (kind, size, 0, R, p)))
    _shape_row(shapes, 3, z, x, y, best, owner)
    exact = [surface_point(kind, size, R, p, np.array([a * c, y * c, c], dtype=float))[0] for a, c in zip(x, z)]
    np.testing.assert_allclose(best, exact, atol=2e-6)
    assert np.all(owner == 3)


def test_no_pixel_without_foreground_has_a_distance():
    """Holes, NaN, background and what no silhouette covers: +inf, no owner, in no mask."""
    scene = HandScene(radius=0.010)
    camera = place_finder(scene).camera
    touch = scene.random_touch(np.random.default_rng(3))
    image = noisy(scene.image(touch.q, touch), 1)
    rng = np.random.default_rng(5)
    image[rng.random(image.shape) < 0.2] = 0.0
    image[rng.random(image.shape) < 0.1] = np.nan
    camera.limit[rng.random(image.shape) < 0.2] = 0.5
    _, region, near = camera.measured(image, touch.R_WL, touch.p_WL, camera.tuning)
    rows, cols = slice(region.r0, region.r1), slice(region.c0, region.c1)
    foreground = (image > 0.0)[rows, cols] & (image < camera.limit)[rows, cols]
    assert 0.1 < foreground.mean() < 0.9
    assert np.all(np.isinf(near.best[~foreground]))
    assert np.all(near.owner[~foreground] == -1)
    for mask in (near.weak, near.strong):
        assert not mask[BORDER:-BORDER, BORDER:-BORDER][~foreground].any()
    assert np.isfinite(near.best[foreground]).mean() > 0.2
    np.testing.assert_array_equal(near.owner >= 0, np.isfinite(near.best))
