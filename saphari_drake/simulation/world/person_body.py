"""A person for cameras and viewers to see: a ball at each obstacle point, moved without dynamics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import (
    FrameId,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    MakePhongIllustrationProperties,
    PerceptionProperties,
    SceneGraph,
    Shape,
    SourceId,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ObstaclePoints

SKIN = np.array([0.87, 0.62, 0.45, 1.0])


def register_shown(
    scene_graph: SceneGraph, source: SourceId, name: str, shape: Shape, rgba: NDArray[np.float64]
) -> FrameId:
    """Register a shape that cameras and viewers see, on a frame of its own; return the frame."""
    frame = scene_graph.RegisterFrame(source, GeometryFrame(name))
    body = GeometryInstance(RigidTransform(), shape, name)
    body.set_illustration_properties(MakePhongIllustrationProperties(rgba))
    body.set_perception_properties(PerceptionProperties())
    scene_graph.RegisterGeometry(source, frame, body)
    return frame


class PersonBody(LeafSystem):
    """Poses of the balls.

    .. pydrake_system::

        name: PersonBody
        input_ports:
        - obstacles
        output_ports:
        - geometry_pose

    Ports
    -----
    obstacles : abstract `ObstaclePoints`; their number and radii do not change.
    geometry_pose : abstract `FramePoseVector`, for a SceneGraph.

    Parameters
    ----------
    scene_graph : SceneGraph
        Gets the balls, for perception and illustration.
    points : ObstaclePoints
        Whose number and radii are used.
    """

    def __init__(self, scene_graph: SceneGraph, points: ObstaclePoints) -> None:
        super().__init__()
        self.source_id = scene_graph.RegisterSource("person")
        self._frames = [
            register_shown(scene_graph, self.source_id, f"person_{k}", Sphere(float(radius)), SKIN)
            for k, radius in enumerate(points.radius)
        ]
        self._points = self.DeclareAbstractInputPort("obstacles", AbstractValue.Make(ObstaclePoints()))
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            alloc=lambda: Value[FramePoseVector](),
            calc=self._calc,
            prerequisites_of_calc={self._points.ticket()},
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        points: ObstaclePoints = self._points.Eval(context)
        if len(points.p_WO) != len(self._frames):
            raise ParameterError("obstacles", f"{len(self._frames)} points were announced, got {len(points.p_WO)}")
        poses = FramePoseVector()
        for frame, p_WO in zip(self._frames, points.p_WO):
            poses.set_value(frame, RigidTransform(p_WO))
        output.set_value(poses)


def add_person_body(builder: DiagramBuilder, scene_graph: SceneGraph, points: ObstaclePoints) -> PersonBody:
    """Add the balls to a diagram, connected to its SceneGraph; the input `obstacles` is left to connect."""
    body = builder.AddNamedSystem("person_body", PersonBody(scene_graph, points))
    builder.Connect(body.GetOutputPort("geometry_pose"), scene_graph.get_source_pose_port(body.source_id))
    return body
