"""Replay: a log played into one Meshcat page that opens without a network, starts by itself and repeats."""

from __future__ import annotations

import html
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import (
    Cylinder,
    Meshcat,
    MeshcatAnimation,
    MeshcatCone,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.files import write_text

Array = NDArray[np.float64]

ROOT = "/drake/overlays"


@dataclass(frozen=True)
class Arrow:
    """An arrow whose length follows a vector; it is hidden while that is zero or not finite.

    Attributes
    ----------
    name : str
    tail : (T, 3) or (3,) array
        Where it starts, in the world (m).
    vector : (T, 3) array
        What it shows, in world axes.
    scale : float
        Length per unit of the vector (m).
    color : (r, g, b) or (r, g, b, a)
        From 0 to 1.
    visible : (T,) array, optional
        When to show it; default: always.
    radius : float
        Radius of the shaft (m).
    """

    name: str
    tail: ArrayLike
    vector: ArrayLike
    scale: float = 0.01
    color: Sequence[float] = (0.84, 0.37, 0.0)
    visible: ArrayLike | None = None
    radius: float = 0.008


@dataclass(frozen=True)
class Marker:
    """A ball at a point; it is hidden while that is not finite.

    Attributes
    ----------
    name : str
    position : (T, 3) or (3,) array
        Its centre in the world (m).
    radius : float
        In m.
    color : (r, g, b) or (r, g, b, a)
        From 0 to 1.
    visible : (T,) array, optional
        When to show it; default: always.
    """

    name: str
    position: ArrayLike
    radius: float = 0.015
    color: Sequence[float] = (0.0, 0.45, 0.7)
    visible: ArrayLike | None = None


def write_replay(
    path: str | Path,
    build: Callable[[DiagramBuilder], MultibodyPlant],
    times: ArrayLike,
    positions: ArrayLike,
    overlays: Sequence[Arrow | Marker] = (),
    *,
    fps: float = 30.0,
    camera: ArrayLike = ((1.5, 1.1, 1.0), (0.0, 0.0, 0.5)),
    title: str = "",
) -> None:
    """Write one HTML file that plays a log.

    Parameters
    ----------
    path : path
        File to write.
    build : callable
        Adds a plant and its scene graph to a builder, finalizes it, and returns it.
    times : (T,) array
        Increasing sample times (s); the first one is the start of the replay.
    positions : (T, nq) array
        Positions of the plant; frames between samples are interpolated.
    overlays : sequence of Arrow and Marker
        Drawn besides the plant; their arrays have a row for each of `times`.
    fps : float
        Frames a second.
    camera : (2, 3) array
        Where the viewer stands and the point looked at, in the world (m).
    title : str
        Text shown at the top of the page.

    Raises
    ------
    ParameterError
        If sizes do not fit.
    """
    stamps, q = np.asarray(times, dtype=float), np.asarray(positions, dtype=float)
    if stamps.ndim != 1 or stamps.size == 0 or not np.all(np.diff(stamps) > 0.0):
        raise ParameterError("times", "must be a list of increasing times")
    if not (np.isfinite(fps) and fps > 0.0):
        raise ParameterError("fps", f"must be positive and finite, got {fps}")
    names = [overlay.name for overlay in overlays]
    if len(set(names)) != len(names):
        raise ParameterError("overlays", f"each needs a name of its own, got {', '.join(names)}")
    frame_times = stamps[0] + np.arange(int((stamps[-1] - stamps[0]) * fps + 1e-9) + 1) / fps
    meshcat = start_meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
    meshcat.StartRecording(fps, set_visualizations_while_recording=False)
    animation = meshcat.get_mutable_recording()
    _record_plant(meshcat, build, stamps, q, frame_times, fps)
    for overlay in overlays:
        _record_overlay(meshcat, animation, overlay, stamps, frame_times)
    meshcat.StopRecording()
    animation.set_autoplay(True)
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(100000)
    meshcat.PublishRecording()
    eye, target = np.asarray(camera, dtype=float).reshape(2, 3)
    meshcat.SetCameraPose(eye, target)
    write_text(path, _with_title(meshcat.StaticHtml(), title))


def start_meshcat(params: MeshcatParams | None = None) -> Meshcat:
    """Start a Meshcat server without the note that Drake prints about it."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        return Meshcat(params or MeshcatParams())
    finally:
        logger.setLevel(level)


def _record_plant(
    meshcat: Meshcat,
    build: Callable[[DiagramBuilder], MultibodyPlant],
    stamps: Array,
    positions: Array,
    frame_times: Array,
    fps: float,
) -> None:
    builder = DiagramBuilder()
    plant = build(builder)
    if positions.ndim != 2 or positions.shape[1] != plant.num_positions():
        raise ParameterError("positions", f"the plant has {plant.num_positions()} positions, got {positions.shape}")
    if not np.all(np.isfinite(positions)):
        row = int(np.argmin(np.all(np.isfinite(positions), axis=1)))
        raise ParameterError("positions", f"row {row} is not finite")
    q = _rows(stamps, _continuous(plant, positions), frame_times, "positions")
    scene_graph = next(system for system in builder.GetSystems() if isinstance(system, SceneGraph))
    visualizer = MeshcatVisualizer.AddToBuilder(
        builder, scene_graph, meshcat, MeshcatVisualizerParams(publish_period=1.0 / fps)
    )
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(root)
    visualizer_context = visualizer.GetMyContextFromRoot(root)
    for frame, frame_positions in enumerate(q):
        # The frame number is rounded down; half a frame keeps it away from the edge.
        root.SetTime((frame + 0.5) / fps)
        plant.SetPositions(plant_context, frame_positions)
        visualizer.ForcedPublish(visualizer_context)


def _continuous(plant: MultibodyPlant, positions: Array) -> Array:
    """Return positions in which no quaternion changes its sign from row to row, so that they can be interpolated."""
    result = positions.copy()
    for index in plant.GetFloatingBaseBodies():
        body = plant.get_body(index)
        if body.has_quaternion_dofs():
            start = body.floating_positions_start()
            part = result[:, start : start + 4]
            turned = np.sum(part[1:] * part[:-1], axis=1) < 0.0
            part[1:] *= np.where(np.cumsum(turned) % 2 == 1, -1.0, 1.0)[:, None]
    return result


def _record_overlay(
    meshcat: Meshcat, animation: MeshcatAnimation, overlay: Arrow | Marker, stamps: Array, frame_times: Array
) -> None:
    path = f"{ROOT}/{overlay.name}"
    color = Rgba(*overlay.color)
    anchor = overlay.tail if isinstance(overlay, Arrow) else overlay.position
    points = _rows(stamps, np.atleast_2d(np.asarray(anchor, dtype=float)), frame_times, overlay.name)
    shown = np.ones(frame_times.size, dtype=bool)
    if overlay.visible is not None:
        given = np.asarray(overlay.visible, dtype=float).reshape(-1, 1)
        shown = _rows(stamps, given, frame_times, f"{overlay.name}.visible", nearest=True)[:, 0] > 0.5
    shown &= np.all(np.isfinite(points), axis=1)
    if isinstance(overlay, Marker):
        meshcat.SetObject(path, Sphere(overlay.radius), color)
        vectors = np.tile([0.0, 0.0, 1.0], (frame_times.size, 1))
    else:
        vectors = overlay.scale * _rows(stamps, np.asarray(overlay.vector, dtype=float), frame_times, overlay.name)
        shown &= np.nan_to_num(np.linalg.norm(vectors, axis=1)) > 1e-6
        # The shaft is a cylinder of length 1 from the tail on, stretched; the head keeps its size at the tip.
        meshcat.SetObject(f"{path}/shaft/body", Cylinder(overlay.radius, 1.0), color)
        meshcat.SetTransform(f"{path}/shaft/body", RigidTransform([0.0, 0.0, 0.5]))
        head = MeshcatCone(4.0 * overlay.radius, 2.2 * overlay.radius, 2.2 * overlay.radius)
        meshcat.SetObject(f"{path}/head/body", head, color)
        flipped = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 0.0])
        meshcat.SetTransform(f"{path}/head/body", flipped)
    last: bool | None = None
    for frame, (point, vector, visible) in enumerate(zip(points, vectors, shown)):
        if bool(visible) != last:
            last = bool(visible)
            animation.SetProperty(frame, path, "visible", last)
        if not visible:
            continue
        length = float(np.linalg.norm(vector))
        rotation = RotationMatrix.MakeFromOneVector(vector / length, 2)
        animation.SetTransform(frame, path, RigidTransform(rotation, point))
        if isinstance(overlay, Arrow):
            shaft = max(length - 4.0 * overlay.radius, 1e-4)
            animation.SetProperty(frame, f"{path}/shaft", "scale", [1.0, 1.0, shaft])
            animation.SetTransform(frame, f"{path}/head", RigidTransform([0.0, 0.0, max(length, 4.0 * overlay.radius)]))


def _rows(stamps: Array, values: Array, at: Array, name: str, nearest: bool = False) -> Array:
    """Return `values` at the times `at`, interpolated or from the nearest sample; one row holds for all times."""
    if values.ndim == 2 and values.shape[0] == 1:
        return np.repeat(values, at.size, axis=0)
    if values.ndim != 2 or values.shape[0] != stamps.size:
        raise ParameterError(name, f"needs a row for each of {stamps.size} times, got shape {values.shape}")
    if nearest:
        return values[np.argmin(np.abs(at[:, None] - stamps[None, :]), axis=1)]
    return np.column_stack([np.interp(at, stamps, column) for column in values.T])


def _with_title(page: str, title: str) -> str:
    if not title:
        return page
    text = html.escape(title)
    style = (
        "position:fixed;top:0.6em;left:0;right:0;text-align:center;pointer-events:none;z-index:10;"
        "font:16px sans-serif;color:#222"
    )
    page = page.replace("<title>Drake MeshCat</title>", f"<title>{text}</title>", 1)
    head, body, rest = page.rpartition("</body>")
    return f'{head}<div style="{style}">{text}</div>{body}{rest}'
