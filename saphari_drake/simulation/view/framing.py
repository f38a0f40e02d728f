"""Where a viewer stands so that what moves fills the picture."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex

Array = NDArray[np.float64]
FIELD = np.deg2rad(75.0)  # of Meshcat's camera, from the bottom to the top
FILLED, ASPECT = 0.8, 1.3  # share of the picture that is used, and its width over its height at least
LOOKS = 12  # frames that are looked at
BODY = 0.1  # m; how far a body reaches around its origin


def framed(
    plant: MultibodyPlant, frames: Array, camera: ArrayLike, more: Sequence[ArrayLike] = ()
) -> tuple[Array, Array]:
    """Return eye and target (3,) each, that see all moving bodies in all frames (k, nq) from the side of a camera.

    `more` are other points to see, (3,) or (m, 3) each (m); those that are not finite are none.

    The direction of the view (from its eye to its target) stays; how far away the eye is, and where it looks, follow
    from what there is to see.
    """
    eye, target = np.asarray(camera, dtype=float).reshape(2, 3)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else np.array([1.0, 0.0, 0.0])
    view = np.array([right, np.cross(right, ahead), ahead])
    others = np.concatenate([np.zeros((0, 3)), *(np.atleast_2d(np.asarray(p, dtype=float)) for p in more)])
    others = others[np.isfinite(others).all(axis=1)]
    points = np.concatenate([_origins(plant, frames), others]) @ view.T
    half = np.tan(0.5 * FIELD) * FILLED * np.array([ASPECT, 1.0])
    low, high = points.min(axis=0) - BODY, points.max(axis=0) + BODY
    middle = 0.5 * (low[:2] + high[:2])
    away = np.max((np.abs(points[:, :2] - middle) + BODY) / half - points[:, 2:] + BODY)
    centre = view.T @ np.array([*middle, 0.5 * (low[2] + high[2])])
    return view.T @ np.array([*middle, -away]), centre


def _origins(plant: MultibodyPlant, frames: Array) -> Array:
    """Origins (m, 3) of all bodies in the world, at some of the frames."""
    context, found = plant.CreateDefaultContext(), []
    bodies = [plant.get_body(index) for index in map(BodyIndex, range(1, plant.num_bodies()))]
    bodies = [body for body in bodies if not plant.IsAnchored(body)] or bodies
    for q in frames[np.unique(np.linspace(0, len(frames) - 1, LOOKS).astype(int))]:
        plant.SetPositions(context, q)
        found += [body.EvalPoseInWorld(context).translation() for body in bodies]
    return np.array(found)
