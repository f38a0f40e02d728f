"""Replay: one file with every frame, the overlays in it, and nothing fetched from a network."""

import base64
import json
import re

import numpy as np
import pytest
from pydrake.geometry import MeshcatAnimation, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.view import replay
from saphari_drake.simulation.view.overlays import rows_at
from saphari_drake.simulation.view.replay import Arrow, Marker, write_replay

TIMES = np.linspace(1.0, 2.0, 101)
POSITIONS = np.linspace(0.0, 0.5, 101)[:, None]


def build(builder):
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
    ball = plant.AddRigidBody("ball", SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidSphere(0.1)))
    plant.RegisterVisualGeometry(ball, RigidTransform(), Sphere(0.1), "ball", np.array([1.0, 0.0, 0.0, 1.0]))
    plant.AddJoint(PrismaticJoint("x", plant.world_frame(), ball.body_frame(), [1.0, 0.0, 0.0]))
    plant.Finalize()
    return plant


@pytest.fixture
def meshcat(monkeypatch):
    """The server that the replay starts, kept so that its recording can be looked at."""
    kept, start = [], replay.start_meshcat

    def started(params=None):
        kept.append(start(params))
        return kept[-1]

    monkeypatch.setattr(replay, "start_meshcat", started)
    return kept


def test_page_is_whole_and_offline(tmp_path, capfd):
    force = np.outer(np.linspace(0.0, 10.0, 101), [0.0, 0.0, 1.0])
    overlays = [Arrow("force", [0.0, 0.0, 0.3], force), Marker("point", np.zeros((101, 3)), visible=TIMES > 1.5)]
    path = tmp_path / "replay.html"
    write_replay(path, build, TIMES, POSITIONS, overlays, title="Figure 12: <natural>")
    page = path.read_text()
    assert "Figure 12: &lt;natural&gt;</div></body>" in page and "<title>Figure 12: &lt;natural&gt;</title>" in page
    assert not re.search(r"<(script|link)[^>]+(src|href)=.https?:", page)
    assert [item.name for item in tmp_path.iterdir()] == ["replay.html"]
    assert capfd.readouterr().err == ""


def test_no_frame_is_dropped_and_arrow_follows(tmp_path, meshcat, monkeypatch):
    seen = []

    class Spy:
        def __init__(self, animation):
            self.animation = animation

        def SetProperty(self, frame, path, name, value):
            seen.append((frame, path.rsplit("/", 1)[-1], name, value))
            self.animation.SetProperty(frame, path, name, value)

        def SetTransform(self, frame, path, X):
            seen.append((frame, path.rsplit("/", 1)[-1], "X", X))
            self.animation.SetTransform(frame, path, X)

    record = replay.record_overlay
    monkeypatch.setattr(replay, "record_overlay", lambda m, a, *rest: record(m, Spy(a), *rest))
    force = np.outer(np.clip(np.arange(101.0) - 50.0, 0.0, None), [0.0, 1.0, 0.0])
    arrow = Arrow("force", np.hstack([POSITIONS, np.zeros((101, 2))]), force, scale=0.01)
    write_replay(tmp_path / "r.html", build, TIMES, POSITIONS, [arrow], fps=50.0)
    visible = [(frame, value) for frame, _, name, value in seen if name == "visible"]
    assert visible == [(0, False), (26, True)]
    poses = {frame: X for frame, path, name, X in seen if path == "force" and name == "X"}
    assert sorted(poses) == list(range(26, 51))
    X = poses[50]
    np.testing.assert_allclose(X.translation(), [0.5, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(X.rotation().matrix()[:, 2], [0.0, 1.0, 0.0], atol=1e-12)
    tips = {frame: X for frame, path, name, X in seen if path == "head"}
    np.testing.assert_allclose(tips[50].translation(), [0.0, 0.0, 0.5])
    animation = meshcat[0].get_mutable_recording()
    assert animation.autoplay() and animation.loop_mode() == MeshcatAnimation.LoopMode.kLoopRepeat
    # In the page, each frame of the plant is a key of its own in two tracks: position and quaternion.
    page = (tmp_path / "r.html").read_text()
    messages = [base64.b64decode(text) for text in re.findall(r"base64,([A-Za-z0-9+/=]+)", page)]
    (recording,) = [message for message in messages if b"set_animation" in message]
    (ball,) = [part for part in recording.split(b"\xa4path") if b"/ball" in part]
    assert ball.count(b"\xa4time") == 2 * 51


def test_one_sample_and_free_overlays(tmp_path):
    write_replay(tmp_path / "r.html", build, [0.0], [[0.1]], [Marker("nowhere", [np.nan, 0.0, 0.0])])
    assert (tmp_path / "r.html").stat().st_size > 1e6


def test_quaternions_keep_their_sign():
    plant = MultibodyPlant(0.0)
    plant.AddRigidBody("hand", SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidSphere(0.1)))
    plant.Finalize()
    angle = np.linspace(0.0, 1.0, 50)
    rows = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle, 0 * angle, angle, angle, angle])
    flipped = rows.copy()
    flipped[[3, 4, 20], :4] *= -1.0
    np.testing.assert_array_equal(replay._continuous(plant, flipped), rows)


def test_rows_at_interpolates_or_takes_the_nearest():
    stamps, values = np.array([0.0, 1.0, 3.0]), np.array([[0.0], [2.0], [4.0]])
    at = np.array([-1.0, 0.4, 0.6, 2.5, 9.0])
    np.testing.assert_allclose(rows_at(stamps, values, at, "x")[:, 0], [0.0, 0.8, 1.2, 3.5, 4.0])
    np.testing.assert_allclose(rows_at(stamps, values, at, "x", nearest=True)[:, 0], [0.0, 0.0, 2.0, 4.0, 4.0])


def test_wrong_sizes_are_named(tmp_path):
    path = tmp_path / "r.html"
    with pytest.raises(ParameterError, match="positions: the plant has 1 positions"):
        write_replay(path, build, TIMES, np.zeros((101, 2)))
    with pytest.raises(ParameterError, match="positions: needs a row for each of 101 times"):
        write_replay(path, build, TIMES, np.zeros((100, 1)))
    with pytest.raises(ParameterError, match="force: needs a row for each of 101 times"):
        write_replay(path, build, TIMES, POSITIONS, [Arrow("force", [0, 0, 0], np.zeros((5, 3)))])
    with pytest.raises(ParameterError, match="each needs a name of its own"):
        write_replay(path, build, TIMES, POSITIONS, [Marker("a", [0, 0, 0]), Marker("a", [0, 0, 0])])
    with pytest.raises(ParameterError, match="times"):
        write_replay(path, build, TIMES[::-1], POSITIONS)
    with pytest.raises(ParameterError, match="positions: row 2 is not finite"):
        write_replay(path, build, TIMES, np.where(np.arange(101)[:, None] == 2, np.nan, POSITIONS))
    assert not path.exists()


@pytest.mark.render
def test_an_animated_picture_shows_body_and_overlay(tmp_path):
    """The red ball moves to the side as its joint does; the marker is drawn while it is visible."""
    image = pytest.importorskip("PIL.Image")
    path = tmp_path / "replay.gif"
    marker = Marker("point", [0.0, 0.0, 0.3], 0.05, (0.0, 0.0, 1.0), visible=TIMES > 1.5)
    write_replay(path, build, TIMES, POSITIONS, [marker], camera=[[0.0, -2.0, 0.0], [0.0, 0.0, 0.0]])
    picture, columns, blue = image.open(path), [], []
    for frame in range(picture.n_frames):
        picture.seek(frame)
        rgb = np.asarray(picture.convert("RGB"), dtype=int)
        red = (rgb[..., 0] > 80) & (rgb[..., 1] < 60) & (rgb[..., 2] < 60)
        columns.append(np.argwhere(red)[:, 1].mean())
        blue.append(((rgb[..., 2] > 150) & (rgb[..., 0] < 60)).any())
    assert picture.n_frames == 11 and np.all(np.diff(columns) > 0.0)
    focal = 0.5 * 400 / np.tan(np.deg2rad(20.0))
    assert columns[-1] - columns[0] == pytest.approx(focal * 0.5 / 2.0, rel=0.03)
    assert not any(blue[:5]) and all(blue[6:])


def test_the_page_tells_each_caption_from_its_own_time_on(tmp_path):
    """One that lasts is written once; what looks like a tag stays text."""
    told = ["waits <b>"] * 50 + ["works"] * 51
    write_replay(tmp_path / "r.html", build, TIMES, POSITIONS, captions=told)
    page = (tmp_path / "r.html").read_text()
    known = json.loads(re.search(r"const known = (\[\[.*?\]\]);", page)[1])
    assert known == [[0.0, "waits <b>"], [pytest.approx(TIMES[50] - TIMES[0]), "works"]]
    assert "waits <b>" not in page
    with pytest.raises(ParameterError, match="captions"):
        write_replay(tmp_path / "r.html", build, TIMES, POSITIONS, captions=told[:-1])
