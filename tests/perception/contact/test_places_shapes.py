"""Fingers, fists and forearms: each is taken for what it is, by one camera with noise and nothing else."""

import numpy as np
import pytest
from experiments.localization.parameters import SceneParameters
from experiments.localization.scenes import ContactScenes

from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.contact.parameters import LocalizerParameters
from saphari_drake.perception.contact.places import PlaceFinder
from saphari_drake.perception.segmentation.background import background_depth
from saphari_drake.perception.segmentation.robot_filter import RobotFilter

COUNT = 12


@pytest.fixture(scope="module")
def scenes(lwr4):
    return ContactScenes(lwr4, [CameraParameters(renderer="raycast")], SceneParameters(), 3)


@pytest.fixture(scope="module")
def finder(scenes, lwr4):
    params = LocalizerParameters()
    background = background_depth(scenes.background(0, np.random.default_rng(0)), params)
    return PlaceFinder(RobotFilter(lwr4.shapes, scenes.cameras[0], params, background), params)


def seen_touches(scenes, finder, kind):
    """Each explanation of visible touches of links 3 to 6, with the true point in the world."""
    found, drawn = [], 0
    while len(found) < COUNT:
        rng = np.random.default_rng([drawn, 5])
        touch = scenes.draw(rng, 2 + drawn % 4, kind)
        image, drawn = scenes.images([touch], touch.q)[0], drawn + 1
        if scenes.visible(image, 0, touch):
            terms = scenes.poses(touch.q)
            seen = finder.look(scenes.noisy(image, 0, rng), terms.R_WL, terms.p_WL).places
            true = terms.p_WL[touch.link] + terms.R_WL[touch.link] @ touch.p_L
            errors = [np.linalg.norm(terms.p_WL[s.link] + terms.R_WL[s.link] @ s.p_LC - true) for s in seen]
            found.append((seen, errors))
    return found


@pytest.mark.parametrize(("kind", "bound"), [("finger", 0.006), ("fist", 0.006), ("forearm", 0.006)])
def test_what_touches_is_found_by_its_shape(scenes, finder, kind, bound):
    """Half of the touches within 6 mm, though a limb's contact lies some centimetres behind what is seen of it."""
    chosen = [errors[int(np.argmin([s.cost for s in seen]))] for seen, errors in seen_touches(scenes, finder, kind)]
    assert np.median(chosen) < bound


def test_a_forearm_is_a_limb_and_a_finger_is_none(scenes, finder):
    """At least five of six, by the cheaper explanation."""

    def limbs(kind):
        return np.mean([min(seen, key=lambda s: s.cost).limb for seen, _ in seen_touches(scenes, finder, kind)])

    assert limbs("forearm") >= 5 / 6
    assert limbs("finger") <= 1 / 6


def test_beside_a_limb_that_goes_on_to_both_sides_nothing_thin_is_likely(scenes, finder):
    """That costs more than any width does."""
    costs = [seen[0].cost for seen, _ in seen_touches(scenes, finder, "forearm") if len(seen) == 2]
    assert np.median(costs) > 30.0
