"""The messages of an MCAP file: those of `foxglove` that are used, one for a sample of a signal, and how to fill them.

`m` is the namespace of `message_types`, which needs the extra ``mcap``.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import Rgba
from pydrake.math import RigidTransform, RotationMatrix

if TYPE_CHECKING:
    from saphari_drake.perception.camera.model import CameraParameters


def message_types() -> SimpleNamespace:
    """Return the message types of foxglove that are used, and `Signal`, in one namespace."""
    from foxglove_schemas_protobuf import (
        CameraCalibration_pb2,
        Color_pb2,
        FrameTransform_pb2,
        FrameTransforms_pb2,
        Pose_pb2,
        Quaternion_pb2,
        RawImage_pb2,
        SceneEntityDeletion_pb2,
        SceneUpdate_pb2,
        Vector3_pb2,
    )  # fmt: skip

    return SimpleNamespace(
        CameraCalibration=CameraCalibration_pb2.CameraCalibration,
        Color=Color_pb2.Color,
        FrameTransform=FrameTransform_pb2.FrameTransform,
        FrameTransforms=FrameTransforms_pb2.FrameTransforms,
        Pose=Pose_pb2.Pose,
        Quaternion=Quaternion_pb2.Quaternion,
        RawImage=RawImage_pb2.RawImage,
        SceneEntityDeletion=SceneEntityDeletion_pb2.SceneEntityDeletion,
        SceneUpdate=SceneUpdate_pb2.SceneUpdate,
        Vector3=Vector3_pb2.Vector3,
        Signal=_signal_type(),
    )


def _signal_type() -> Any:
    """Return the message type of a sample of a signal; the schemas of foxglove have none for plain numbers."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from google.protobuf.timestamp_pb2 import DESCRIPTOR as TIMESTAMP

    name, pool = "saphari_drake/Signal.proto", descriptor_pool.Default()
    file = descriptor_pb2.FileDescriptorProto(name=name, package="saphari_drake", syntax="proto3")
    file.dependency.append(TIMESTAMP.name)
    signal, field = file.message_type.add(name="Signal"), descriptor_pb2.FieldDescriptorProto
    stamp = {"type": field.TYPE_MESSAGE, "type_name": ".google.protobuf.Timestamp"}
    signal.field.add(name="timestamp", number=1, label=field.LABEL_OPTIONAL, **stamp)
    signal.field.add(name="values", number=2, label=field.LABEL_REPEATED, type=field.TYPE_DOUBLE)
    signal.field.add(name="unit", number=3, label=field.LABEL_OPTIONAL, type=field.TYPE_STRING)
    pool.AddSerializedFile(file.SerializeToString())  # again with the same content: nothing happens
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("saphari_drake.Signal"))


def nanoseconds(time: float) -> int:
    """Return a time (s) in nanoseconds."""
    return round(1e9 * time)


def vector(m: Any, values: ArrayLike) -> Any:
    """Return a `foxglove.Vector3`."""
    x, y, z = np.asarray(values, dtype=float)
    return m.Vector3(x=x, y=y, z=z)


def quaternion(m: Any, rotation: RotationMatrix) -> Any:
    """Return a `foxglove.Quaternion`."""
    q = rotation.ToQuaternion()
    return m.Quaternion(x=q.x(), y=q.y(), z=q.z(), w=q.w())


def pose_of(m: Any, pose: RigidTransform) -> Any:
    """Return a `foxglove.Pose`."""
    return m.Pose(position=vector(m, pose.translation()), orientation=quaternion(m, pose.rotation()))


def transform_of(m: Any, parent: str, child: str, pose: RigidTransform) -> Any:
    """Return a `foxglove.FrameTransform` without its time."""
    place = {"translation": vector(m, pose.translation()), "rotation": quaternion(m, pose.rotation())}
    return m.FrameTransform(parent_frame_id=parent, child_frame_id=child, **place)


def calibration(m: Any, name: str, camera: CameraParameters) -> Any:
    """Return a `foxglove.CameraCalibration` without its time; there the centre of the first pixel is (0, 0)."""
    x, y = np.subtract(camera.center, 0.5)
    K = np.array([[camera.focal_x, 0.0, x], [0.0, camera.focal_y, y], [0.0, 0.0, 1.0]])
    return m.CameraCalibration(
        frame_id=name, width=camera.width, height=camera.height,
        K=K.ravel(), R=np.eye(3).ravel(), P=np.column_stack([K, np.zeros(3)]).ravel(),
    )  # fmt: skip


def color_of(m: Any, color: Rgba) -> Any:
    """Return a `foxglove.Color`."""
    return m.Color(r=color.r(), g=color.g(), b=color.b(), a=color.a())
