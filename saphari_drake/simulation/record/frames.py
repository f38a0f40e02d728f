"""Depth images of a run, kept at a bounded rate, for who wants to see what the cameras saw."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram

if TYPE_CHECKING:
    from saphari_drake.perception.camera.model import CameraParameters

MILLIMETRE = 1e-3  # m
FARTHEST = np.iinfo(np.uint16).max  # mm


class DepthFrame(NamedTuple):
    """One image of a camera, compressed.

    Attributes
    ----------
    name : str
        Of the camera.
    camera : CameraParameters
    time : float
        When it was taken (s).
    packed : bytes
        Depths (mm), 16 bit, little-endian, row by row, packed by zlib; 0 where there is no reading.
    """

    name: str
    camera: CameraParameters
    time: float
    packed: bytes

    @property
    def pixels(self) -> bytes:
        """The depths, unpacked."""
        return zlib.decompress(self.packed)


def millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return depths (m) in mm, 0 where there is no reading."""
    known = np.where(np.isfinite(depth), depth / MILLIMETRE, 0.0)
    return np.clip(np.rint(known), 0.0, FARTHEST).astype("<u2")


class FrameKeeper:
    """Keeps the frame that each camera delivered last, whenever it looks; changes nothing of the run."""

    def __init__(self) -> None:
        self._runs: list[list[DepthFrame]] = []

    def begin(self) -> None:
        """Begin a run."""
        self._runs.append([])

    def look(self, diagram: Diagram, context: Context) -> None:
        """Keep what every camera of a diagram has delivered since the last look, in its root context."""
        # Experiments without a camera load none.
        from saphari_drake.simulation.sensors.depth_noise import DepthCameraSampler

        frames = self._runs[-1]
        for system in diagram.GetSystems():
            if not isinstance(system, DepthCameraSampler):
                continue
            name, own = system.get_name(), system.GetMyContextFromRoot(context)
            time = float(system.GetOutputPort("image_time").Eval(own)[0])
            before = max((frame.time for frame in frames if frame.name == name), default=-1.0)
            if time > before:
                depth = system.GetOutputPort("depth_image").Eval(own).data[..., 0]
                frames.append(DepthFrame(name, system.camera, time, zlib.compress(millimetres(depth).tobytes(), 1)))

    @property
    def frames(self) -> Sequence[DepthFrame]:
        """The frames of the one run; none if there were several, of which one is shown."""
        return self._runs[0] if len(self._runs) == 1 else ()
