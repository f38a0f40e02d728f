"""People of the localization's scenes: they touch where they are said to, and are as large as people are."""

import numpy as np
import pytest
from experiments.localization.parameters import SceneParameters
from experiments.localization.people import People
from experiments.localization.scenes import ContactScenes

from saphari_drake.math.primitives import nearest_surface_point
from saphari_drake.perception.camera.model import CameraParameters


@pytest.fixture(scope="module")
def scenes(lwr4):
    params = SceneParameters(people="measured", hands=2, sleeve_sigma=0.004)
    return ContactScenes(lwr4, [CameraParameters()], params)


@pytest.mark.parametrize("kind", People.kinds)
def test_body_touches_at_the_contact_and_nowhere_else(scenes, kind):
    touch = scenes.draw(np.random.default_rng(3), 4, kind)
    terms, shapes = scenes.poses(touch.q), scenes.robot.shapes
    R_WS, p_WS = shapes.in_world(terms.R_WL, terms.p_WL)
    p_W = scenes.contact(touch)
    least = {}
    for shape, X, name in scenes.hands.parts(scenes.hands.body(kind), touch.hand):
        half = shape.length() / 2 if hasattr(shape, "length") else 0.0
        for t in np.linspace(-half, half, 25):
            centre = terms.p_WL[4] + terms.R_WL[4] @ (touch.X_LH @ X @ np.array([0.0, 0.0, t]))
            everything = np.ones(shapes.count, dtype=bool)
            _, d, surface, _ = nearest_surface_point(shapes.kind, shapes.size, R_WS, p_WS, everything, centre)
            if d - shape.radius() < least.get("gap", (np.inf,))[0]:
                least["gap"] = d - shape.radius(), name, np.linalg.norm(surface - p_W)
    gap, _, away = least["gap"]
    assert -5e-4 < gap < 2e-3
    assert away < 0.04


def test_persons_differ_and_lie_within_their_percentiles(scenes):
    people = People(SceneParameters(people="measured", hands=200), np.random.default_rng(0)).people
    fists, heads = (np.array([person[name] for person in people]) for name in ("fist", "head"))
    assert fists.min() < 0.038 and fists.max() > 0.048
    assert fists.min() >= 0.036 and fists.max() <= 0.050
    assert np.corrcoef(fists, heads)[0, 1] > 0.8  # who has large fists has a large head
