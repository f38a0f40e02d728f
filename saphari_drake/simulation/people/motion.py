"""A recorded or made-up person in the cell, as obstacle points with velocities."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.trajectories import PiecewisePolynomial

from saphari_drake.errors import ParameterError
from saphari_drake.messages import ObstaclePoints, ObstacleStatus
from saphari_drake.parameters import require_non_negative, require_positive, require_vector
from saphari_drake.simulation.people.motion_files import HumanRecording, read_human_motion, synthetic_recording
from saphari_drake.simulation.people.motion_repair import JointState, RepairedMotion, repair_motion

Array = NDArray[np.float64]


@dataclass
class HumanMotionParameters:
    """Where the person's motion comes from, how it is repaired, and where it takes place."""

    # Text file with 18 columns, see `read_human_motion`; "" plays a built-in, made-up person.
    file: str = ""
    # Hz; frames a second. Such files do not tell it. Assumed.
    rate: float = 30.0
    # m; position of the camera in the world, and deg; roll, pitch and yaw of its frame (x right, y down, z away).
    position: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.2])
    rpy_deg: list[float] = field(default_factory=lambda: [-90.0, 0.0, -90.0])
    # Factor on the recorded positions, before they are placed.
    scale: float = 1.0
    # s; time in the recording at the start of the simulation. Negative: the person waits in the first posture.
    start: float = 0.0
    # Whether the recording runs forth and back again and again; otherwise the person stays in the last posture.
    loop: bool = True
    # m/s; what is faster is a jump of the recording. A quick hand reaches about 2 m/s. Assumed.
    max_speed: float = 2.0
    # s; longest gap that is interpolated; a longer one holds the joint where it was last seen. Assumed.
    max_gap: float = 0.2
    # s; a joint held for longer is lost. Assumed.
    hold_time: float = 0.5
    # s; standard deviation of the filter over time: the readings are noisy. Assumed.
    smoothing: float = 0.05
    # m; how far the body reaches around wrist, elbow and shoulder. Assumed.
    radius: list[float] = field(default_factory=lambda: [0.05, 0.06, 0.08])
    # m; from the wrist to the middle of the hand, along the forearm (0: no point there), and its radius. Assumed.
    hand: float = 0.09
    hand_radius: float = 0.07
    # Points between two joints of an arm.
    between: int = 2

    def __post_init__(self) -> None:
        require_positive(self, "rate", "scale", "max_speed", "radius")
        require_non_negative(self, "max_gap", "hold_time", "smoothing", "hand", "hand_radius", "between")
        require_vector(self, 3, "position", "rpy_deg", "radius")
        if not np.isfinite(self.start):
            raise ParameterError("start", f"must be finite, got {self.start}")


def camera_to_world(params: HumanMotionParameters) -> RigidTransform:
    """Return X_WC, pose of the recording's camera in the world."""
    return RigidTransform(RollPitchYaw(np.deg2rad(params.rpy_deg)), params.position)


class HumanPath:
    """The person's points at any time: cubic Hermite interpolation of the repaired frames.

    Positions and velocities are continuous, and velocities are those of the positions; only where a looped recording
    turns back they change their sign.

    Parameters
    ----------
    params : HumanMotionParameters
    recording : HumanRecording, optional
        Default: the file of the parameters, or the built-in person.

    Attributes
    ----------
    repaired : RepairedMotion
    count : int
        Number of points.
    radius : (m,) array
        How far the body reaches around each point (m).
    duration : float
        Length of the recording (s).

    Raises
    ------
    SensorError
        If the file is missing, has another form, or holds nothing that can be used.
    """

    def __init__(self, params: HumanMotionParameters, recording: HumanRecording | None = None) -> None:
        if recording is None:
            recording = read_human_motion(params.file) if params.file else synthetic_recording(params.rate)
        self.params, self.source = params, recording.source
        self.repaired: RepairedMotion = repair_motion(
            recording, params.rate, params.max_speed / params.scale, params.max_gap, params.hold_time, params.smoothing
        )
        weights, self.radius = self._body()
        self.count = len(self.radius)
        X_WC = camera_to_world(params)
        known = np.nan_to_num(params.scale * self.repaired.points)  # joints never seen have weight zero
        joints = known @ X_WC.rotation().matrix().T + X_WC.translation()
        p = np.einsum("mj,tjk->tmk", weights, joints).reshape(len(joints), -1)
        p = np.repeat(p, 2, axis=0) if len(p) == 1 else p  # a single frame is a person who stands still
        self._curve = PiecewisePolynomial.CubicHermite(
            np.arange(len(p)) / params.rate, p.T, np.gradient(p, 1.0 / params.rate, axis=0).T
        )
        self.duration = (len(joints) - 1) / params.rate
        self._status = np.array([self._status_of(row) for row in self.repaired.state])

    def _body(self) -> tuple[Array, Array]:
        """Return the points as weighted joints, (m, 6), and their radii (m,), without those of a joint never seen."""
        p = self.params
        rows: list[tuple[Array, float]] = []
        wrist, elbow, shoulder = p.radius
        for side in (0, 1):
            w, e, s = np.eye(6)[[side, 2 + side, 4 + side]]
            rows += [(w, wrist), (e, elbow), (s, shoulder)]
            for k in range(1, p.between + 1):
                a = k / (p.between + 1)
                rows.append(((1.0 - a) * w + a * e, (1.0 - a) * wrist + a * elbow))
                rows.append(((1.0 - a) * e + a * s, (1.0 - a) * elbow + a * shoulder))
            if p.hand > 0.0:
                forearm = self._forearm(side)
                if forearm > 0.0:
                    beyond = p.hand / (p.scale * forearm)
                    rows.append(((1.0 + beyond) * w - beyond * e, p.hand_radius))
        never = np.all(self.repaired.state == JointState.NEVER, axis=0)
        rows = [row for row in rows if not np.any((row[0] != 0.0) & never)]
        return np.array([weights for weights, _ in rows]), np.array([radius for _, radius in rows])

    def _forearm(self, side: int) -> float:
        """Median length of a forearm in the recording (m), 0 if unknown."""
        points, state = self.repaired.points, self.repaired.state
        both = (state[:, side] == JointState.SEEN) & (state[:, 2 + side] == JointState.SEEN)
        lengths = np.linalg.norm(points[both, side] - points[both, 2 + side], axis=1)
        return float(np.median(lengths)) if lengths.size else 0.0

    def _status_of(self, state: NDArray[np.int64]) -> ObstacleStatus:
        if np.any(state == JointState.LOST):
            return ObstacleStatus.LOST
        return ObstacleStatus.OK if np.all(state <= JointState.REPAIRED) else ObstacleStatus.HELD

    def __call__(self, time: float) -> ObstaclePoints:
        """Return the person's points at a time (s)."""
        played, direction = self._played(time)
        k, last = int(played * self.params.rate), len(self._status) - 1
        p = self._curve.value(played).reshape(-1, 3)
        if direction == 0.0:
            status = max(self._status[min(round(played * self.params.rate), last)], ObstacleStatus.HELD)
            return ObstaclePoints(p, np.zeros_like(p), self.radius, time, ObstacleStatus(status))
        v = direction * self._curve.EvalDerivative(played).reshape(-1, 3)
        status = max(self._status[min(k, last)], self._status[min(k + 1, last)])
        return ObstaclePoints(p, v, self.radius, time, ObstacleStatus(status))

    def _played(self, time: float) -> tuple[float, float]:
        """Return the time in the recording (s) and which way it runs: 1, −1, or 0 for standing still."""
        at, length = time + self.params.start, self.duration
        if at < 0.0 or length <= 0.0:
            return 0.0, 0.0
        if not self.params.loop:
            return (at, 1.0) if at <= length else (length, 0.0)
        at = at % (2.0 * length)
        return (at, 1.0) if at <= length else (2.0 * length - at, -1.0)
