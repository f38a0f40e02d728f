"""The frames that a depth camera delivers: rate, noise, latency and faults."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.errors import ParameterError
from saphari_drake.leaf import CYCLE_OFFSET
from saphari_drake.parameters import require_choice, require_non_negative
from saphari_drake.perception.depth_noise import Depth, DepthNoiseParameters, add_kinect_noise
from saphari_drake.perception.rgbd_camera import CameraParameters


@dataclass
class SamplerParameters:
    """When frames are taken and delivered, and a fault for tests and studies."""

    # Time from taking a frame to its delivery (s, ≥ 0). Assumed.
    latency: float = 0.01
    # "none", "silent" (no frame is taken) or "invalid" (frames hold no reading).
    fault: str = "none"
    # Start of the fault (s, ≥ 0).
    fault_time: float = 0.0
    # Length of the fault (frames, ≥ 0; may be infinite).
    fault_frames: float = np.inf
    noise: DepthNoiseParameters = field(default_factory=DepthNoiseParameters)

    def __post_init__(self) -> None:
        require_non_negative(self, "latency", "fault_time")
        require_choice(self, "fault", ("none", "silent", "invalid"))
        if not self.fault_frames >= 0.0:
            raise ParameterError("fault_frames", f"must not be negative, got {self.fault_frames}")


@dataclass(frozen=True)
class _Frame:
    depth: Depth
    stamp: float  # s, when it was taken; −1: no frame


@dataclass(frozen=True)
class _Frames:
    """Number of frames taken so far, those on their way, and the one delivered last. Never changed, so never copied."""

    count: int
    pending: tuple[_Frame, ...]
    delivered: _Frame

    def __deepcopy__(self, memo: dict) -> _Frames:
        return self


class DepthCameraSampler(LeafSystem):
    """Takes frames from a rendered image at the camera's rate, adds noise and delivers them after the latency.

    .. pydrake_system::

        name: DepthCameraSampler
        input_ports:
        - depth_image
        output_ports:
        - depth_image
        - image_time

    Ports
    -----
    depth_image (input) : abstract `ImageDepth32F` (m), from a camera; evaluated, and so rendered, for each frame only.
    depth_image (output) : abstract `ImageDepth32F` (m), the frame delivered last; no reading is 0 or +inf.
    image_time : 1 (s), the time at which that frame was taken; −1 before the first one.

    The noise of a frame follows from the seed and the number of the frame, which is in the Context: a cloned Context
    gives the same images.

    Parameters
    ----------
    camera : CameraParameters
        Size, range, focal length and rate.
    params : SamplerParameters, optional
    """

    def __init__(self, camera: CameraParameters, params: SamplerParameters | None = None) -> None:
        super().__init__()
        self._camera = camera
        self._params = params = params or SamplerParameters()
        empty = np.zeros((camera.height, camera.width), dtype=np.float32)
        # Compiles the kernel before the first frame.
        add_kinect_noise(empty, np.random.default_rng(0), params.noise, camera)
        image = ImageDepth32F(camera.width, camera.height)
        self._input = self.DeclareAbstractInputPort("depth_image", Value[ImageDepth32F](image))
        self._state = self.DeclareAbstractState(AbstractValue.Make(_Frames(0, (), _Frame(empty, -1.0))))
        period = 1.0 / camera.rate
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, CYCLE_OFFSET, self._take)
        # Just before the cycles of those who read the frame at the nominal time of its delivery.
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, params.latency, self._deliver)
        ticket = {self.abstract_state_ticket(self._state)}
        self.DeclareAbstractOutputPort(
            "depth_image", alloc=lambda: AbstractValue.Make(image), calc=self._calc_image, prerequisites_of_calc=ticket
        )
        self.DeclareVectorOutputPort("image_time", BasicVector(1), self._calc_time, prerequisites_of_calc=ticket)

    def _take(self, context: Context, state: State) -> EventStatus:
        params, time = self._params, context.get_time()
        frames: _Frames = state.get_abstract_state(int(self._state)).get_value()
        since = (time - params.fault_time) * self._camera.rate
        faulty = params.fault != "none" and -1e-3 <= since < params.fault_frames - 1e-3
        pending = frames.pending
        if not (faulty and params.fault == "silent"):
            if faulty:
                depth = np.zeros((self._camera.height, self._camera.width), dtype=np.float32)
            else:
                exact = self._input.Eval(context).data[..., 0]
                rng = np.random.Generator(np.random.SFC64([params.noise.seed, frames.count]))
                depth = np.array(add_kinect_noise(exact, rng, params.noise, self._camera))
            pending = (*pending, _Frame(depth, time))
        state.get_mutable_abstract_state(int(self._state)).set_value(
            _Frames(frames.count + 1, pending, frames.delivered)
        )
        self._deliver(context, state)  # a frame without latency
        return EventStatus.Succeeded()

    def _deliver(self, context: Context, state: State) -> EventStatus:
        # Read from `state`, which holds a frame taken at this same instant.
        frames: _Frames = state.get_abstract_state(int(self._state)).get_value()
        latest = context.get_time() + 2.0 * CYCLE_OFFSET - self._params.latency
        due = [frame for frame in frames.pending if frame.stamp <= latest]
        if not due:
            return EventStatus.DidNothing()
        pending = frames.pending[len(due) :]
        state.get_mutable_abstract_state(int(self._state)).set_value(_Frames(frames.count, pending, due[-1]))
        return EventStatus.Succeeded()

    def _frames(self, context: Context) -> _Frames:
        return context.get_abstract_state(int(self._state)).get_value()

    def _calc_image(self, context: Context, output: AbstractValue) -> None:
        output.get_mutable_value().mutable_data[..., 0] = self._frames(context).delivered.depth

    def _calc_time(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._frames(context).delivered.stamp)
