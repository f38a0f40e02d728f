"""The localizer in a diagram: time stamps, several cameras, hidden contacts, and what cannot be used."""

import os
import subprocess
import sys

import numpy as np
import pytest
from bench import Bench as SystemBench
from camera_scene import HandScene, likeliest, noisy, place_finder
from experiments.localization.parameters import SceneParameters
from experiments.localization.pushes import wandering_forces
from experiments.localization.scenes import ContactScenes
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.errors import ParameterError
from saphari_drake.messages import CameraStatus, ContactPoint
from saphari_drake.perception.camera.model import CameraParameters, camera_pose
from saphari_drake.perception.contact.localizer import ContactLocalizer
from saphari_drake.perception.contact.parameters import FusionParameters, LocalizerParameters
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.simulation.sensors.depth_noise import DepthCameraSampler, SamplerParameters


@pytest.fixture(scope="module")
def scene():
    return HandScene(radius=0.010)


@pytest.fixture(scope="module")
def finder(scene):
    return place_finder(scene)


class Bench:
    """The system alone, its inputs set by hand."""

    def __init__(self, scene, **params):
        self.system = ContactLocalizer(scene.robot, [scene.camera], LocalizerParameters(**params))
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


def test_posture_at_the_time_stamp_counts_not_the_present_one(bench_scene, finder):
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
    expected, _ = likeliest(finder, image, touch)
    late = touch._replace(**dict(zip(("R_WL", "p_WL"), scene.poses(touch.q + speed * 0.0475))))
    stale, _ = likeliest(finder, image, late)
    assert contact.found and contact.link == expected.link
    assert contact.stamp == 0.0525
    np.testing.assert_allclose(contact.p_LC, expected.p_LC, atol=1e-4)
    assert stale.link != contact.link or np.linalg.norm(stale.p_LC - expected.p_LC) > 3e-3


def test_residual_of_the_frame_s_own_time_moves_the_point(bench_scene, finder):
    """A force beside the seen point draws it there; one that is felt only after the frame was taken does not."""
    scene, touch, image = bench_scene
    seen, _ = likeliest(finder, image, touch)
    terms = evaluate_dynamics(scene.robot, touch.q, np.zeros(7))
    side = np.cross(seen.n_L, [0.3, 0.5, 0.8])
    beside, n_L = scene.robot.shapes.nearest_on(seen.link, seen.p_LC + 0.008 * side / np.linalg.norm(side))
    r = terms.point(seen.link, beside).Jv_WC.T @ (-30.0 * terms.R_WL[seen.link] @ n_L)

    def point(changes):
        bench = Bench(scene, torque_sigma=0.01)
        bench.set("position_measured", touch.q)
        for time, value in changes:
            bench.advance(time)
            bench.set("torque_external", value)
        bench.advance(0.05)
        bench.frame(image, 0.02)
        bench.advance(0.06)
        return bench.get("contact_point").p_LC

    felt, late = point([(0.0, r)]), point([(0.0, np.zeros(7)), (0.04, r)])
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


@pytest.mark.parametrize("frozen_frames", [0, 2])
def test_a_frame_that_comes_again_and_again_is_stale_where_none_can(bench_scene, frozen_frames):
    """Until one comes that is new."""
    scene, touch, image = bench_scene
    bench, seen = Bench(scene, frozen_frames=frozen_frames), []
    bench.set("position_measured", touch.q)
    for k in range(8):
        noise = 0.0 if 2 < k < 6 else 1e-4 * k
        bench.frame(np.where(image > 0.0, image + np.float32(noise), image), 0.03 * k)
        bench.advance(0.03 * k + 0.01)
        seen.append(bench.get("camera_status"))
    stale = [k for k, status in enumerate(seen) if status == CameraStatus.STALE]
    assert stale == ([5] if frozen_frames else [])
    assert seen[-1] == CameraStatus.OK


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


def test_posture_that_is_not_finite_is_invalid_until_it_is_known_again(bench_scene):
    scene, touch, image = bench_scene
    bench = Bench(scene)
    bench.set("position_measured", touch.q)
    bench.frame(image, 0.0)
    bench.advance(0.011)
    assert bench.get("contact_point").found
    bench.set("position_measured", np.full(scene.robot.n, np.nan))
    bench.advance(0.016)
    bench.frame(image, 0.015)
    bench.advance(0.021)
    assert bench.get("camera_status") == CameraStatus.INVALID
    assert not bench.get("contact_point").found
    assert len(bench.get("human_points")) == 0
    bench.set("position_measured", touch.q)
    bench.advance(0.035)
    bench.frame(image, 0.035)
    bench.advance(0.041)
    assert bench.get("camera_status") == CameraStatus.OK
    assert bench.get("contact_point").found


@pytest.mark.parametrize("size", [(320, 240), (480, 640), (1, 1)])
def test_image_of_another_size_is_invalid(bench_scene, size):
    scene, touch, image = bench_scene
    bench = Bench(scene)
    bench.set("position_measured", touch.q)
    bench.frame(image, 0.0)
    bench.advance(0.011)
    other = ImageDepth32F(*size)
    other.mutable_data[:] = 1.0
    bench.set("depth_image", AbstractValue.Make(other))
    bench.set("image_time", [0.01])
    bench.advance(0.021)
    assert bench.get("camera_status") == CameraStatus.INVALID
    assert not bench.get("contact_point").found


def test_residual_that_is_not_finite_counts_as_none(bench_scene):
    scene, touch, image = bench_scene
    points = []
    for r in (None, np.full(scene.robot.n, np.nan), np.full(scene.robot.n, np.inf)):
        bench = Bench(scene)
        bench.set("position_measured", touch.q)
        if r is not None:
            bench.set("torque_external", r)
        bench.frame(image, 0.0)
        bench.advance(0.011)
        points.append(bench.get("contact_point").p_LC)
    np.testing.assert_array_equal(points[1], points[0])
    np.testing.assert_array_equal(points[2], points[0])


def test_another_link_must_be_seen_twice(scene, finder):
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
    localizer = builder.AddSystem(ContactLocalizer(scene.robot, [scene.camera]))
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


# ---- what is felt --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scenes(lwr4):
    return ContactScenes(lwr4, [CameraParameters()], SceneParameters(hands=2))


def seen_touch(scenes, seed):
    rng = np.random.default_rng(seed)
    while True:
        touch = scenes.draw(rng, int(rng.integers(3, 6)), "finger")
        image = scenes.images([touch], touch.q)[0]
        if scenes.visible(image, 0, touch):
            terms = scenes.poses(touch.q)
            F = terms.R_WL[touch.link] @ wandering_forces(rng, touch, 1, scenes.params)[0]
            return touch, image, terms, F, terms.point(touch.link, touch.p_L).Jv_WC.T @ F


@pytest.fixture(scope="module")
def system(lwr4):
    return ContactLocalizer(lwr4, [CameraParameters()], fusion=FusionParameters(torque_sigma=0.05))


def frame(image):
    value = ImageDepth32F(640, 480)
    value.mutable_data[..., 0] = image
    return value


def test_correction_of_the_camera_s_pose_moves_the_contact_by_as_much(scenes, lwr4):
    """A camera that is taken to be beside its place, and corrected, finds what one in its place does."""
    touch, image, _, _, r = seen_touch(scenes, 3)
    away = RigidTransform([0.0, 0.012, 0.0])
    found = []
    for pose, X_correct in ((RigidTransform(), None), (away, away.inverse()), (away, None)):
        X_WC = pose @ camera_pose(CameraParameters())
        fusion = FusionParameters(torque_sigma=0.05)
        system = ContactLocalizer(lwr4, [CameraParameters()], poses=[X_WC], fusion=fusion)
        bench = SystemBench(
            system, position_measured=touch.q, torque_external=r, depth_image=frame(image), image_time=0.0
        )
        if X_correct is not None:
            bench.set(correction=X_correct)
        bench.run(2)
        found.append(bench.read("contact_point"))
    true, corrected, plain = found
    np.testing.assert_allclose(corrected.p_LC, true.p_LC, atol=1e-6)
    assert plain.link != true.link or np.linalg.norm(plain.p_LC - true.p_LC) > 0.003


def test_fusion_finds_holds_and_clones(system, scenes):
    touch, image, _, F, r = seen_touch(scenes, 3)
    bench = SystemBench(system, position_measured=touch.q, torque_external=r, depth_image=frame(image), image_time=0.0)
    bench.run(2)
    contact = bench.read("contact_point")
    assert contact.found and contact.link == touch.link
    assert np.linalg.norm(contact.p_LC - touch.p_L) < 0.02
    assert np.linalg.norm(bench.read("contact_force") - F) < 0.3 * np.linalg.norm(F)
    assert bench.read("camera_status") == 1.0
    assert not bench.read("second_contact_point").found
    clone = bench.clone()
    for other in (bench, clone):
        other.run(4, image_time=0.01)
    np.testing.assert_array_equal(bench.read("contact_point").p_LC, clone.read("contact_point").p_LC)
    bench.run(40)
    assert bench.read("camera_status") == 2.0  # stale
    assert not bench.read("contact_point").found


def test_fusion_without_a_finite_residual_knows_what_is_seen_and_no_force(system, scenes):
    touch, image, _, _, r = seen_touch(scenes, 3)
    bench = SystemBench(
        system, position_measured=touch.q, torque_external=r * np.nan, depth_image=frame(image), image_time=0.0
    )
    bench.run(2)
    contact = bench.read("contact_point")
    assert contact.found and np.linalg.norm(contact.p_LC - touch.p_L) < 0.02
    np.testing.assert_allclose(bench.read("contact_force"), np.zeros(3), atol=1e-9)
    bench.run(1, position_measured=np.full(7, np.nan))
    bench.run(1, image_time=0.013)
    assert bench.read("camera_status") == CameraStatus.INVALID
    assert not bench.read("contact_point").found


def hidden_touch(scenes, seed):
    """A finger on one of the last links that the camera does not see, its forearm in view."""
    rng = np.random.default_rng(seed)
    while True:
        touch = scenes.draw(rng, 5, "finger")
        image = scenes.images([touch], touch.q)[0]
        if not scenes.visible(image, 0, touch):
            terms = scenes.poses(touch.q)
            F = terms.R_WL[touch.link] @ (25.0 * -touch.n_L)
            return touch, image, terms.point(touch.link, touch.p_L).Jv_WC.T @ F


def test_hidden_touch_is_found_after_frames_that_agree_and_forgotten_with_its_residual(system, scenes):
    errors = []
    for seed in range(4):
        touch, image, r = hidden_touch(scenes, seed)
        inputs = {"position_measured": touch.q, "torque_external": r, "torque_noise": np.full(7, 0.05)}
        bench = SystemBench(system, **inputs, depth_image=frame(image), image_time=0.0)
        found = []
        for k in range(4):
            bench.run(2, image_time=0.01 * k)
            found.append(bench.read("contact_point").found)
        contact = bench.read("contact_point")
        errors.append(np.linalg.norm(contact.p_LC - touch.p_L) if contact.link == touch.link else 1.0)
        clone = bench.clone()
        for other in (bench, clone):
            other.run(8, torque_external=np.zeros(7))
            other.run(2, image_time=0.08)
        assert bench.read("contact_point").found == clone.read("contact_point").found
        assert np.all(bench.read("contact_force") == 0.0)
    assert np.median(errors) < 0.01


def test_a_residual_that_friction_turns_is_believed_less_and_less(system, scenes):
    """Where the person is seen, 0.6 Nm of friction in each joint move the point by a few millimetres, in 5 of 6."""
    errors = []
    for seed in range(6):
        touch, image, _, _, r = seen_touch(scenes, seed)
        wrong = r + 0.6 * np.random.default_rng(seed).choice([-1.0, 1.0], 7)
        bench = SystemBench(
            system, position_measured=touch.q, torque_external=wrong, depth_image=frame(image), image_time=0.0
        )
        for k in range(15):
            bench.run(2, image_time=0.01 * k)
        contact = bench.read("contact_point")
        errors.append(np.linalg.norm(contact.p_LC - touch.p_L) if contact.link == touch.link else 1.0)
    assert np.sort(errors)[-2] < 0.008, errors


def test_torque_noise_that_is_not_finite_counts_as_the_parameter(system, scenes):
    touch, image, r = hidden_touch(scenes, 1)
    points = []
    for noise in (np.full(7, 0.05), np.full(7, np.nan), np.full(7, 0.001)):
        bench = SystemBench(
            system, position_measured=touch.q, torque_external=r, torque_noise=noise, depth_image=frame(image),
            image_time=0.0,
        )  # fmt: skip
        bench.run(2)
        bench.run(2, image_time=0.01)
        points.append(bench.read("contact_point").p_LC)
    np.testing.assert_array_equal(points[1], points[0])
    np.testing.assert_array_equal(points[2], points[0])


# ---- several cameras -----------------------------------------------------------------------------------------------


def two_cameras(scene, touch, image, **inputs):
    """A bench with the scene's camera and one that looks away."""
    away = CameraParameters(target=[-3.0, 0.0, 1.1])
    system = ContactLocalizer(scene.robot, [scene.camera, away], LocalizerParameters(least_seen=0.0))
    nothing = frame(np.full((480, 640), np.inf))
    return SystemBench(
        system, position_measured=touch.q, depth_image_0=frame(image), image_time_0=-1.0, depth_image_1=nothing,
        image_time_1=-1.0, **inputs,
    )  # fmt: skip


def test_camera_that_sees_the_contact_counts(bench_scene):
    """As one camera alone finds it; frames of the other one, later or at once, do not end the contact."""
    scene, touch, image = bench_scene
    alone = Bench(scene)
    alone.set("position_measured", touch.q)
    alone.frame(image, 0.0)
    alone.advance(0.011)
    bench = two_cameras(scene, touch, image)
    bench.run(2, image_time_0=0.0, image_time_1=0.0)
    np.testing.assert_array_equal(bench.read("contact_point").p_LC, alone.get("contact_point").p_LC)
    np.testing.assert_array_equal(bench.read("human_points"), alone.get("human_points"))
    bench.run(2, image_time_1=0.012)
    assert bench.read("contact_point").found
    bench.run(2, depth_image_0=frame(scene.image(touch.q)), image_time_0=0.022)
    assert not bench.read("contact_point").found


def test_status_is_that_of_the_worst_camera_and_the_others_go_on(bench_scene):
    scene, touch, image = bench_scene
    bench = two_cameras(scene, touch, image)
    bench.run(2, image_time_0=0.0)
    assert bench.read("camera_status") == CameraStatus.WAITING
    for k in range(1, 20):
        bench.run(2, image_time_0=0.01 * k)
    assert bench.read("camera_status") == CameraStatus.STALE
    assert bench.read("contact_point").found
    bench.run(40)
    assert not bench.read("contact_point").found


def test_bad_arguments_are_named(scene):
    for field, value in (("memory", 1.5), ("rcond", 0.0), ("free_to", 0.01), ("felt", np.nan)):
        with pytest.raises(ParameterError) as error:
            FusionParameters(**{field: value})
        assert error.value.field == field
    with pytest.raises(ParameterError, match="cameras"):
        ContactLocalizer(scene.robot, [])
    with pytest.raises(ParameterError, match="backgrounds"):
        ContactLocalizer(scene.robot, [scene.camera], backgrounds=[None, None])
    with pytest.raises(ParameterError, match="background"):
        ContactLocalizer(scene.robot, [scene.camera], backgrounds=[np.zeros((3, 3), np.float32)])
    with pytest.raises(ParameterError, match="period"):
        ContactLocalizer(scene.robot, [scene.camera], period=0.0)


FRESH = """
import sys
import numpy as np
from bench import Bench
from camera_scene import HandScene
from numba.core.dispatcher import Dispatcher
from pydrake.systems.sensors import ImageDepth32F
from saphari_drake.perception.contact.localizer import ContactLocalizer

def compiled():
    modules = [module for name, module in sys.modules.items() if name.startswith("saphari_drake.")]
    kernels = {id(k): k for module in modules for k in vars(module).values() if isinstance(k, Dispatcher)}
    return {k.py_func.__qualname__: len(k.signatures) for k in kernels.values()}

scene = HandScene(radius=0.010)
touch = scene.random_touch(np.random.default_rng(21))
image = ImageDepth32F(640, 480)
image.mutable_data[..., 0] = scene.image(touch.q, touch)
system = ContactLocalizer(scene.robot, [scene.camera])
before = compiled()
residual = np.full(scene.robot.n, 20.0)
bench = Bench(system, position_measured=touch.q, torque_external=residual, depth_image=image, image_time=0.0)
for time in (0.0, 0.01, 0.02):
    bench.run(2, image_time=time)
assert bench.read("contact_point").found
after = compiled()
late = {name: (before[name], after[name]) for name in before if after[name] != before[name]}
assert not late, late
"""


def test_nothing_is_compiled_after_construction():
    """In a new process: a touch needs no kernel, and no kind of argument, that construction has not prepared."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run([sys.executable, "-c", FRESH], capture_output=True, text=True, env=environment)
    assert ended.returncode == 0, ended.stderr
