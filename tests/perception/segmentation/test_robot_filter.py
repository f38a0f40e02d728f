"""What is left of an image without the robot is the person."""

import numpy as np
import pytest
from camera_scene import HandScene, place_finder

from saphari_drake.errors import ParameterError
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.contact.parameters import LocalizerParameters
from saphari_drake.perception.contact.places import PlaceFinder
from saphari_drake.perception.segmentation.parameters import SegmentationParameters
from saphari_drake.perception.segmentation.robot_filter import RobotFilter
from saphari_drake.robots.shapes import LinkShapes


@pytest.fixture(scope="module")
def scene():
    return HandScene(radius=0.010)


@pytest.fixture(scope="module")
def camera(scene):
    return place_finder(scene).camera


def test_human_points_lie_on_the_hand(scene, camera):
    touch = scene.random_touch(np.random.default_rng(9))
    points = camera.person(scene.image(touch.q, touch), touch.R_WL, touch.p_WL).points
    along = (points - touch.p_WC) @ touch.finger
    across = np.linalg.norm(points - touch.p_WC - along[:, None] * touch.finger, axis=1)
    assert len(points) > 10
    assert np.all((along > 0.0) & (along < 0.5) & (across < 0.06))
    assert along.max() > 0.2  # the forearm outside the reach belongs to the person too


def test_empty_image_shows_nothing(scene, camera):
    q = scene.robot.home
    for value in (0.0, np.nan, np.inf):
        image = np.full((480, 640), value, dtype=np.float32)
        person = camera.person(image, *scene.poses(q))
        assert (len(person.readings.point), person.seen, len(person.points)) == (0, 0.0, 0)


def test_robot_out_of_view_is_not_seen(scene):
    away = CameraParameters(target=[-3.0, 0.0, 1.0])
    camera = RobotFilter(scene.robot.shapes, away, SegmentationParameters())
    person = camera.person(np.full((480, 640), 1.0, np.float32), *scene.poses(scene.robot.home))
    assert (len(person.readings.point), person.seen) == (0, 0.0)


def test_shapes_of_the_base_are_removed_but_never_touched(scene):
    shapes = scene.robot.shapes
    only_base = LinkShapes(
        np.full_like(shapes.link, -1), shapes.kind, shapes.size, *shapes.in_world(*scene.poses(scene.robot.home))
    )
    params = LocalizerParameters()
    finder = PlaceFinder(RobotFilter(only_base, scene.camera, params), params)
    touch = scene.random_touch(np.random.default_rng(3))
    assert finder.look(scene.image(touch.q, touch), touch.R_WL, touch.p_WL).places == []


@pytest.mark.parametrize(
    ("field", "value"), [("reach", 0.0), ("grow_distance", 0.03), ("least_scale", 1.5), ("support", 26)]
)
def test_bad_parameters_are_named(field, value):
    with pytest.raises(ParameterError) as error:
        SegmentationParameters(**{field: value})
    assert error.value.field == field


def test_background_of_another_size_is_named(scene):
    with pytest.raises(ParameterError, match="background"):
        RobotFilter(scene.robot.shapes, scene.camera, SegmentationParameters(), np.zeros((3, 3), np.float32))
