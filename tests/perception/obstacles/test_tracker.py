"""Obstacle points from a depth camera: velocity, coverage, holding and loss, the robot left out."""

import numpy as np
import pytest
from camera_scene import WHITE
from pydrake.common.value import Value
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ObstacleStatus
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.obstacles.tracker import ObstacleTracker
from saphari_drake.perception.obstacles.tracks import NO_TRACKS, ObstacleTrackerParameters, update_tracks, voxel_means
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera

RATE = 15.0
CAMERA = CameraParameters(
    width=160, height=120, focal_x=140.0, focal_y=140.0, rate=RATE, renderer="raycast",
    position=[-1.7, 0.0, 1.1], target=[0.0, 0.0, 0.6],
)  # fmt: skip
RADIUS = 0.08


def cap(center, count=400, seed=0):
    """Points of the half of a sphere that faces −x."""
    n = np.random.default_rng(seed).normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    n[:, 0] = -np.abs(n[:, 0])
    return np.asarray(center) + RADIUS * n


def run(center_of, frames, params, seed=0):
    """Track a sphere; frames at RATE."""
    tracks = NO_TRACKS
    for k in range(frames):
        points = voxel_means(cap(center_of(k / RATE), seed=seed + k), params.voxel)
        tracks = update_tracks(tracks, points, np.zeros_like(points), 1.0 / RATE, params)
    return tracks


def test_voxel_means_average_within_cubes():
    """Points of one cube become their mean; cubes with too few vanish; none stay none."""
    points = np.array([[0.01, 0.01, 0.01], [0.02, 0.02, 0.02], [0.5, 0.5, 0.5]])
    np.testing.assert_allclose(voxel_means(points, 0.1), [[0.015] * 3, [0.5] * 3])
    assert voxel_means(np.zeros((0, 3)), 0.1).shape == (0, 3)


@pytest.mark.parametrize("velocity", [[0.3, 0.0, 0.0], [0.0, -0.8, 0.2], [0.5, 0.5, -0.5]])
def test_velocity_of_a_moving_sphere(velocity):
    """At constant velocity the mean of the estimates is within 10 % and each within 25 %."""
    params = ObstacleTrackerParameters()
    tracks = run(lambda t: np.array([1.0, 0.0, 1.0]) + t * np.array(velocity), 20, params)
    speed = np.linalg.norm(velocity)
    assert len(tracks.p_W) > 0
    assert np.linalg.norm(tracks.v_W.mean(axis=0) - velocity) < 0.10 * speed
    assert np.linalg.norm(tracks.v_W - velocity, axis=1).max() < 0.25 * speed


def test_a_static_sphere_has_no_velocity():
    """What stands still is not said to move by more than its noise."""
    tracks = run(lambda t: np.array([1.0, 0.0, 1.0]), 20, ObstacleTrackerParameters())
    assert np.linalg.norm(tracks.v_W, axis=1).max() < 0.02


def test_all_points_are_covered():
    """Every point of the frame lies within the extent of an obstacle point, with few of them as well."""
    rng = np.random.default_rng(3)
    for most in (40, 4):
        params = ObstacleTrackerParameters(most=most)
        points = voxel_means(np.vstack([cap(c, seed=i) for i, c in enumerate(rng.uniform(-0.5, 0.5, (6, 3)))]), 0.03)
        tracks = update_tracks(NO_TRACKS, points, np.zeros_like(points), 1.0 / RATE, params)
        assert len(tracks.p_W) <= most
        away = np.linalg.norm(points[:, None] - tracks.p_W[None], axis=2) - tracks.extent
        assert away.min(axis=1).max() <= 0.0


def test_body_behind_the_surface_is_covered():
    """The body reaches as far behind the middle as before it; both sides lie within the extent."""
    params = ObstacleTrackerParameters()
    surface = voxel_means(cap([1.0, 0.0, 1.0]), params.voxel)
    half = np.tile([0.05, 0.0, 0.0], (len(surface), 1))
    tracks = update_tracks(NO_TRACKS, surface + half, half, 1.0 / RATE, params)
    for side in (surface, surface + 2.0 * half):
        away = np.linalg.norm(side[:, None] - tracks.p_W[None], axis=2) - tracks.extent
        assert away.min(axis=1).max() <= 1e-12


def test_what_vanishes_is_held_and_then_dropped():
    """A point that is not seen stays where it was, without velocity, for the stated time."""
    params = ObstacleTrackerParameters(hold=0.3)
    tracks = run(lambda t: np.array([1.0, 0.0, 1.0]) + t * np.array([0.5, 0.0, 0.0]), 10, params)
    nothing = np.zeros((0, 3))
    held = update_tracks(tracks, nothing, nothing, 0.1, params)
    np.testing.assert_array_equal(held.p_W, tracks.p_W)
    np.testing.assert_array_equal(held.v_W, 0.0)
    for _ in range(3):
        held = update_tracks(held, nothing, nothing, 0.1, params)
    assert len(held.p_W) == 0


def test_speed_is_limited():
    """No obstacle point is ever said to move faster than the limit."""
    params = ObstacleTrackerParameters(max_speed=0.5, gate=2.0)
    tracks = run(lambda t: np.array([1.0, 2.0 * np.sin(5.0 * t), 1.0]), 30, params)
    assert np.linalg.norm(tracks.v_W, axis=1).max() <= 0.5 + 1e-12


class Scene:
    """The LWR4, a ball that moves, and a camera, rendered by ray casting."""

    def __init__(self, robot):
        self.robot = robot
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        self.arm = robot.add_to(self.plant)
        inertia = SpatialInertia.SolidSphereWithMass(1.0, RADIUS)
        self.ball = self.plant.AddRigidBody("ball", self.plant.AddModelInstance("ball"), inertia)
        self.plant.RegisterVisualGeometry(self.ball, RigidTransform(), Sphere(RADIUS), "ball", WHITE)
        self.plant.Finalize()
        camera = add_depth_camera(builder, scene_graph, CAMERA)
        builder.ExportOutput(camera.GetOutputPort("depth_image_32f"))
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()

    def image(self, q, center):
        context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.plant.SetPositions(context, self.arm, q)
        self.plant.SetFreeBodyPose(context, self.ball, RigidTransform(center))
        return self.diagram.get_output_port(0).Eval(self.context).data[..., 0].copy()


@pytest.fixture(scope="module")
def scene(lwr4):
    return Scene(lwr4)


class Tracked:
    """An ObstacleTracker fed by hand."""

    def __init__(self, robot, params=None, background=None):
        self.system = ObstacleTracker(robot, CAMERA, params, background=background)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.feed(np.full((CAMERA.height, CAMERA.width), np.inf), -1.0, robot.home)
        self.simulator.Initialize()

    def feed(self, depth, stamp, q):
        image = ImageDepth32F(CAMERA.width, CAMERA.height)
        image.mutable_data[..., 0] = depth
        self.system.GetInputPort("depth_image").FixValue(self.context, Value[ImageDepth32F](image))
        self.system.GetInputPort("image_time").FixValue(self.context, [stamp])
        self.system.GetInputPort("position_measured").FixValue(self.context, q)

    def at(self, time):
        self.simulator.AdvanceTo(time)
        return self.system.GetOutputPort("obstacles").Eval(self.context)


def test_ball_is_tracked_and_the_moving_robot_is_not(scene, lwr4):
    """Rendered frames of a moving arm and a moving ball: all points are the ball's, and move as it does."""
    tracked, velocity = Tracked(lwr4), np.array([0.0, 0.4, 0.1])
    for k in range(20):
        now = k / RATE
        q = lwr4.home + 0.3 * np.sin(now) * np.array([1.0, 0.5, 0.0, -0.5, 0.0, 0.5, 0.0])
        center = np.array([-0.5, -0.3, 0.7]) + now * velocity
        # The posture is known before the frame that shows it.
        tracked.feed(scene.image(q, center), now, q)
        points = tracked.at(now + 0.9 / RATE)
    assert points.status == ObstacleStatus.OK and points.stamp == pytest.approx(19 / RATE)
    assert len(points.p_WO) >= 1
    assert np.linalg.norm(points.p_WO - center, axis=1).max() < RADIUS + 0.03
    # 16 cm of ball at 1.3 m: the estimate is within a quarter of its speed.
    assert np.linalg.norm(points.v_WO.mean(axis=0) - velocity) < 0.25 * np.linalg.norm(velocity)
    surface = center + RADIUS * np.array([[-1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0], [0, -1.0, 0]])
    away = np.linalg.norm(surface[:, None] - points.p_WO[None], axis=2) - points.radius
    assert away.min(axis=1).max() < 0.02


def test_robot_alone_gives_no_points(scene, lwr4):
    """Without anybody in view there are no obstacle points, and that is known: OK."""
    tracked = Tracked(lwr4)
    tracked.feed(scene.image(lwr4.home, [0.0, 0.0, -9.0]), 0.0, lwr4.home)
    points = tracked.at(0.03)
    assert points.status == ObstacleStatus.OK and len(points.p_WO) == 0


def test_no_camera_is_lost(scene, lwr4):
    """LOST before the first frame; OK with one; HELD when the next is late; LOST without points after the timeout."""
    tracked = Tracked(lwr4)
    assert tracked.at(0.005).status == ObstacleStatus.LOST
    tracked.feed(scene.image(lwr4.home, [-0.5, 0.0, 0.7]), 0.01, lwr4.home)
    assert tracked.at(0.03).status == ObstacleStatus.OK
    assert tracked.at(0.155).status == ObstacleStatus.HELD
    lost = tracked.at(0.3)
    assert lost.status == ObstacleStatus.LOST and len(lost.p_WO) == 0
    assert tracked.system.GetOutputPort("status").Eval(tracked.context)[0] == ObstacleStatus.LOST


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_blind_frame_is_lost(scene, lwr4, value):
    """A frame without readings is no empty cell."""
    tracked = Tracked(lwr4)
    tracked.feed(np.full((CAMERA.height, CAMERA.width), value), 0.0, lwr4.home)
    assert tracked.at(0.03).status == ObstacleStatus.LOST


def test_background_that_is_not_seen_any_more_is_lost(scene, lwr4):
    """Where there is a known background, no reading there means a blind camera, also if it says "nothing in range"."""
    background = np.full((CAMERA.height, CAMERA.width), 3.0, dtype=np.float32)
    tracked = Tracked(lwr4, background=background)
    tracked.feed(np.full((CAMERA.height, CAMERA.width), np.inf), 0.0, lwr4.home)
    assert tracked.at(0.03).status == ObstacleStatus.LOST
    tracked.feed(background, 0.05, lwr4.home)
    points = tracked.at(0.08)
    assert points.status == ObstacleStatus.OK and len(points.p_WO) == 0


def test_holes_in_the_image_do_no_harm(scene, lwr4):
    """Pixels without reading, as NaN or 0, neither make points nor end up in them."""
    tracked, rng = Tracked(lwr4), np.random.default_rng(0)
    depth = scene.image(lwr4.home, [-0.5, 0.2, 0.7])
    depth[rng.random(depth.shape) < 0.1] = np.nan
    depth[rng.random(depth.shape) < 0.1] = 0.0
    tracked.feed(depth, 0.0, lwr4.home)
    points = tracked.at(0.03)
    assert len(points.p_WO) >= 1 and np.all(np.isfinite(points.p_WO)) and np.all(np.isfinite(points.v_WO))


def test_frame_of_the_future_is_not_used(scene, lwr4):
    """A stamp ahead of the clock is a fault of the camera: no frame."""
    tracked = Tracked(lwr4)
    tracked.feed(scene.image(lwr4.home, [-0.5, 0.0, 0.7]), 5.0, lwr4.home)
    assert tracked.at(0.05).status == ObstacleStatus.LOST


def test_posture_that_is_not_finite_is_lost_until_it_is_known_again(scene, lwr4):
    """Without the posture the robot cannot be left out."""
    tracked = Tracked(lwr4)
    image = scene.image(lwr4.home, [-0.5, 0.0, 0.7])
    tracked.feed(image, 0.0, lwr4.home)
    assert tracked.at(0.015).status == ObstacleStatus.OK
    tracked.feed(image, 0.02, np.full(7, np.nan))
    lost = tracked.at(0.035)
    assert lost.status == ObstacleStatus.LOST and len(lost.p_WO) == 0
    tracked.feed(image, 0.02, lwr4.home)
    tracked.at(0.055)
    tracked.feed(image, 0.055, lwr4.home)
    assert tracked.at(0.075).status == ObstacleStatus.OK


def test_image_of_another_size_is_lost(lwr4):
    tracked = Tracked(lwr4)
    tracked.system.GetInputPort("depth_image").FixValue(tracked.context, Value[ImageDepth32F](ImageDepth32F(7, 5, 1.0)))
    tracked.system.GetInputPort("image_time").FixValue(tracked.context, [0.0])
    assert tracked.at(0.03).status == ObstacleStatus.LOST


@pytest.mark.parametrize(
    ("change", "field"), [({"voxel": 0.0}, "voxel"), ({"alpha": 1.5}, "alpha"), ({"hold": -1}, "hold")]
)
def test_bad_parameters_are_named(change, field):
    """A parameter that cannot be used is an error that names it."""
    with pytest.raises(ParameterError, match=field):
        ObstacleTrackerParameters(**change)
