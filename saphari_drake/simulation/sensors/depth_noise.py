"""What a structured-light camera does to a depth image, and the frames it delivers: noise, rate, latency, faults."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.errors import ParameterError
from saphari_drake.messages import Immutable
from saphari_drake.parameters import require_choice, require_non_negative, require_positive
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.simulation.sensors.depth_noise_kernels import Noise, noisy_image
from saphari_drake.systems import CYCLE_OFFSET

Depth = NDArray[np.float32]


@dataclass
class DepthNoiseParameters:
    """Noise of the first Kinect. All random numbers follow from the seed and the number of the frame."""

    # Whether noise is added at all.
    enabled: bool = True
    # Seed (integer ≥ 0).
    seed: int = 0
    # Distance between infrared camera and projector (m, > 0). Kinect v1; the projector is on the camera's right.
    baseline: float = 0.075
    # Step of the measured disparity (pixels, ≥ 0). Kinect v1: 1/8.
    disparity_step: float = 0.125
    # Standard deviation of a reading, quantisation included (m, ≥ 0), at the depth below. Measured with a Kinect v1.
    sigma: float = 0.004
    # Depth at which sigma holds (m, > 0); it grows with the square of the depth.
    sigma_depth: float = 1.7
    # Share of the noise's variance that neighbouring pixels have in common (0–1). Assumed.
    correlated_share: float = 0.5
    # Distance over which it is common (pixels, ≥ 1). Assumed, of the order of the camera's matching window.
    correlation_length: float = 4.0
    # Depth step between neighbours that counts as an edge (m, > 0). Assumed.
    edge_step: float = 0.04
    # Reach of an edge's effects (pixels, ≥ 0, integer). Assumed.
    edge_width: int = 2
    # Share of the pixels near an edge that have no reading, and that mix both depths (0–1). Assumed.
    edge_missing: float = 0.4
    edge_flying: float = 0.1
    # Whether what the projector does not light has no reading.
    shadow: bool = True
    # Angles between surface normal and ray at which readings start to be lost and all are lost (rad, 0–π/2). Assumed.
    grazing_start: float = 1.22
    grazing_end: float = 1.48

    def __post_init__(self) -> None:
        require_positive(self, "baseline", "sigma_depth", "edge_step")
        require_non_negative(self, "seed", "disparity_step", "sigma", "edge_width")
        for name in ("correlated_share", "edge_missing", "edge_flying"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ParameterError(name, f"must lie in 0–1, got {getattr(self, name)}")
        if self.edge_missing + self.edge_flying > 1.0:
            raise ParameterError("edge_flying", "and edge_missing must not exceed 1 together")
        if not 1.0 <= self.correlation_length < np.inf:
            raise ParameterError("correlation_length", f"must be at least 1 pixel, got {self.correlation_length}")
        if not 0.0 < self.grazing_start < self.grazing_end < np.pi / 2:
            raise ParameterError("grazing_end", "must lie above grazing_start, both between 0 and π/2")


def add_kinect_noise(
    depth: Depth, rng: np.random.Generator, params: DepthNoiseParameters, camera: CameraParameters | None = None
) -> Depth:
    """Return a depth image as a Kinect would measure it; no reading is 0.

    The noise has a constant deviation in disparity f b / z, so that it grows with z²; the disparity is then rounded.

    Parameters
    ----------
    depth : (height, width) float32 array
        Exact depth (m); 0, +inf and NaN are no reading.
    rng : numpy.random.Generator
        Source of all random numbers.
    params : DepthNoiseParameters
    camera : CameraParameters, optional
        Focal length and range; default: the Kinect's.
    """
    camera = camera or CameraParameters()
    if not params.enabled:
        return depth
    rows, cols = depth.shape
    key = rng.integers(0, 2**64, dtype=np.uint64)
    coarse = rng.standard_normal((int(rows / params.correlation_length) + 2, int(cols / params.correlation_length) + 2))
    image = depth.view()
    image.flags.writeable = False  # as images have it: one kernel for all
    return noisy_image(image, key, coarse, _noise(params, camera))


def _noise(params: DepthNoiseParameters, camera: CameraParameters) -> Noise:
    fb = camera.focal_x * params.baseline
    variance = (params.sigma * fb / params.sigma_depth**2) ** 2 - params.disparity_step**2 / 12.0
    sigma = np.sqrt(max(variance, 0.0))
    return Noise(
        fb=np.float32(fb),
        focal=np.float32(camera.focal_x),
        step=np.float32(params.disparity_step),
        own=sigma * np.sqrt(1.0 - params.correlated_share),
        common=sigma * np.sqrt(params.correlated_share),
        cell=params.correlation_length,
        edge_step=params.edge_step,
        edge_width=int(params.edge_width),
        missing=params.edge_missing,
        flying=params.edge_flying,
        slope_start=np.tan(params.grazing_start),
        slope_end=np.tan(params.grazing_end),
        shadow=params.shadow,
        near=np.float32(camera.near),
        far=np.float32(camera.far),
    )


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
class _Frames(Immutable):
    """Number of frames taken so far, those on their way, and the one delivered last. Never changed, so never copied."""

    count: int
    pending: tuple[_Frame, ...]
    delivered: _Frame


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
        add_kinect_noise(empty, np.random.default_rng(0), params.noise, camera)  # compiles
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

    @property
    def camera(self) -> CameraParameters:
        """The camera whose frames these are."""
        return self._camera

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
