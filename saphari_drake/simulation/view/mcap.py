"""A run as one MCAP file in the `foxglove` schemas: transforms, scene and signals, for Foxglove, Rerun and others.

Topics: ``/tf`` (`foxglove.FrameTransforms`: every body in ``world``), ``/scene`` (`foxglove.SceneUpdate`: shapes fixed
to their bodies, once), ``/overlays`` (`foxglove.SceneUpdate`: arrows and balls of the replay, every frame), for each
camera ``/NAME/depth`` (`foxglove.RawImage`: 16UC1, mm, 0 without a reading) with ``/NAME/calibration``
(`foxglove.CameraCalibration`), and for each signal of the log ``/log/NAME`` (`saphari_drake.Signal`: `timestamp`,
`values`, `unit`).
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, Capsule, Cylinder, Ellipsoid, Mesh, Rgba, Role, SceneGraph, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, Diagram

from saphari_drake.errors import ParameterError
from saphari_drake.simulation.record.frames import DepthFrame
from saphari_drake.simulation.record.log import Log
from saphari_drake.simulation.view.mcap_messages import (
    calibration,
    color_of,
    message_types,
    nanoseconds,
    pose_of,
    transform_of,
    vector,
)
from saphari_drake.simulation.view.overlays import Arrow, Marker, shown_at

Array = NDArray[np.float64]

Drawn = tuple[Arrow | Marker, Array, Array, NDArray[np.bool_]]  # with points, vectors (m), and whether it is shown
WORLD, GREY = "world", Rgba(0.7, 0.7, 0.7, 1.0)
MEDIA = {".obj": "model/obj", ".gltf": "model/gltf+json", ".glb": "model/gltf-binary", ".stl": "model/stl"}


def require_mcap() -> None:
    """Raise `ParameterError` if the packages of the extra ``mcap`` are missing."""
    missing = [name for name in ("mcap_protobuf", "foxglove_schemas_protobuf") if find_spec(name) is None]
    if missing:
        text = f"no package {', '.join(missing)}; it comes with pip install 'saphari_drake[mcap]'"
        raise ParameterError("mcap", text)


class McapFile:
    """An MCAP file that is being written; a context manager, which ends the file.

    Parameters
    ----------
    path : path
        File to write.

    Raises
    ------
    ParameterError
        If the packages of the extra ``mcap`` are missing.
    """

    def __init__(self, path: str | Path) -> None:
        require_mcap()
        from mcap_protobuf.writer import Writer

        self._messages = message_types()
        self._file = Path(path).open("wb")
        self._writer = Writer(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._writer.finish()
        self._file.close()

    def add_log(self, log: Log) -> None:
        """Add every signal of a log, each sample with its time."""
        for name in log:
            rows = log[name].tolist()
            for time, row in zip(log.time.tolist(), rows):
                message = self._messages.Signal(values=row, unit=log.units[name])
                message.timestamp.FromNanoseconds(nanoseconds(time))
                self._write(f"/log/{name}", message, time)

    def add_frames(self, frames: Sequence[DepthFrame]) -> None:
        """Add depth images, each with the calibration of its camera and its pose in the world."""
        from saphari_drake.perception.camera.model import camera_pose

        m = self._messages
        for frame in frames:
            image = m.RawImage(
                frame_id=frame.name, encoding="16UC1", width=frame.camera.width, height=frame.camera.height,
                step=2 * frame.camera.width, data=frame.pixels,
            )  # fmt: skip
            placed = m.FrameTransforms()
            placed.transforms.append(transform_of(m, WORLD, frame.name, camera_pose(frame.camera)))
            optics = calibration(m, frame.name, frame.camera)
            for stamped in (image, placed.transforms[0], optics):
                stamped.timestamp.FromNanoseconds(nanoseconds(frame.time))
            self._write("/tf", placed, frame.time)
            self._write(f"/{frame.name}/calibration", optics, frame.time)
            self._write(f"/{frame.name}/depth", image, frame.time)

    def add_replay(
        self, plant: MultibodyPlant, diagram: Diagram, times: Array, positions: Array, stamps: Array,
        overlays: Sequence[Arrow | Marker],
    ) -> None:  # fmt: skip
        """Add the motion of a plant, its shapes and the overlays.

        Parameters
        ----------
        plant, diagram
            The finalized plant in its diagram.
        times, positions : (F,) and (F, nq) arrays
            Times of the frames (s), and the positions of the plant at each.
        stamps : (T,) array
            Times of the overlays' rows (s).
        overlays : sequence of Arrow and Marker
        """
        root = diagram.CreateDefaultContext()
        context = plant.GetMyMutableContextFromRoot(root)
        instances = map(ModelInstanceIndex, range(plant.num_model_instances()))
        bodies = [plant.get_body(index) for instance in instances for index in plant.GetBodyIndices(instance)][1:]
        self._add_scene(plant, diagram, root, times[0])
        drawn = [(overlay, *shown_at(overlay, stamps, times)) for overlay in overlays]
        for frame, time in enumerate(times.tolist()):
            plant.SetPositions(context, positions[frame])
            self._add_transforms(plant, context, bodies, time)
            self._add_overlays(drawn, frame, time)

    def _add_scene(self, plant: MultibodyPlant, diagram: Diagram, root: Context, time: float) -> None:
        """Add every shape that is drawn, fixed to the frame of its body."""
        m = self._messages
        scene_graph = next(system for system in diagram.GetSystems() if isinstance(system, SceneGraph))
        inspector = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(root)).inspector()
        update = m.SceneUpdate()
        for geometry in inspector.GetAllGeometryIds(Role.kIllustration):
            body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            entity = update.entities.add(id=inspector.GetName(geometry), frame_id=_name(plant, body), frame_locked=True)
            entity.timestamp.FromNanoseconds(nanoseconds(time))
            look = inspector.GetIllustrationProperties(geometry)
            color = look.GetPropertyOrDefault("phong", "diffuse", GREY)
            _add_shape(m, entity, inspector.GetShape(geometry), inspector.GetPoseInFrame(geometry), color)
        self._write("/scene", update, time)

    def _add_transforms(self, plant: MultibodyPlant, context: Any, bodies: Sequence[Any], time: float) -> None:
        m, message = self._messages, self._messages.FrameTransforms()
        for body in bodies:
            pose = plant.EvalBodyPoseInWorld(context, body)
            message.transforms.append(transform_of(m, WORLD, _name(plant, body), pose))
            message.transforms[-1].timestamp.FromNanoseconds(nanoseconds(time))
        self._write("/tf", message, time)

    def _add_overlays(self, drawn: Sequence[Drawn], frame: int, time: float) -> None:
        m, update = self._messages, self._messages.SceneUpdate()
        for overlay, points, vectors, shown in drawn:
            if not shown[frame]:
                update.deletions.add(id=overlay.name, type=m.SceneEntityDeletion.MATCHING_ID)
                continue
            entity = update.entities.add(id=overlay.name, frame_id=WORLD)
            entity.timestamp.FromNanoseconds(nanoseconds(time))
            color = color_of(m, Rgba(*overlay.color))
            if isinstance(overlay, Marker):
                pose = pose_of(m, RigidTransform(points[frame]))
                entity.spheres.add(pose=pose, size=vector(m, [2.0 * overlay.radius] * 3), color=color)
                continue
            length, r = float(np.linalg.norm(vectors[frame])), overlay.radius
            turn = RotationMatrix.MakeFromOneVector(vectors[frame], 0)  # an arrow of foxglove points along its x axis
            entity.arrows.add(
                pose=pose_of(m, RigidTransform(turn, points[frame])), color=color,
                shaft_length=max(length - 4.0 * r, 0.0), shaft_diameter=2.0 * r,
                head_length=min(4.0 * r, length), head_diameter=4.4 * r,
            )  # fmt: skip
        if drawn:
            self._write("/overlays", update, time)

    def _write(self, topic: str, message: Any, time: float) -> None:
        stamp = nanoseconds(time)
        self._writer.write_message(topic, message, log_time=stamp, publish_time=stamp)


def _add_shape(m: Any, entity: Any, shape: Any, pose: RigidTransform, color: Rgba) -> None:
    """Add a shape to an entity; half spaces have no extent, and are left out."""
    paint = color_of(m, color)
    if isinstance(shape, Mesh):
        source = shape.source()
        path = Path(str(source.path())) if source.is_path() else None
        if path is not None and path.suffix.lower() in MEDIA:
            data, scale = path.read_bytes(), vector(m, shape.scale3())
            kind = MEDIA[path.suffix.lower()]
            entity.models.add(pose=pose_of(m, pose), scale=scale, data=data, media_type=kind, color=paint)
        return
    if isinstance(shape, Sphere):
        entity.spheres.add(pose=pose_of(m, pose), size=vector(m, [2.0 * shape.radius()] * 3), color=paint)
    elif isinstance(shape, Ellipsoid):
        size = vector(m, [2.0 * shape.a(), 2.0 * shape.b(), 2.0 * shape.c()])
        entity.spheres.add(pose=pose_of(m, pose), size=size, color=paint)
    elif isinstance(shape, Box):
        entity.cubes.add(pose=pose_of(m, pose), size=vector(m, shape.size()), color=paint)
    elif isinstance(shape, Cylinder | Capsule):
        r, length = shape.radius(), shape.length()
        size = vector(m, [2.0 * r, 2.0 * r, length])
        entity.cylinders.add(pose=pose_of(m, pose), size=size, bottom_scale=1.0, top_scale=1.0, color=paint)
        for z in (-0.5 * length, 0.5 * length) if isinstance(shape, Capsule) else ():
            end = pose @ RigidTransform([0.0, 0.0, z])
            entity.spheres.add(pose=pose_of(m, end), size=vector(m, [2.0 * r] * 3), color=paint)


def _name(plant: MultibodyPlant, body: Any) -> str:
    return WORLD if body.index() == plant.world_body().index() else body.scoped_name().get_full()
