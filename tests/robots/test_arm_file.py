"""The bare arm of a model file: no gripper's joints, capsules for meshes, packages found above the file."""

import numpy as np
import pytest
from arms import joint, link, write_urdf

from saphari_drake.errors import ModelError
from saphari_drake.robots.arm_file import arm_file
from saphari_drake.robots.mesh_primitives import fit_capsules, read_triangles
from saphari_drake.robots.model import RobotModel


def tube(radius, half, count=40):
    """Return triangles of a closed-looking capsule about z."""
    angles, heights = np.linspace(0.0, 2.0 * np.pi, count), np.linspace(-half - radius, half + radius, count)
    away = np.sqrt(np.maximum(radius**2 - np.maximum(np.abs(heights) - half, 0.0) ** 2, 0.0))
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    p = np.concatenate([away[:, None, None] * ring, np.broadcast_to(heights[:, None, None], (count, count, 1))], axis=2)
    a, b, c, d = p[:-1, :-1], p[1:, :-1], p[:-1, 1:], p[1:, 1:]
    return np.concatenate(
        [np.stack([a, b, c], axis=2).reshape(-1, 3, 3), np.stack([b, d, c], axis=2).reshape(-1, 3, 3)]
    )


def hand_on_arm(folder, geometry=""):
    """Write two joints with two fingers on them."""
    return write_urdf(
        folder, link("base"), link("upper", extra=geometry), link("palm"), link("finger_a"), link("finger_b"),
        joint("one", "base", "upper"), joint("two", "upper", "palm"),
        joint("left", "palm", "finger_a", "prismatic", "0 1 0"),
        joint("right", "palm", "finger_b", "prismatic", "0 -1 0"),
        name="handy",
    )  # fmt: skip


def test_gripper_is_held_and_its_weight_stays(tmp_path):
    path = hand_on_arm(tmp_path)
    bare, whole = RobotModel(arm_file(path)), RobotModel(path)
    assert bare.joint_names == ("one", "two") and whole.n == 4
    assert bare.tree.mass.sum() == pytest.approx(whole.tree.mass.sum())


def test_file_without_gripper_and_meshes_is_itself(tmp_path):
    path = write_urdf(tmp_path, link("base"), link("a"), joint("one", "base", "a"))
    assert arm_file(path) == path


def test_mesh_becomes_the_capsule_it_has_the_shape_of(tmp_path):
    (tmp_path / "pkg").mkdir()
    triangles = tube(0.05, 0.15)
    corners = "".join("facet normal 0 0 1\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in t) +
                      "endloop\nendfacet\n" for t in triangles)  # fmt: skip
    (tmp_path / "pkg" / "tube.stl").write_text(f"solid tube\n{corners}endsolid tube\n")
    mesh = '<origin xyz="0.1 0 0.3" rpy="0 0.4 0"/><geometry><mesh filename="package://pkg/tube.stl"/></geometry>'
    robot = RobotModel(arm_file(hand_on_arm(tmp_path, f"<collision>{mesh}</collision>")))
    shapes = robot.shapes
    assert shapes.count == 1 and shapes.link[0] == 0
    # The last 3 % of the surface at each end are left out.
    np.testing.assert_allclose(shapes.size[0, :2], [0.05, 0.15], atol=0.016)
    np.testing.assert_allclose(shapes.p_LS[0], [0.1, 0.0, 0.3], atol=0.003)
    assert abs(shapes.R_LS[0][:, 2] @ [np.sin(0.4), 0.0, np.cos(0.4)]) > 0.999


def test_capsules_hold_the_surface():
    corner = np.concatenate([tube(0.04, 0.2), tube(0.04, 0.2)[..., [2, 0, 1]] + [0.2, 0.0, 0.2]])
    capsules = fit_capsules(corner)
    assert 2 <= len(capsules) <= 4
    points = corner.mean(axis=1)
    gaps = []
    for capsule in capsules:
        local = (points - capsule.p) @ capsule.R
        beyond = np.maximum(np.abs(local[:, 2]) - 0.5 * capsule.length, 0.0)
        gaps.append(np.sqrt(local[:, 0] ** 2 + local[:, 1] ** 2 + beyond**2) - capsule.radius)
    assert np.mean(np.min(gaps, axis=0) < 0.02) > 0.95


@pytest.mark.parametrize("name, text", [("a.stl", "solid a\nendsolid a\n"), ("a.obj", "v 0 0 0\n"), ("a.ply", "ply")])
def test_mesh_without_triangles_is_refused(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(ModelError, match=r"a\.\w+: "):
        read_triangles(tmp_path / name)
