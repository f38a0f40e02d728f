"""MCAP: what a run writes is read back: poses of the bodies, shapes in their frames, overlays, and every signal."""

import zlib

import numpy as np
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import Box, Capsule, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia

from saphari_drake.errors import ParameterError
from saphari_drake.perception.camera.model import CameraParameters, camera_pose, ray_tables
from saphari_drake.simulation.record.frames import DepthFrame, millimetres
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.view import mcap
from saphari_drake.simulation.view.mcap import McapFile
from saphari_drake.simulation.view.overlays import Arrow, Marker
from saphari_drake.simulation.view.replay import write_replay

pytest.importorskip("mcap_protobuf", reason="the extra 'mcap' is not installed")
TIMES = np.linspace(1.0, 2.0, 101)
POSITIONS = np.linspace(0.0, 0.5, 101)[:, None]


def build(builder):
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    body = plant.AddRigidBody("slider", SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidSphere(0.1)))
    red = np.array([1.0, 0.0, 0.0, 1.0])
    plant.RegisterVisualGeometry(body, RigidTransform([0.0, 0.0, 0.2]), Sphere(0.1), "ball", red)
    plant.RegisterVisualGeometry(body, RigidTransform(), Capsule(0.05, 0.4), "rod", red)
    plant.RegisterVisualGeometry(plant.world_body(), RigidTransform(), Box(1.0, 2.0, 0.1), "table", red)
    plant.AddJoint(PrismaticJoint("x", plant.world_frame(), body.body_frame(), [1.0, 0.0, 0.0]))
    plant.Finalize()
    return plant


def read(path):
    """Return the messages of a file, by topic, each with its time (s)."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    topics = {}
    with path.open("rb") as stream:
        for _, channel, message, content in make_reader(
            stream, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time * 1e-9, content))
    return topics


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """Return the messages of a run's file."""
    path, log = tmp_path_factory.mktemp("mcap") / "run.mcap", Log(TIMES)
    log.add("force", np.outer(np.arange(101.0), [0.0, 1.0, 2.0]), "N")
    log.add("lost", np.full(101, np.nan))
    force = np.outer(np.linspace(0.0, 10.0, 101), [0.0, 0.0, 1.0])
    overlays = [Arrow("push", [0.0, 0.0, 0.3], force), Marker("point", np.zeros((101, 3)), visible=TIMES > 1.5)]
    with McapFile(path) as file:
        file.add_log(log)
        write_replay(file, build, TIMES, POSITIONS, overlays, fps=20.0)
    return read(path)


def test_bodies_are_where_the_plant_has_them(messages):
    """Every frame holds the pose of the one body that moves."""
    assert len(messages["/tf"]) == 21
    for time, message in messages["/tf"]:
        (transform,) = message.transforms
        assert (transform.parent_frame_id, transform.child_frame_id) == ("world", "DefaultModelInstance::slider")
        assert transform.translation.x == pytest.approx(0.5 * (time - 1.0), abs=1e-9)
        assert transform.rotation.w == pytest.approx(1.0)


def test_shapes_are_fixed_to_their_bodies(messages):
    """Sizes are diameters; a capsule is a cylinder with two balls."""
    ((_, scene),) = messages["/scene"]
    shapes = {entity.id.split("::")[-1]: entity for entity in scene.entities}
    ball, rod, table = shapes["ball"], shapes["rod"], shapes["table"]
    assert table.frame_id == "world" and ball.frame_id == rod.frame_id == "DefaultModelInstance::slider"
    assert all(entity.frame_locked for entity in scene.entities)
    assert ball.spheres[0].size.x == pytest.approx(0.2) and ball.spheres[0].pose.position.z == pytest.approx(0.2)
    assert ball.spheres[0].color.r == 1.0
    assert rod.cylinders[0].size.z == pytest.approx(0.4) and rod.cylinders[0].size.x == pytest.approx(0.1)
    assert sorted(s.pose.position.z for s in rod.spheres) == pytest.approx([-0.2, 0.2])
    assert (table.cubes[0].size.x, table.cubes[0].size.y) == (1.0, 2.0)


def test_overlays_come_and_go(messages):
    """The arrow is as long as its force, the ball shown while it is visible."""
    for time, update in messages["/overlays"]:
        shown = {entity.id: entity for entity in update.entities}
        gone = {deletion.id for deletion in update.deletions}
        assert set(shown) | gone == {"push", "point"} and not set(shown) & gone
        assert ("point" in shown) == (time > 1.5 + 1e-9)
        if "push" in shown:
            arrow = shown["push"].arrows[0]
            length = arrow.shaft_length + arrow.head_length
            assert length == pytest.approx(0.01 * 10.0 * (time - 1.0), abs=1e-6)


def test_signals_keep_every_sample(messages):
    """Values, times and unit; what is not finite stays so."""
    force = messages["/log/force"]
    np.testing.assert_allclose([message.values for _, message in force], np.outer(np.arange(101.0), [0.0, 1.0, 2.0]))
    np.testing.assert_allclose([m.timestamp.ToNanoseconds() * 1e-9 for _, m in force], TIMES, atol=1e-9)
    assert {message.unit for _, message in force} == {"N"}
    assert np.isnan([message.values for _, message in messages["/log/lost"]]).all()


def test_images_stand_before_their_camera(tmp_path):
    """A pixel's ray and depth, by the calibration and the pose in the file, lead to the point that was seen."""
    camera = CameraParameters(width=64, height=48, focal_x=60.0, focal_y=58.0, center_x=30.0, position=[-1.0, 0.3, 1.2])
    depth = np.zeros((48, 64), dtype=np.float32)
    depth[20, 40] = 1.5
    packed = zlib.compress(millimetres(depth).tobytes())
    with McapFile(tmp_path / "run.mcap") as file:
        file.add_frames([DepthFrame("eye", camera, time, packed) for time in (0.5, 0.6)])
    topics = read(tmp_path / "run.mcap")
    assert [time for time, _ in topics["/eye/depth"]] == pytest.approx([0.5, 0.6])
    image, optics = topics["/eye/depth"][1][1], topics["/eye/calibration"][1][1]
    (pose,) = topics["/tf"][1][1].transforms
    assert (image.encoding, image.width, image.height, image.step) == ("16UC1", 64, 48, 128)
    assert image.frame_id == optics.frame_id == pose.child_frame_id == "eye" and pose.parent_frame_id == "world"
    assert image.timestamp.ToNanoseconds() == optics.timestamp.ToNanoseconds() == 600_000_000
    pixels = np.frombuffer(image.data, "<u2").reshape(48, 64)
    assert np.argwhere(pixels).tolist() == [[20, 40]] and pixels[20, 40] == 1500
    K, turn, place = np.reshape(optics.K, (3, 3)), pose.rotation, pose.translation
    X_WC = RigidTransform(Quaternion(turn.w, turn.x, turn.y, turn.z), [place.x, place.y, place.z])
    p_C = 1.5 * np.linalg.solve(K, [40.0, 20.0, 1.0])  # the centre of a pixel has whole coordinates there
    x, y = ray_tables(camera)
    np.testing.assert_allclose(X_WC @ p_C, camera_pose(camera) @ (1.5 * np.array([x[40], y[20], 1.0])), atol=1e-6)


def test_a_missing_package_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(mcap, "find_spec", lambda name: None)
    with pytest.raises(ParameterError, match=r"pip install 'saphari_drake\[mcap\]'"):
        McapFile(tmp_path / "run.mcap")
    assert not list(tmp_path.iterdir())
