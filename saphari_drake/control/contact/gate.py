"""When a contact force is controlled: a gate on its size, and a stop for contacts that become too fast."""

from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.contact.parameters import ContactForceControlParameters
from saphari_drake.messages import Immutable, InteractionMode

Array = NDArray[np.float64]


class ForceStatus(IntEnum):
    """What the force control does, and why it does not control a force, also published as a number."""

    HOLD = 0  # nobody touches: keep the posture
    CONTROLLED = 1  # the force is controlled in all directions
    PARTIAL = 2  # controlled, except along directions in which joint torques do not show it
    WEAK = 3  # touched with a force below the gate: brake
    RELEASED = 4  # braking to rest after the release
    SPEED_STOP = 5  # the contact would have become too fast, as when nobody resists the desired force: brake
    UNSEEN = 6  # touched, but not seen where: yield
    NO_CAMERA = 7  # the camera is lost: brake to rest and stay there


@dataclass(frozen=True)
class ForceGate(Immutable):
    """Whether the force is controlled, and how large it shall be at the moment.

    Attributes
    ----------
    open : bool
        Whether the force is controlled.
    size : float
        Size of the aligned desired force (N); 0 while closed.
    stopped : bool
        Whether the speed stop has acted; it holds until the contact is released.
    stop_velocity : (3,) array
        Velocity of the contact, measured or foreseen, for which it acted (m/s, world).
    """

    open: bool = False
    size: float = 0.0
    stopped: bool = False
    stop_velocity: Array = field(default_factory=lambda: np.zeros(3))
    followed: float = 0.0  # m; how far the contact has gone against the desired force since the gate opened
    held: float = 0.0  # N; mean estimate over the drop time
    leaving: float = 0.0  # s; for which the gate stays closed, as the hand has left

    def after(self, mode: InteractionMode, force: float, params: ContactForceControlParameters) -> Self:
        """Return the gate of the next cycle, with the estimated force of size `force` (N).

        The desired size starts from the estimate, goes to its final value at the force rate, and never exceeds the
        estimate by more than the largest deficit. An estimate that drops closes the gate for the leave time.
        """
        if mode in (InteractionMode.HOLD, InteractionMode.RETURN):
            return type(self)()
        # A force that is not a number closes the gate.
        threshold = params.gate_off if self.open else params.gate_on
        leaving = max(self.leaving - params.period, 0.0)
        if self.open and self.held - force > params.drop_limit:
            leaving = params.leave_time
        if mode != InteractionMode.CONTACT or self.stopped or leaving > 0.0 or not force > threshold:
            return replace(self, open=False, size=0.0, leaving=leaving)
        if not self.open:
            self = replace(self, followed=0.0, held=force)
        held = self.held + min(params.period / params.drop_time, 1.0) * (force - self.held)
        size = params.desired_force
        if params.force_rate > 0.0:
            start, step = (self.size, params.force_rate * params.period) if self.open else (force, 0.0)
            size = start + float(np.clip(size - start, -step, step))
        return replace(self, open=True, size=min(size, force + params.max_deficit), held=held, leaving=0.0)

    def checked(self, velocity: Array, acceleration: Array, params: ContactForceControlParameters) -> Self:
        """Return the gate, stopped if velocity and acceleration (3,) of the contact bring it near the speed limit."""
        foreseen = velocity + (params.stop_lead + params.torque_delay) * acceleration
        worst = max(velocity, foreseen, key=lambda v: float(np.linalg.norm(v)))
        # A velocity that is not a number stops.
        if np.linalg.norm(foreseen) < np.inf and np.linalg.norm(worst) < params.stop_share * params.speed_limit:
            return self
        return replace(self, open=False, size=0.0, stopped=True, stop_velocity=np.array(worst))

    def following(self, velocity: Array, F_d: Array, params: ContactForceControlParameters) -> Self:
        """Return the gate, stopped if the contact has gone too far after the desired force F_d (3,) (N)."""
        size = float(np.linalg.norm(F_d))
        step = -params.period * float(velocity @ F_d) / size if size > 0.0 else 0.0
        followed = max(self.followed + step, 0.0)
        if followed < params.follow_limit:
            return replace(self, followed=followed)
        return replace(self, open=False, size=0.0, stopped=True, stop_velocity=np.array(velocity), followed=followed)

    def status(self, mode: InteractionMode) -> ForceStatus:
        """Return why no force is controlled."""
        if mode == InteractionMode.CONTACT:
            return ForceStatus.SPEED_STOP if self.stopped else ForceStatus.WEAK
        return _WITHOUT_CONTACT[mode]


_WITHOUT_CONTACT = {
    InteractionMode.HOLD: ForceStatus.HOLD,
    InteractionMode.RETURN: ForceStatus.RELEASED,
    InteractionMode.YIELD: ForceStatus.UNSEEN,
    InteractionMode.STOP: ForceStatus.NO_CAMERA,
}
