"""Meshes of the formats that robots come with are read, and stand for themselves as a few primitives."""

import numpy as np
import pytest
from arms import EXAMPLES, joint, link, write_urdf

from saphari_drake.errors import ModelError
from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.robots.mesh_files import read_collada, read_stl
from saphari_drake.robots.model import RobotModel

# A tetrahedron.
CORNERS = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]])
TRIANGLES = CORNERS[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]]
COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.001"/></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array>0 0 0 100 0 0 0 200 0 0 0 300</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>
<vcount>3 3 3 3</vcount><p>0 0 2 0 1 0 0 0 1 0 3 0 0 0 3 0 2 0 1 0 2 0 3 0</p></polylist>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene><node>
<matrix>0 -1 0 1000 1 0 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes></COLLADA>"""


def write_stl(path, triangles):
    rows = np.zeros(len(triangles), np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]))
    rows["v"] = triangles
    path.write_bytes(b"\0" * 80 + len(triangles).to_bytes(4, "little") + rows.tobytes())


def arm_with(folder, file):
    shape = f'<geometry><mesh filename="{file}" scale="2 2 2"/></geometry>'
    parts = f"<visual>{shape}</visual><collision>{shape}</collision>"
    return RobotModel(write_urdf(folder, link("base", 0), link("a", extra=parts), joint("j", "base", "a")))


def test_stl_binary_and_text(tmp_path):
    write_stl(tmp_path / "a.stl", TRIANGLES)
    facets = "".join(
        "facet normal 0 0 0 outer loop " + " ".join(f"vertex {x} {y} {z}" for x, y, z in t) + " endloop endfacet\n"
        for t in TRIANGLES
    )
    (tmp_path / "b.stl").write_text(f"solid a\n{facets}endsolid a\n")
    for name in ("a.stl", "b.stl"):
        np.testing.assert_allclose(read_stl(tmp_path / name), TRIANGLES, atol=1e-7)


def test_collada_with_its_unit_and_its_nodes(tmp_path):
    """Turned a quarter about z and moved by 1 m along x."""
    (tmp_path / "a.dae").write_text(COLLADA)
    turned = TRIANGLES @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]).T + [1.0, 0.0, 0.0]
    np.testing.assert_allclose(read_collada(tmp_path / "a.dae"), turned, atol=1e-12)


@pytest.mark.parametrize("suffix", ["stl", "dae"])
def test_a_robot_with_such_meshes_has_a_surface(tmp_path, suffix):
    """Its primitives contain the mesh, which lies near their surface."""
    write_stl(tmp_path / "m.stl", TRIANGLES)
    (tmp_path / "m.dae").write_text(COLLADA)
    shapes = arm_with(tmp_path, f"m.{suffix}").shapes
    triangles = (read_stl if suffix == "stl" else read_collada)(tmp_path / f"m.{suffix}")
    points = 2.0 * np.concatenate([triangles.mean(axis=1), triangles.reshape(-1, 3)])
    poses = shapes.R_LS, shapes.p_LS, np.ones(shapes.count, bool)
    depth = [nearest_surface_point(shapes.kind, shapes.size, *poses, point)[1] for point in points]
    assert -0.1 < min(depth) and max(depth) < 1e-3


@pytest.mark.parametrize("content", [b"", b"solid nothing", b"\0" * 80 + b"\x01\0\0\0" + b"\xff" * 50])
def test_a_broken_mesh_is_told(tmp_path, content):
    (tmp_path / "m.stl").write_bytes(content)
    with pytest.raises(ModelError, match=r"cannot read mesh '.*m.stl'"):
        _ = arm_with(tmp_path, "m.stl").shapes


@pytest.mark.skipif(not EXAMPLES.is_dir(), reason="example-robot-data is not installed")
def test_an_arm_out_of_a_package_is_found_and_covered():
    """Its packages lie above the file, its meshes are STL; every link has a surface."""
    robot = RobotModel(EXAMPLES / "xarm_description" / "urdf" / "xarm7.urdf")
    assert set(robot.shapes.link) == {-1, *range(7)}
    np.testing.assert_array_equal(robot.viscous, [10.0, 10.0, 5.0, 5.0, 5.0, 2.0, 2.0])
    np.testing.assert_array_equal(robot.coulomb, np.ones(7))
