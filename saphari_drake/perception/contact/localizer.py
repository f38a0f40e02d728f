"""ContactFusion: contact points and forces from several depth cameras and the residual, seen or hidden."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State
from pydrake.systems.sensors import ImageDepth32F

from saphari_drake.errors import ParameterError
from saphari_drake.messages import CameraStatus, ContactPoint, Immutable
from saphari_drake.perception.camera.model import CameraParameters
from saphari_drake.perception.contact.law import ContactFusionLaw, Fusion, FusionMemory, FusionParameters, Mode
from saphari_drake.perception.contact.vision import Array, ContactVision, Depth, LocalizerParameters
from saphari_drake.robots.model import RobotModel
from saphari_drake.systems import cycle

_NOBODY = np.zeros((0, 3))


@dataclass(frozen=True)
class _Memory(Immutable):
    """All that changes. Never changed in place, so never copied."""

    samples: tuple[tuple[float, Array, Array], ...]  # time (s), joint positions and residual, oldest first
    frame_times: tuple[float, ...]  # s, when the last frame of each camera arrived
    stamps: tuple[float, ...]  # s, when it was taken
    status: tuple[CameraStatus, ...]
    evidence: FusionMemory
    fusion: Fusion
    stamp: float = -np.inf  # s, of the newest frame in it
    human_points: NDArray[np.float64] = field(default_factory=lambda: _NOBODY)


class ContactFusion(LeafSystem):
    """Finds where a person touches the robot, and how hard, whether a camera sees the contact or not.

    .. pydrake_system::

        name: ContactFusion
        input_ports:
        - position_measured
        - residual
        - depth_image_0
        - image_time_0
        - depth_image_1 (and so on, one pair a camera)
        - image_time_1
        output_ports:
        - contact_point
        - second_contact_point
        - contact_force
        - second_contact_force
        - other_mode
        - other_mode_weight
        - camera_status
        - human_points

    Ports
    -----
    position_measured : n (rad or m), from a joint sensor.
    residual : n (Nm), from `MomentumObserver`; positive along the torque that the person causes.
    depth_image_k, image_time_k : abstract `ImageDepth32F` (m) and 1 (s), from a `DepthCameraSampler` each.
    contact_point : abstract `ContactPoint`; its distance is infinite where no camera sees the person there.
    second_contact_point : abstract `ContactPoint`, found only while two contacts are felt and seen at once.
    contact_force, second_contact_force : 3 (N, world), of the person on the robot, inside the friction cone.
    other_mode : abstract `ContactPoint`, the best explanation at another place.
    other_mode_weight : 1, its probability against that of the contact (0–0.5): near 0.5 the contact is ambiguous.
    camera_status : 1, the worst `CameraStatus` of all cameras, as a number.
    human_points : abstract (k, 3) array, points of the person in the world (m) in the last frames.

    With each new frame, posture and residual at its time stamp are weighed by `ContactFusionLaw`; frames of several
    cameras that arrive in one cycle are weighed together, at the newest one's stamp. A camera that is not OK is left
    out; without any, no contact is found.

    Parameters
    ----------
    robot : RobotModel
    cameras : sequence of CameraParameters
    params : FusionParameters, optional
    localizer : LocalizerParameters, optional
    backgrounds : sequence of (height, width) float32 arrays, optional
        Static background of each camera, see `background_depth`.
    poses : sequence of RigidTransform, optional
        Pose X_WC of each camera where it is known better than from its parameters, see `check_camera`.
    period : float
        Time between looks at the inputs (s).

    Raises
    ------
    StateError
        At an update, if measured position or residual are not finite.
    """

    def __init__(
        self,
        robot: RobotModel,
        cameras: Sequence[CameraParameters],
        params: FusionParameters | None = None,
        localizer: LocalizerParameters | None = None,
        backgrounds: Sequence[Depth | None] | None = None,
        poses: Sequence[RigidTransform | None] | None = None,
        period: float = 0.005,
    ) -> None:
        super().__init__()
        if not 0.0 < period < np.inf:
            raise ParameterError("period", f"must be positive and finite, got {period}")
        if len(cameras) == 0:
            raise ParameterError("cameras", "at least one is needed")
        none = [None] * len(cameras)
        given, placed = list(backgrounds or none), list(poses or none)
        for name, entries in (("backgrounds", given), ("poses", placed)):
            if len(entries) != len(cameras):
                raise ParameterError(name, f"needs one a camera ({len(cameras)}), got {len(entries)}")
        self._robot, self._localizer = robot, localizer or LocalizerParameters()
        visions = [
            ContactVision(robot.shapes, camera, self._localizer, background, X_WC)
            for camera, background, X_WC in zip(cameras, given, placed)
        ]
        self._law = ContactFusionLaw(robot, visions, params or FusionParameters())
        self._law.compile()
        self._kept = int(np.ceil(self._localizer.memory / period)) + 1
        self._position = self.DeclareVectorInputPort("position_measured", BasicVector(robot.n))
        self._residual = self.DeclareVectorInputPort("residual", BasicVector(robot.n))
        self._images = []
        for k, camera in enumerate(cameras):
            image = Value[ImageDepth32F](ImageDepth32F(camera.width, camera.height))
            port = self.DeclareAbstractInputPort(f"depth_image_{k}", image)
            self._images.append((port, self.DeclareVectorInputPort(f"image_time_{k}", BasicVector(1))))
        count = len(cameras)
        nothing = Fusion([], None, 0.0, np.zeros((0, 3)))
        waiting = (CameraStatus.WAITING,) * count
        empty = _Memory((), (0.0,) * count, (-1.0,) * count, waiting, self._law.empty(), nothing)
        self._state = self.DeclareAbstractState(AbstractValue.Make(empty))
        self.DeclarePeriodicUnrestrictedUpdateEvent(**cycle(period), update=self._update)
        self._declare_outputs()

    def _declare_outputs(self) -> None:
        ticket = {self.abstract_state_ticket(self._state)}
        abstract = {
            "contact_point": (ContactPoint(), lambda m: _contact(m, 0)),
            "second_contact_point": (ContactPoint(), lambda m: _contact(m, 1)),
            "other_mode": (ContactPoint(), lambda m: _point(m.fusion.second, m.stamp)),
            "human_points": (_NOBODY, lambda m: m.human_points),
        }
        for name, (initial, read) in abstract.items():
            self.DeclareAbstractOutputPort(
                name,
                alloc=lambda initial=initial: AbstractValue.Make(initial),
                calc=lambda context, output, read=read: output.set_value(read(self._memory(context))),
                prerequisites_of_calc=ticket,
            )
        vectors = {
            "contact_force": (3, lambda m: _force(m, 0)),
            "second_contact_force": (3, lambda m: _force(m, 1)),
            "other_mode_weight": (1, lambda m: [m.fusion.second_weight]),
            "camera_status": (1, lambda m: [float(max(m.status, key=_badness))]),
        }
        for name, (size, read) in vectors.items():
            self.DeclareVectorOutputPort(
                name,
                BasicVector(size),
                lambda context, output, read=read: output.SetFromVector(read(self._memory(context))),
                prerequisites_of_calc=ticket,
            )

    def _memory(self, context: Context) -> _Memory:
        return context.get_abstract_state(int(self._state)).get_value()

    def _update(self, context: Context, state: State) -> EventStatus:
        memory, now = self._memory(context), context.get_time()
        q = self._robot.checked_vector(self._position.Eval(context), "position_measured")
        r = self._robot.checked_vector(self._residual.Eval(context), "residual")
        if not memory.samples:
            memory = replace(memory, frame_times=(now,) * len(self._images))
        memory = replace(memory, samples=(*memory.samples, (now, q, r))[-self._kept :])
        memory = self._with_frames(context, memory, now)
        state.get_mutable_abstract_state(int(self._state)).set_value(memory)
        return EventStatus.Succeeded()

    def _with_frames(self, context: Context, memory: _Memory, now: float) -> _Memory:
        """Return the memory with the frames that have arrived, and the cameras' status."""
        stamps, times, status = list(memory.stamps), list(memory.frame_times), list(memory.status)
        images: list[Depth | None] = [None] * len(self._images)
        for k, (port, time_port) in enumerate(self._images):
            stamp = float(time_port.Eval(context)[0])
            usable = 0.0 <= stamp <= now and now - stamp <= self._localizer.memory
            if usable and stamp != stamps[k]:
                images[k] = port.Eval(context).data[..., 0]
                stamps[k], times[k] = stamp, now
            elif now - times[k] > self._localizer.timeout + 1e-9:
                status[k] = CameraStatus.STALE
        if any(image is not None for image in images):
            newest = max(stamp for stamp, image in zip(stamps, images) if image is not None)
            q, r = self._sample_at(memory.samples, newest)
            evidence = self._law.evidence(q, r, images, self._localizer.least_seen)
            for k, share in evidence.shares.items():
                status[k] = CameraStatus.OK if share >= self._localizer.least_seen else CameraStatus.INVALID
            kept = self._law.remember(memory.evidence, evidence)
            points = evidence.human_points
            memory = replace(memory, evidence=kept, fusion=self._law.decide(kept), stamp=newest, human_points=points)
        memory = replace(memory, stamps=tuple(stamps), frame_times=tuple(times), status=tuple(status))
        if CameraStatus.OK not in status:
            nothing = Fusion([], None, 0.0, np.zeros((0, 3)))
            return replace(memory, evidence=self._law.empty(), fusion=nothing, human_points=_NOBODY)
        return memory

    @staticmethod
    def _sample_at(samples: tuple[tuple[float, Array, Array], ...], time: float) -> tuple[Array, Array]:
        """Posture and residual at a time, interpolated."""
        times = np.array([sample[0] for sample in samples])
        columns = np.array([np.concatenate(sample[1:]) for sample in samples]).T
        row = np.array([np.interp(time, times, column) for column in columns])
        return row[: len(row) // 2], row[len(row) // 2 :]


def _badness(status: CameraStatus) -> int:
    order = (CameraStatus.OK, CameraStatus.WAITING, CameraStatus.INVALID, CameraStatus.STALE)
    return order.index(status)


def _point(mode: Mode | None, stamp: float) -> ContactPoint:
    if mode is None:
        return ContactPoint(stamp=stamp)
    return ContactPoint(True, mode.link, mode.p_L, mode.n_L, mode.distance, stamp)


def _contact(memory: _Memory, k: int) -> ContactPoint:
    modes = memory.fusion.modes
    return _point(modes[k] if k < len(modes) else None, memory.stamp)


def _force(memory: _Memory, k: int) -> Array:
    forces = memory.fusion.forces
    return forces[k] if k < len(forces) else np.zeros(3)
