"""The last element before the robot: what becomes of a command in the robot's own cycle, also if there is none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.estimation.momentum_observer import advance_integral, discrete_gain, residual
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.joint_envelope.law import Limited, Motion, limited_torque, predicted
from saphari_drake.safety.joint_envelope.parameters import envelope_of
from saphari_drake.safety.posture_laws import posture_torque
from saphari_drake.stations.parameters import StationParameters
from saphari_drake.stations.shared import StationStatus

Array = NDArray[np.float64]


class Guarded(NamedTuple):
    """What the guard makes of one cycle."""

    torque: Array  # (n,) to give, weight and all (Nm or N)
    gravity: Array  # (n,) the weight in it
    external: Array  # (n,) what others do to the robot
    limited: Limited
    status: StationStatus
    standing: bool  # whether the robot was braked and stands


class Guard:
    """Passes a command within the joint envelope; without one it brakes, and holds the posture where the robot stands.

    It lives in the loop's process: what it remembers is its own, and is lost with the robot alone. Commands that were
    too old or not finite once are not taken again: recovery is explicit, by a new station.
    """

    def __init__(self, robot: RobotModel, params: StationParameters) -> None:
        self._robot, self._params = robot, params
        self.envelope = envelope_of(robot, params.envelope)
        n = robot.n
        self._zero = np.zeros(n)
        self._gain = discrete_gain(np.full(n, params.observer_gain), params.envelope.period)
        self._stiffness = np.full(n, params.envelope.hold_stiffness)
        self._damping = np.full(n, params.envelope.hold_damping)
        self._delay = params.envelope.periods("torque_delay")
        for command in (None, self._zero):  # compiles
            self._reset()
            self.step(robot.home, self._zero, command, True)
        self._reset()

    def _reset(self) -> None:
        self._status = StationStatus.WAITING
        self._q_hold: Array | None = None  # posture that is held
        self._integral: Array | None = None
        self._torques: Array | None = None

    def step(self, q: Array, v: Array, command: Array | None, fresh: bool) -> Guarded:
        """Return the torque for a measured state (n,) each, and the latest command (n,), None before the first one."""
        terms = evaluate_dynamics(self._robot, q, v)
        if self._torques is None or self._integral is None:
            weight = np.clip(terms.g, -self.envelope.tau_max, self.envelope.tau_max)
            self._torques, self._integral = np.tile(weight, (self._delay + 1, 1)), terms.p
        external = residual(terms.p, self._integral, self._gain)
        wish = self._wish(terms, command, fresh)
        motion = Motion(q, v, terms.M, terms.Cv + terms.g, external, self._torques[-1])
        motion = predicted(self.envelope, motion, self._torques, self._delay, self._params.envelope.velocity_age)
        limited = Limited(*limited_torque(self.envelope, motion, wish))
        self._torques = np.vstack((self._torques[1:], limited.torque))
        acting = self._torques[-1 - self._delay]
        self._integral = advance_integral(self._integral, external, acting, terms, self._params.envelope.period)
        slow = bool(np.abs(v).max() < self._params.standing_speed)
        standing = slow and self._status == StationStatus.STALE
        return Guarded(limited.torque, terms.g, external, limited, self._status, standing)

    def _wish(self, terms: DynamicsTerms, command: Array | None, fresh: bool) -> Array:
        """Return the command, or what brakes and holds in its place, and remember which."""
        if command is not None and self._status != StationStatus.STALE:
            known = fresh and bool(np.isfinite(command).all())
            self._status = StationStatus.OK if known else StationStatus.STALE
            if known:
                largest = 1e3 * self.envelope.tau_max
                return np.clip(command, -largest, largest)
            self._q_hold = None
        if self._status == StationStatus.WAITING and self._q_hold is None:
            self._q_hold = terms.q
        if self._q_hold is None:
            if np.abs(terms.v).max() >= self._params.standing_speed:
                brake = np.full(len(terms.q), self._params.brake_damping)
                return posture_torque(terms, terms.q, self._zero, brake)
            self._q_hold = terms.q
        return posture_torque(terms, self._q_hold, self._stiffness, self._damping)
