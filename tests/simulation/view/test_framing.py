"""Whatever moves is in the picture, fills it, and is seen from the side that was asked for."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from saphari_drake.simulation.view.framing import FIELD, framed

SIDES = [
    ((-0.85, 1.2, 0.95), (0.0, 0.4, 0.55)),
    ((2.5, 0.0, 11.0), (2.5, 0.1, 0.0)),
    ((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)),
]


@pytest.mark.parametrize("camera", SIDES)
def test_all_that_moves_is_seen_and_fills_the_picture(lwr4, camera):
    plant = MultibodyPlant(0.0)
    lwr4.add_to(plant)
    plant.Finalize()
    frames = np.linspace(lwr4.home, lwr4.home + 0.5, 30)
    far = np.array([1.0, -1.0, 0.5])
    for more in ([], [far, np.full((2, 3), np.nan)]):
        eye, target = framed(plant, frames, camera, more)
        ahead = (target - eye) / np.linalg.norm(target - eye)
        asked = np.subtract(*camera[::-1])
        np.testing.assert_allclose(ahead, asked / np.linalg.norm(asked), atol=1e-9)
        points = np.concatenate([*(lwr4.kinematics(q).p_WL for q in frames[::29]), *map(np.atleast_2d, more[:1])])
        away = points - eye
        depth = away @ ahead
        angle = np.arctan2(np.linalg.norm(away - np.outer(depth, ahead), axis=1), depth)
        assert depth.min() > 0.1 and 0.4 < angle.max() / (0.5 * FIELD) < 1.3
