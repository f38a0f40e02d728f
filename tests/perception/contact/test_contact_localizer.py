"""The localizer finds the touched point: against the known contact, its plain twin, time stamps and broken cameras."""

import numpy as np
import pytest
from camera_scene import HandScene
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import ImageDepth32F
from scipy import ndimage

from saphari_drake.errors import ParameterError, StateError
from saphari_drake.math.primitives import BOX, CAPSULE, CYLINDER, surface_point
from saphari_drake.messages import CameraStatus, ContactPoint
from saphari_drake.perception.camera.model import CameraParameters, camera_pose, ray_tables
from saphari_drake.perception.contact.contact_localizer import (
    ContactLocalizer,
    ContactVision,
    LocalizerParameters,
    background_depth,
)
from saphari_drake.perception.segmentation import distances as kernels
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.robots.shapes import LinkShapes
from saphari_drake.simulation.sensors.depth_noise import (
    DepthCameraSampler,
    DepthNoiseParameters,
    SamplerParameters,
    add_kinect_noise,
)

KINECT = DepthNoiseParameters()


@pytest.fixture(scope="module")
def scene():
    return HandScene(radius=0.010)


@pytest.fixture(scope="module")
def vision(scene):
    return ContactVision(scene.robot.shapes, scene.camera, LocalizerParameters())


def noisy(image, seed):
    return add_kinect_noise(image, np.random.default_rng(seed), KINECT)


def localize(vision, image, touch):
    result = vision.localize(image, touch.R_WL, touch.p_WL)
    p_WC = touch.p_WL[result.link] + touch.R_WL[result.link] @ result.p_LC
    return result, float(np.linalg.norm(p_WC - touch.p_WC))


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
def test_kernels_equal_the_plain_twin(scene, vision, seed):
    touch = scene.random_touch(np.random.default_rng(100 + seed))
    image = scene.image(touch.q, touch)
    image = noisy(image, seed) if seed % 2 else image
    result = vision.localize_several(image, touch.R_WL, touch.p_WL, 1)[0]  # as something thin
    everywhere = np.full(image.shape, np.inf)
    link, distance, p_LC = localize_twin(
        scene.robot.shapes, scene.camera, vision.params, image, everywhere, touch.R_WL, touch.p_WL
    )
    assert result.link == link
    assert result.distance == pytest.approx(distance, abs=1e-5)
    np.testing.assert_allclose(result.p_LC, p_LC, atol=1e-4)


@pytest.mark.parametrize("kind", [CAPSULE, CYLINDER, BOX])
def test_row_kernel_equals_exact_distances(kind):
    rng = np.random.default_rng(kind)
    size, z = np.array([0.07, 0.12, 0.05]), rng.uniform(1.0, 2.0, 400).astype(np.float32)
    x, y = rng.uniform(-0.3, 0.3, 400).astype(np.float32), np.float32(0.07)
    R, p = np.linalg.qr(rng.normal(size=(3, 3)))[0], np.array([0.02, 0.1, 1.5])
    R *= np.linalg.det(R)
    best, owner = np.full(400, np.inf, np.float32), np.full(400, -1, np.int32)
    kernels._shape_row(kind, size, R, p, 3, z, x, y, best, owner)
    exact = [surface_point(kind, size, R, p, np.array([a * c, y * c, c], dtype=float))[0] for a, c in zip(x, z)]
    np.testing.assert_allclose(best, exact, atol=2e-6)
    assert np.all(owner == 3)


# ---- physical truth ------------------------------------------------------------------------------------------------


def test_noisy_touches_are_found_within_a_centimetre(scene, vision):
    rng = np.random.default_rng(7)
    errors, right, found = [], [], []
    for seed in range(20):
        touch = scene.random_touch(rng)
        result, error = localize(vision, noisy(scene.image(touch.q, touch), seed), touch)
        errors.append(error)
        right.append(result.link == touch.link)
        found.append(result.distance < vision.params.gate)
    assert np.median(errors) < 0.007
    assert np.quantile(errors, 0.9) < 0.015
    assert np.mean(right) >= 0.9
    assert np.mean(found) >= 0.9


def test_exact_images_of_a_fine_finger_give_the_point_within_3_mm():
    scene = HandScene(radius=0.008)
    vision = ContactVision(scene.robot.shapes, scene.camera, LocalizerParameters())
    rng = np.random.default_rng(11)
    errors = []
    for _ in range(12):
        touch = scene.random_touch(rng)
        result, error = localize(vision, scene.image(touch.q, touch), touch)
        assert result.link == touch.link
        errors.append(error)
    assert np.median(errors) < 0.003


def test_result_is_on_the_surface_with_its_normal(scene, vision):
    touch = scene.random_touch(np.random.default_rng(5))
    result, _ = localize(vision, scene.image(touch.q, touch), touch)
    p_LC, n_L = vision.on_surface(result.link, result.p_LC + 0.01 * result.n_L)
    np.testing.assert_allclose(p_LC, result.p_LC, atol=1e-9)
    np.testing.assert_allclose(n_L, result.n_L, atol=1e-9)
    assert n_L @ (touch.R_WL[result.link].T @ touch.n_W) > 0.95


def test_nobody_is_seen_without_a_person(scene, vision):
    rng = np.random.default_rng(2)
    for seed in range(5):
        q = scene.robot.home + rng.uniform(-0.5, 0.5, scene.robot.n)
        result = vision.localize(noisy(scene.image(q), seed), *scene.poses(q))
        assert not (result.link >= 0 and result.distance < vision.params.gate)
        assert result.seen > 0.8


def test_human_points_lie_on_the_hand(scene, vision):
    touch = scene.random_touch(np.random.default_rng(9))
    result, _ = localize(vision, scene.image(touch.q, touch), touch)
    along = (result.human_points - touch.p_WC) @ touch.finger
    across = np.linalg.norm(result.human_points - touch.p_WC - along[:, None] * touch.finger, axis=1)
    assert len(result.human_points) > 10
    assert np.all((along > 0.0) & (along < 0.5) & (across < 0.06))
    assert along.max() > 0.2  # the forearm outside the reach belongs to the person too


def test_empty_image_shows_nothing(scene, vision):
    q = scene.robot.home
    for value in (0.0, np.nan, np.inf):
        image = np.full((480, 640), value, dtype=np.float32)
        result = vision.localize(image, *scene.poses(q))
        assert (result.link, result.seen, len(result.human_points)) == (-1, 0.0, 0)


def test_robot_out_of_view_is_not_seen(scene):
    away = CameraParameters(target=[-3.0, 0.0, 1.0])
    vision = ContactVision(scene.robot.shapes, away, LocalizerParameters())
    result = vision.localize(np.full((480, 640), 1.0, np.float32), *scene.poses(scene.robot.home))
    assert (result.link, result.seen) == (-1, 0.0)


def test_background_is_removed_and_learnt_behind_the_robot(scene):
    rng = np.random.default_rng(4)
    wall = np.full((480, 640), 2.2, dtype=np.float32)
    wall[:, :100] = np.inf

    def with_wall(image, seed):
        return noisy(np.minimum(np.where(image > 0.0, image, np.inf), wall), seed)

    postures = [scene.robot.home + rng.uniform(-0.6, 0.6, scene.robot.n) * [3, 1, 1, 1, 1, 1, 1] for _ in range(12)]
    frames = [with_wall(scene.image(q), seed) for seed, q in enumerate(postures)]
    background = background_depth(frames)
    assert np.all(np.isinf(background[:, :98]))
    assert np.mean(np.abs(background[:, 130:] - 2.2) < 0.03) > 0.95  # the rest is the base, which never moves
    bare = ContactVision(scene.robot.shapes, scene.camera, LocalizerParameters())
    learnt = ContactVision(scene.robot.shapes, scene.camera, LocalizerParameters(), background)
    errors = []
    for seed in range(6):
        touch = scene.random_touch(rng)
        image = with_wall(scene.image(touch.q, touch), 50 + seed)
        result, error = localize(learnt, image, touch)
        errors.append(error)
        assert len(result.human_points) < 0.2 * len(bare.localize(image, touch.R_WL, touch.p_WL).human_points)
    assert np.median(errors) < 0.01


def test_background_ignores_single_far_readings_and_needs_half_of_the_readings():
    frames = np.full((10, 2, 3), 2.0, dtype=np.float32)
    frames[:4, 0, 0] = 1.0  # the robot was there
    frames[0, 0, 1] = 4.0  # one wrong reading
    frames[:5, 0, 2] = np.nan
    frames[:4, 1, 0] = 0.0
    background = background_depth(frames)
    np.testing.assert_allclose(background, [[2.0, 2.0, np.inf], [2.0, 2.0, 2.0]])
    with pytest.raises(StateError):
        background_depth(np.zeros((4, 5)))


def test_shapes_of_the_base_are_removed_but_never_touched():
    scene = HandScene(radius=0.01)
    shapes = scene.robot.shapes
    only_base = LinkShapes(
        np.full_like(shapes.link, -1), shapes.kind, shapes.size, *shapes.in_world(*scene.poses(scene.robot.home))
    )
    vision = ContactVision(only_base, scene.camera, LocalizerParameters())
    touch = scene.random_touch(np.random.default_rng(3))
    assert vision.localize(scene.image(touch.q, touch), touch.R_WL, touch.p_WL).link == -1


# ---- the system ----------------------------------------------------------------------------------------------------


class Bench:
    """The system alone, its inputs set by hand."""

    def __init__(self, scene, **params):
        self.system = ContactLocalizer(scene.robot, scene.camera, LocalizerParameters(**params))
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.set("position_measured", scene.robot.home)
        self.frame(np.zeros((480, 640), np.float32), -1.0)

    def set(self, port, value):
        self.system.GetInputPort(port).FixValue(self.context, value)

    def frame(self, image, stamp):
        value = ImageDepth32F(640, 480)
        value.mutable_data[..., 0] = image
        self.set("depth_image", AbstractValue.Make(value))
        self.set("image_time", [stamp])

    def advance(self, time):
        self.simulator.AdvanceTo(time)

    def get(self, port):
        value = self.system.GetOutputPort(port).Eval(self.context)
        return CameraStatus(int(value[0])) if port == "camera_status" else value


@pytest.fixture(scope="module")
def bench_scene(scene):
    touch = scene.random_touch(np.random.default_rng(21))
    return scene, touch, scene.image(touch.q, touch)


def test_posture_at_the_time_stamp_counts_not_the_present_one(bench_scene, vision):
    scene, touch, image = bench_scene
    bench = Bench(scene)
    speed = np.array([0.8, 0.0, 0.8, 0.0, 0.0, 0.0, 0.0])
    for step in range(1, 21):  # the posture of the image at 0.0525 s, between two samples
        time = 0.005 * step
        bench.set("position_measured", touch.q + speed * (time - 0.0525))
        if step == 20:
            bench.frame(image, 0.0525)
        bench.advance(time + 0.001)
    contact = bench.get("contact_point")
    expected = vision.localize(image, touch.R_WL, touch.p_WL)
    stale = vision.localize(image, *scene.poses(touch.q + speed * 0.0475))
    assert contact.found and contact.link == expected.link
    assert contact.stamp == 0.0525
    np.testing.assert_allclose(contact.p_LC, expected.p_LC, atol=1e-4)
    assert stale.link != contact.link or np.linalg.norm(stale.p_LC - expected.p_LC) > 3e-3


def test_residual_of_the_frame_s_own_time_moves_the_point(bench_scene, vision):
    """A force beside the seen point draws it there; one that is felt only after the frame was taken does not."""
    scene, touch, image = bench_scene
    seen = vision.localize(image, touch.R_WL, touch.p_WL)
    terms = evaluate_dynamics(scene.robot, touch.q, np.zeros(7))
    side = np.cross(seen.n_L, [0.3, 0.5, 0.8])
    beside, n_L = vision.on_surface(seen.link, seen.p_LC + 0.008 * side / np.linalg.norm(side))
    r = terms.point(seen.link, beside).Jv_WC.T @ (-30.0 * terms.R_WL[seen.link] @ n_L)

    def point(changes):
        bench = Bench(scene, torque_sigma=0.01)
        bench.set("position_measured", touch.q)
        for time, value in changes:
            bench.advance(time)
            bench.set("residual", value)
        bench.advance(0.05)
        bench.frame(image, 0.02)
        bench.advance(0.06)
        return bench.get("contact_point").p_LC

    felt, late = point([(0.0, r)]), point([(0.0, np.zeros(7)), (0.03, r)])
    np.testing.assert_allclose(late, seen.p_LC, atol=1e-4)
    assert np.linalg.norm(felt - beside) < np.linalg.norm(seen.p_LC - beside) - 0.001


def test_each_frame_is_used_once_and_then_held(bench_scene):
    scene, touch, image = bench_scene
    bench = Bench(scene)
    bench.set("position_measured", touch.q)
    bench.frame(image, 0.0)
    bench.advance(0.006)
    first = bench.get("contact_point")
    assert first.found
    bench.frame(np.zeros_like(image), 0.0)  # another image, but no new time stamp
    bench.advance(0.03)
    assert bench.get("contact_point").stamp == first.stamp
    np.testing.assert_array_equal(bench.get("contact_point").p_LC, first.p_LC)


def test_status_goes_from_waiting_to_stale_within_a_tenth_of_a_second(bench_scene):
    scene, touch, image = bench_scene
    bench = Bench(scene)
    bench.set("position_measured", touch.q)
    bench.advance(0.05)
    assert bench.get("camera_status") == CameraStatus.WAITING
    bench.advance(0.1)
    assert bench.get("camera_status") == CameraStatus.STALE
    bench.frame(image, 0.1)
    bench.advance(0.11)
    assert bench.get("camera_status") == CameraStatus.OK
    assert bench.get("contact_point").found
    assert len(bench.get("human_points")) > 0
    bench.advance(0.18)
    assert bench.get("camera_status") == CameraStatus.OK
    bench.advance(0.2)
    assert bench.get("camera_status") == CameraStatus.STALE
    assert not bench.get("contact_point").found
    assert len(bench.get("human_points")) == 0


def test_frames_without_readings_are_invalid(bench_scene):
    scene, touch, image = bench_scene
    bench = Bench(scene)
    bench.set("position_measured", touch.q)
    bench.frame(image, 0.0)
    bench.advance(0.01)
    assert bench.get("camera_status") == CameraStatus.OK
    bench.frame(np.full_like(image, np.nan), 0.033)
    bench.advance(0.05)
    assert bench.get("camera_status") == CameraStatus.INVALID
    assert not bench.get("contact_point").found
    bench.frame(image, 0.05)
    bench.advance(0.07)
    assert bench.get("camera_status") == CameraStatus.OK


@pytest.mark.parametrize("stamp", [0.05, 0.6, np.nan, np.inf])
def test_frames_from_long_ago_or_the_future_are_not_used(bench_scene, stamp):
    scene, touch, image = bench_scene
    bench = Bench(scene)
    bench.set("position_measured", touch.q)
    bench.advance(0.4)
    bench.frame(image, stamp)
    bench.advance(0.5)
    assert bench.get("camera_status") == CameraStatus.STALE
    assert not bench.get("contact_point").found


def test_position_that_is_not_finite_is_an_error(scene):
    bench = Bench(scene)
    bench.set("position_measured", np.full(scene.robot.n, np.nan))
    with pytest.raises(StateError, match="position_measured"):
        bench.advance(0.01)


def test_another_link_must_be_seen_twice(scene, vision):
    """The point stays on the first link for one frame of a hand on another one, and then follows."""
    rng = np.random.default_rng(31)
    first = scene.random_touch(rng)
    other = scene.random_touch(rng)
    while other.link == first.link:
        other = scene.random_touch(rng)
    bench = Bench(scene)
    links = []
    for k, touch in enumerate([first, first, other, first, other, other]):
        bench.set("position_measured", touch.q)
        bench.advance(0.033 * k + 0.006)
        bench.frame(scene.image(touch.q, touch), bench.context.get_time())
        bench.advance(0.033 * k + 0.016)
        contact = bench.get("contact_point")
        assert contact.found
        links.append(contact.link)
    assert links == [first.link] * 5 + [other.link]


def test_point_is_smoothed_while_the_contact_lasts_and_starts_anew_after(bench_scene):
    scene, touch, image = bench_scene

    def track(frames, **params):
        bench = Bench(scene, **params)
        bench.set("position_measured", touch.q)
        points = []
        for k, frame in enumerate(frames):
            bench.frame(frame, k / 30.0)
            bench.advance(k / 30.0 + 0.012)
            contact = bench.get("contact_point")
            points.append(contact.p_LC if contact.found else np.full(3, np.nan))
        return np.array(points)

    frames = [noisy(image, seed) for seed in range(15)]
    smooth, rough = track(frames), track(frames, slide=10.0)
    np.testing.assert_allclose(smooth[0], rough[0], atol=1e-9)
    assert np.linalg.norm(np.diff(smooth, axis=0), axis=1).mean() < 0.5 * (
        np.linalg.norm(np.diff(rough, axis=0), axis=1).mean()
    )
    lost = [*frames[:5], noisy(scene.image(touch.q), 90), *frames[5:7]]
    smooth, rough = track(lost), track(lost, slide=10.0)
    assert np.all(np.isnan(smooth[5]))
    np.testing.assert_allclose(smooth[6], rough[6], atol=1e-9)


def closed_diagram(scene, image, **sampler):
    """Sampler and localizer with a constant image and posture."""
    builder = DiagramBuilder()
    frames = builder.AddSystem(DepthCameraSampler(scene.camera, SamplerParameters(**sampler)))
    localizer = builder.AddSystem(ContactLocalizer(scene.robot, scene.camera))
    for port in ("depth_image", "image_time"):
        builder.Connect(frames.GetOutputPort(port), localizer.GetInputPort(port))
    builder.ExportInput(frames.GetInputPort("depth_image"), "image")
    builder.ExportInput(localizer.GetInputPort("position_measured"), "position")
    return builder.Build(), localizer


def fixed(diagram, image, q):
    simulator = Simulator(diagram)
    value = ImageDepth32F(640, 480)
    value.mutable_data[..., 0] = image
    diagram.GetInputPort("image").FixValue(simulator.get_mutable_context(), AbstractValue.Make(value))
    diagram.GetInputPort("position").FixValue(simulator.get_mutable_context(), q)
    return simulator


def contact_of(localizer, root) -> ContactPoint:
    return localizer.GetOutputPort("contact_point").Eval(localizer.GetMyContextFromRoot(root))


def test_cloned_context_gives_the_same_contact(bench_scene):
    scene, touch, image = bench_scene
    diagram, localizer = closed_diagram(scene, image)
    simulator = fixed(diagram, image, touch.q)
    simulator.AdvanceTo(0.1)
    clone = simulator.get_context().Clone()
    simulator.AdvanceTo(0.25)
    Simulator(diagram, clone).AdvanceTo(0.25)
    a, b = contact_of(localizer, simulator.get_context()), contact_of(localizer, clone)
    assert a.found and a.stamp == b.stamp > 0.15
    np.testing.assert_array_equal(a.p_LC, b.p_LC)


@pytest.mark.parametrize(("fault", "status"), [("silent", CameraStatus.STALE), ("invalid", CameraStatus.INVALID)])
def test_faults_of_the_camera_show_within_a_tenth_of_a_second(bench_scene, fault, status):
    scene, touch, image = bench_scene
    diagram, localizer = closed_diagram(scene, image, fault=fault, fault_time=0.199)
    simulator = fixed(diagram, image, touch.q)
    port = localizer.GetOutputPort("camera_status")
    simulator.AdvanceTo(0.199)
    assert port.Eval(localizer.GetMyContextFromRoot(simulator.get_context()))[0] == CameraStatus.OK
    last_delivery = 5.0 / 30.0 + 0.01
    simulator.AdvanceTo(last_delivery + 0.1)
    assert port.Eval(localizer.GetMyContextFromRoot(simulator.get_context()))[0] == status
    assert not contact_of(localizer, simulator.get_context()).found


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("reach", 0.0),
        ("grow_distance", 0.03),
        ("least_scale", 1.5),
        ("support", 26),
        ("least_seen", -0.1),
        ("gate", 0.2),
        ("timeout", np.nan),
        ("least_thickness", -0.001),
        ("most_thickness", 0.001),
    ],
)
def test_bad_parameters_are_named(field, value):
    with pytest.raises(ParameterError) as error:
        LocalizerParameters(**{field: value})
    assert error.value.field == field


def test_bad_arguments_are_named(scene):
    with pytest.raises(ParameterError, match="background"):
        ContactLocalizer(scene.robot, scene.camera, background=np.zeros((3, 3), np.float32))
    with pytest.raises(ParameterError, match="period"):
        ContactLocalizer(scene.robot, scene.camera, period=0.0)
