"""What the depth cameras that cast rays themselves share: ports, what is fixed in the world, and the range."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import FrameId, GeometryId, QueryObject, Role, SceneGraphInspector
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.perception.camera.model import CameraParameters


class DepthCamera(LeafSystem):
    """Depth camera fixed in the world, of the geometry with the perception role that is registered by now.

    .. pydrake_system::

        name: DepthCamera
        input_ports:
        - geometry_query
        output_ports:
        - depth_image_32f
        - image_time

    Ports
    -----
    geometry_query : abstract `QueryObject`, from the SceneGraph's query port.
    depth_image_32f : abstract `ImageDepth32F` (m along the optical axis): 0 nearer than `near`, +inf beyond `far`.
    image_time : 1 (s), the time of the Context, at which the image is rendered.

    Parameters
    ----------
    inspector : SceneGraphInspector
        Of the SceneGraph that is connected.
    params : CameraParameters
    anchored : mapping from FrameId to RigidTransform
        Poses in the world of frames that never move, beside the world's own; what they carry is drawn once.
    """

    def __init__(
        self, inspector: SceneGraphInspector, params: CameraParameters, anchored: Mapping[FrameId, RigidTransform]
    ) -> None:
        super().__init__()
        self._near, self._far = params.near, params.far
        X_WF = {inspector.world_frame_id(): RigidTransform(), **anchored}
        self._moving: list[GeometryId] = []
        self._fixed: dict[GeometryId, RigidTransform] = {}
        for geometry in inspector.GetAllGeometryIds(Role.kPerception):
            frame = inspector.GetFrameId(geometry)
            if frame in X_WF:
                self._fixed[geometry] = X_WF[frame] @ inspector.GetPoseInFrame(geometry)
            else:
                self._moving.append(geometry)
        self._query = self.DeclareAbstractInputPort("geometry_query", Value[QueryObject]())
        self.DeclareAbstractOutputPort(
            "depth_image_32f",
            alloc=lambda: AbstractValue.Make(ImageDepth32F(params.width, params.height)),
            calc=self._calc_image,
            prerequisites_of_calc={self._query.ticket()},
        )
        self.DeclareVectorOutputPort(
            "image_time", BasicVector(1), self._calc_time, prerequisites_of_calc={self.time_ticket()}
        )

    def _depth(self, poses: list[RigidTransform]) -> NDArray[np.float32]:
        """Return the depth in each pixel (m, +inf where nothing is), with the moving shapes at `poses` in the world."""
        raise NotImplementedError

    def _calc_image(self, context: Context, output: AbstractValue) -> None:
        query = self._query.Eval(context)
        depth = self._depth([query.GetPoseInWorld(geometry) for geometry in self._moving])
        depth[depth > self._far] = np.inf
        depth[depth < self._near] = 0.0
        output.get_mutable_value().mutable_data[..., 0] = depth

    def _calc_time(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, context.get_time())
