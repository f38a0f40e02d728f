"""A run as an animated picture: the plant rendered from where the replay's viewer stands, overlays drawn upon it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from saphari_drake.simulation.view.overlays import Arrow, Marker, shown_at

Array = NDArray[np.float64]
WIDTH, HEIGHT, FIELD = 480, 400, np.deg2rad(40.0)


def write_animation(
    path: Path,
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    times: Array,
    positions: Array,
    stamps: Array,
    overlays: Sequence[Arrow | Marker],
    camera: ArrayLike,
) -> None:
    """Write a GIF that shows a plant at given times, in real time.

    Parameters
    ----------
    path : Path
    builder, plant
        The finalized plant in a builder with its scene graph.
    times, positions : (F,) and (F, nq) arrays
        Times of the frames (s), and the positions of the plant at each.
    stamps : (T,) array
        Times of the overlays' rows (s).
    overlays : sequence of Arrow and Marker
    camera : (2, 3) array
        Where the viewer stands and the point looked at, in the world (m).
    """
    from PIL import Image, ImageDraw

    scene_graph = next(system for system in builder.GetSystems() if isinstance(system, SceneGraph))
    scene_graph.AddRenderer("animation", MakeRenderEngineVtk(RenderEngineVtkParams(default_clear_color=[1.0] * 3)))
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    plant_context, scene_context = plant.GetMyMutableContextFromRoot(root), scene_graph.GetMyContextFromRoot(root)
    eye, target = np.asarray(camera, dtype=float).reshape(2, 3)
    info, X_WC = CameraInfo(WIDTH, HEIGHT, FIELD), _looking(eye, target)
    core = RenderCameraCore("animation", info, ClippingRange(0.05, 20.0), RigidTransform())
    drawn = [(overlay, *shown_at(overlay, stamps, times)) for overlay in overlays]
    pictures = []
    for frame, q in enumerate(positions):
        plant.SetPositions(plant_context, q)
        query = scene_graph.get_query_output_port().Eval(scene_context)
        image = query.RenderColorImage(ColorRenderCamera(core), scene_graph.world_frame_id(), X_WC)
        picture = Image.fromarray(np.ascontiguousarray(image.data[:, :, :3]))
        draw = ImageDraw.Draw(picture)
        for overlay, points, vectors, shown in drawn:
            if shown[frame]:
                _draw(draw, info, X_WC, overlay, points[frame], vectors[frame])
        pictures.append(picture.quantize(64))
    period = 1000.0 * float(np.mean(np.diff(times))) if len(times) > 1 else 1000.0
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=round(period), loop=0, format="GIF")


def _looking(eye: Array, target: Array) -> RigidTransform:
    """Return the pose of a camera that looks along its z axis from `eye` to `target`, its y axis down."""
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), eye)


def _draw(draw, info: CameraInfo, X_WC: RigidTransform, overlay: Arrow | Marker, p: Array, vector: Array) -> None:
    """Draw an overlay over a picture; what lies behind the viewer is left out."""
    ends = [X_WC.inverse() @ point for point in (p, p + vector)]
    if min(end[2] for end in ends) < 0.05:
        return
    color = tuple(round(255.0 * c) for c in list(overlay.color)[:3])
    f, middle = info.focal_x(), np.array([WIDTH, HEIGHT]) / 2.0
    (u, v), tip = (f * end[:2] / end[2] + middle for end in ends)
    size = f * overlay.radius / ends[0][2]
    if isinstance(overlay, Marker):
        draw.ellipse([u - size, v - size, u + size, v + size], fill=color)
        return
    draw.line([u, v, *tip], fill=color, width=max(2, round(2.0 * size)))
    along = tip - [u, v]
    length = float(np.linalg.norm(along))
    if length > 1.0:
        along *= 3.0 * max(size, 1.5) / length
        side = 0.6 * np.array([-along[1], along[0]])
        end = tip + along
        draw.polygon([tuple(end), tuple(tip + side), tuple(tip - side)], fill=color)
