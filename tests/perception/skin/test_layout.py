"""The skin's geometry: planes and cylinders, on the link's surface, and what is refused."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.perception.skin.layout import OPPOSITE, SkinLayout, SkinLayoutParameters, neighbour_table
from saphari_drake.robots import catalog


@pytest.mark.parametrize("radius", [0.02, 0.065, 0.5, np.inf])
def test_surface_and_coordinates_are_inverse_and_frames_are_tangent(lwr4, radius):
    """(u, v) → point → (u, v) is the identity; ∂p/∂u and ∂p/∂v are x and y of the frame; z is their product."""
    layout = SkinLayout(lwr4, SkinLayoutParameters(curvature_radius=radius, surface_tolerance=np.inf))
    rng = np.random.default_rng(0)
    uv = rng.uniform(-1.0, 1.0, (50, 2)) * layout.extent
    p_L, R_L = layout.surface(uv)
    back, height = layout.coordinates(p_L)
    np.testing.assert_allclose(back, uv, atol=1e-12)
    np.testing.assert_allclose(height, 0.0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("kij,kil->kjl", R_L, R_L), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R_L), 1.0)
    for axis in range(2):
        step = 1e-6 * np.eye(2)[axis]
        slope = (layout.surface(uv + step)[0] - layout.surface(uv - step)[0]) / 2e-6
        np.testing.assert_allclose(slope, R_L[:, :, axis], atol=1e-7)
    lifted, height = layout.coordinates(p_L + 0.004 * R_L[:, :, 2])
    np.testing.assert_allclose(lifted, uv, atol=1e-12)
    np.testing.assert_allclose(height, 0.004, atol=1e-12)


def test_the_default_patch_lies_on_the_side_of_the_upper_arm(lwr4):
    layout = SkinLayout(lwr4)
    assert (layout.link, layout.link_name, layout.count) == (2, "link_3", 36)
    np.testing.assert_allclose(layout.surface_distance(lwr4), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.hypot(layout.p_LM[:, 0], layout.p_LM[:, 1]), 0.065)
    np.testing.assert_allclose(layout.n_L[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(layout.p_LM.mean(axis=0)[[0, 2]], [0.0, 0.1], atol=1e-12)


def test_neighbours_along_the_surface_are_one_pitch_apart(lwr4):
    layout = SkinLayout(lwr4, SkinLayoutParameters(rows=4, columns=5))
    table = neighbour_table(4, 5)
    for i, row in enumerate(table):
        for k, j in enumerate(row):
            if j >= 0:
                step = np.abs(layout.uv[j] - layout.uv[i]) / layout.pitch
                np.testing.assert_allclose(sorted(step), [0.0, 1.0] if k < 4 else [1.0, 1.0], atol=1e-9)
                assert table[j, OPPOSITE[k]] == i
    assert np.sum(table >= 0) == 2 * (4 * 4 + 5 * 3 + 2 * 3 * 4)


def test_the_pose_of_the_base_does_not_matter():
    moved = SkinLayout(catalog.lwr4(RigidTransform([0.3, -0.2, 0.5])))
    np.testing.assert_allclose(moved.p_LM, SkinLayout(catalog.lwr4()).p_LM)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"curvature_radius": 0.0199}, "curvature_radius"),
        ({"curvature_radius": -0.065}, "curvature_radius"),
        ({"curvature_radius": np.nan}, "curvature_radius"),
        ({"rows": 1}, "rows"),
        ({"pitch": 0.0}, "pitch"),
        ({"columns": 60}, "columns"),
        ({"normal": [0.0, 0.0, 2.0]}, "axis"),
        ({"centre": [0.0, np.inf, 0.0]}, "centre"),
        ({"surface_tolerance": 0.0}, "surface_tolerance"),
    ],
)
def test_bad_parameters_are_named(change, field):
    with pytest.raises(ParameterError, match=field):
        SkinLayoutParameters(**change)


def test_a_patch_off_the_surface_is_told(lwr4):
    with pytest.raises(ParameterError, match=r"off the collision surface of link_3"):
        SkinLayout(lwr4, SkinLayoutParameters(centre=[0.0, 0.08, 0.1]))
    with pytest.raises(ParameterError, match=r"mm off"):
        SkinLayout(lwr4, SkinLayoutParameters(curvature_radius=np.inf))
    with pytest.raises(UnknownNameError, match="link_3"):
        SkinLayout(lwr4, SkinLayoutParameters(frame="elbow"))
    with pytest.raises(ParameterError, match="fixed in the world"):
        SkinLayout(lwr4, SkinLayoutParameters(frame="base"))
