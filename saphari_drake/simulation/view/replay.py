"""Replay: a log played into one Meshcat page that opens without a network and repeats; or into an MCAP file."""

from __future__ import annotations

import html
import json
import logging
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import (
    Meshcat,
    MeshcatAnimation,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.record.files import write_text
from saphari_drake.simulation.view.animation import write_animation
from saphari_drake.simulation.view.framing import framed
from saphari_drake.simulation.view.mcap import McapFile
from saphari_drake.simulation.view.overlays import Arrow, Marker, record_overlay, rows_at

__all__ = ["Arrow", "Marker", "start_meshcat", "write_replay"]

Array = NDArray[np.float64]
ANIMATION_FPS = 10.0


def write_replay(
    path: str | Path | McapFile,
    build: Callable[[DiagramBuilder], MultibodyPlant],
    times: ArrayLike,
    positions: ArrayLike,
    overlays: Sequence[Arrow | Marker] = (),
    *,
    fps: float = 30.0,
    camera: ArrayLike = ((1.5, 1.1, 1.0), (0.0, 0.0, 0.5)),
    title: str = "",
    captions: Sequence[str] = (),
) -> None:
    """Write one HTML file that plays a log, or an animated picture of it, or add it to an MCAP file.

    Parameters
    ----------
    path : path or McapFile
        File to write, animated if it ends in .gif; or the open file to add to (which has no camera and no title).
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
        Where the viewer stands and the point looked at, in the world (m); of the page the direction alone: `framed`.
    title : str
        Text shown at the top of the page.
    captions : sequence of str
        What is told below it in words, one for each of `times`; of the page alone. Empty: nothing.

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
    if captions and len(captions) != stamps.size:
        raise ParameterError("captions", f"needs one for each of {stamps.size} times, got {len(captions)}")
    animated = not isinstance(path, McapFile) and Path(path).suffix == ".gif"
    fps = min(fps, ANIMATION_FPS) if animated else fps
    frame_times = stamps[0] + np.arange(int((stamps[-1] - stamps[0]) * fps + 1e-9) + 1) / fps
    builder = DiagramBuilder()
    plant = build(builder)
    frames = _frames(plant, stamps, q, frame_times)
    if isinstance(path, McapFile):
        path.add_replay(plant, builder.Build(), frame_times, frames, stamps, overlays)
        return
    if animated:
        write_animation(Path(path), builder, plant, frame_times, frames, stamps, overlays, camera)
        return
    meshcat = start_meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
    meshcat.StartRecording(fps, set_visualizations_while_recording=False)
    animation = meshcat.get_mutable_recording()
    _record_plant(meshcat, builder, plant, frames, fps)
    for overlay in overlays:
        record_overlay(meshcat, animation, overlay, stamps, frame_times)
    meshcat.StopRecording()
    animation.set_autoplay(True)
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(100000)
    meshcat.PublishRecording()
    markers = [item.position for item in overlays if isinstance(item, Marker) and item.visible is None]
    meshcat.SetCameraPose(*framed(plant, frames, camera, markers))
    write_text(path, _with_captions(_with_title(meshcat.StaticHtml(), title), stamps - stamps[0], captions))


def start_meshcat(params: MeshcatParams | None = None) -> Meshcat:
    """Start a Meshcat server without the note that Drake prints about it."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        return Meshcat(params or MeshcatParams())
    finally:
        logger.setLevel(level)


def show(builder: DiagramBuilder, scene_graph: SceneGraph, meshcat: Meshcat | None) -> None:
    """Show a scene live, if there is a view."""
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)


def _frames(plant: MultibodyPlant, stamps: Array, positions: Array, frame_times: Array) -> Array:
    """Return the positions of a plant at the times of the frames."""
    if positions.ndim != 2 or positions.shape[1] != plant.num_positions():
        raise ParameterError("positions", f"the plant has {plant.num_positions()} positions, got {positions.shape}")
    if not np.all(np.isfinite(positions)):
        row = int(np.argmin(np.all(np.isfinite(positions), axis=1)))
        raise ParameterError("positions", f"row {row} is not finite")
    return rows_at(stamps, _continuous(plant, positions), frame_times, "positions")


def _record_plant(meshcat: Meshcat, builder: DiagramBuilder, plant: MultibodyPlant, frames: Array, fps: float) -> None:
    scene_graph = next(system for system in builder.GetSystems() if isinstance(system, SceneGraph))
    visualizer = MeshcatVisualizer.AddToBuilder(
        builder, scene_graph, meshcat, MeshcatVisualizerParams(publish_period=1.0 / fps)
    )
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(root)
    visualizer_context = visualizer.GetMyContextFromRoot(root)
    for frame, positions in enumerate(frames):
        # The frame number is rounded down; half a frame keeps it away from the edge.
        root.SetTime((frame + 0.5) / fps)
        plant.SetPositions(plant_context, positions)
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


def _with_title(page: str, title: str) -> str:
    if not title:
        return page
    text = html.escape(title)
    style = (
        "position:fixed;top:0.6em;left:0.8em;right:270px;pointer-events:none;z-index:10;font:16px sans-serif;"
        "color:#222;text-shadow:0 0 4px #fff,0 0 4px #fff"
    )
    page = page.replace("<title>Drake MeshCat</title>", f"<title>{text}</title>", 1)
    head, body, rest = page.rpartition("</body>")
    return f'{head}<div style="{style}">{text}</div>{body}{rest}'


def _with_captions(page: str, times: Array, captions: Sequence[str]) -> str:
    """Return a page that shows of its captions, from their times (s) on, the one of the moment that is played."""
    if not captions:
        return page
    new = [k for k, text in enumerate(captions) if k == 0 or text != captions[k - 1]]
    known = json.dumps([[round(float(times[k]), 3), captions[k]] for k in new]).replace("<", "\\u003c")
    style = "position:fixed;bottom:0.8em;left:0.8em;pointer-events:none;z-index:10;font:20px monospace;color:#222"
    script = (
        f"const known = {known}; setInterval(() => {{ const now = viewer.animator.time; let text = known[0][1]; "
        "for (const [time, told] of known) if (time <= now + 1e-6) text = told; "
        'document.getElementById("caption").textContent = text; }, 50);'
    )
    head, body, rest = page.rpartition("</body>")
    return f'{head}<div id="caption" style="{style};white-space:pre"></div><script>{script}</script>{body}{rest}'
