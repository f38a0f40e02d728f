"""One control cycle of hand guiding: state of the controller and measurements in, next state and commands out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.hand_guiding.law import (
    admittance,
    admittance_matrices,
    confine,
    limit_joint_velocity,
    priority_acceleration,
    tracking_torque,
    velocity_bounds,
)
from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.control.hand_guiding.touch import Sensed, Tip, Touches, joints_that_move, next_touches, sense
from saphari_drake.math.saturation import limit_torque
from saphari_drake.messages import GuidingPriority, GuidingStatus, Immutable, SkinContact, SkinReading
from saphari_drake.parameters import positive_definite
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.kinematics import PointKinematics
from saphari_drake.robots.model import RobotModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GuidingState(Immutable):
    """Memory of the controller between two cycles.

    Attributes
    ----------
    q, v, a : (n,) arrays
        Commanded joint position and velocity of this cycle, and acceleration of the one before.
    q_start : (n,) array
        Posture at the start, where the centres of the workspaces are.
    touches : Touches
    p_d, v_d : (2, 3) arrays
        Desired position (m) and velocity (m/s) of end effector and body point, world.
    centre : (2, 3) array
        Centres of their workspaces (m).
    link, p_LC :
        The body point: link (−1: never touched), and position in it (m).
    fade : (n,) array
        What is left of the step that a change of the law would have made in the acceleration.
    fade_below : bool
        Whether it belongs to the null space of the main point.
    torque, weight : (n,) array, float
        Torque of the measured forces, smoothed, when last known, and the share of it that is fed forward.
    now : float
        Nominal time at which this cycle began (s).
    fresh : bool
        Not started: the first cycle takes its posture from the measurement.
    """

    q: Array
    v: Array
    a: Array
    q_start: Array
    touches: Touches
    p_d: Array
    v_d: Array
    centre: Array
    link: int
    p_LC: Array
    fade: Array
    fade_below: bool
    torque: Array
    weight: float
    now: float
    fresh: bool = False


class GuidingOutput(NamedTuple):
    """What one cycle gives out; see the ports of `HandGuidingController`."""

    torque: Array  # (n,)
    torque_excess: Array  # (n,)
    acceleration: Array  # (n,)
    position: Array  # (n,)
    velocity: Array  # (n,)
    priority: GuidingPriority
    status: GuidingStatus
    force: Array  # (2, 3)
    point_position: Array  # (2, 3)
    velocity_desired: Array  # (2, 3)
    acceleration_desired: Array  # (2, 3)
    rank: Array  # (2,)
    unreachable_force: Array  # (2,)
    unreachable_direction: Array  # (2, 3)


class _Points(NamedTuple):
    """The touched points within a cycle, the main one first."""

    which: tuple[int, ...]  # 0: end effector, 1: body
    at: list[PointKinematics]
    p_d: list[Array]
    v_d: list[Array]
    v_d_next: list[Array]
    acceleration: list[Array]  # ẍ_{c,d} of (50)
    limited: bool  # one of them, by speed or workspace


class _Law(NamedTuple):
    """Joint acceleration (49) of a cycle."""

    J: Array
    acceleration: Array
    N_1: Array
    reachable: Array
    rank: Array
    lost: Array


class HandGuiding:
    """The strategy as a function of its state; holds constants only."""

    def __init__(self, robot: RobotModel, params: HandGuidingParameters) -> None:
        self.robot, self.params = robot, params
        link, X_LF = robot.frame(params.tip_frame or robot.link_names[-1])
        if link < 0:
            link = robot.link_index(params.tip_frame)  # raises: the frame does not move
        self.tip = Tip(link, np.array(X_LF @ np.asarray(params.tip_point, dtype=float)))
        self.moved_by = joints_that_move(robot)
        self.points = (params.end_effector, params.body)
        self._admittance = [
            admittance_matrices(positive_definite(p.mass, 3, "mass"), positive_definite(p.damping, 3, "damping"),
                                params.period)
            for p in self.points
        ]  # fmt: skip
        margin = params.joint_margin
        self._limits = robot.q_min + margin, robot.q_max - margin, params.joint_speed_share * robot.v_max
        self._fading = float(np.exp(-params.period / params.fade_time))
        self._following = 1.0 - float(np.exp(-params.period / params.force_time)) if params.force_time > 0.0 else 1.0
        self._smoothing = 1.0 - float(np.exp(-params.period / params.point_time))

    def start(self, terms: DynamicsTerms, fresh: bool = False) -> GuidingState:
        """Return the state at the start: at rest at the measured posture; a fresh one takes it in its first cycle."""
        none, zero = np.zeros(self.robot.n), np.zeros((2, 3))
        return GuidingState(
            terms.q, none, none, terms.q, Touches(), zero, zero, zero, -1, np.zeros(3), none, False, none, 1.0, 0.0,
            fresh,
        )  # fmt: skip

    def compile(self) -> None:
        """Run one cycle with two hands, which compiles the kernels before the first control step."""
        terms = evaluate_dynamics(self.robot, self.robot.home, np.zeros(self.robot.n))
        touches = Touches((True, True), GuidingPriority.END_EFFECTOR, True)
        axis, firm = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 2.0 * self.params.body.touch_on])
        contact = SkinContact(self.robot.n - 1, np.zeros(3), axis, -firm)
        start = replace(self.start(terms), touches=touches, link=contact.link)
        self.step(start, terms, SkinReading((contact,)), np.concatenate([np.zeros(3), firm]))

    def step(
        self, state: GuidingState, terms: DynamicsTerms, reading: SkinReading, wrench: Array
    ) -> tuple[GuidingState, GuidingOutput]:
        """Return the next state and the commands of this cycle.

        Parameters
        ----------
        state : GuidingState
        terms : DynamicsTerms
            Of the measured state.
        reading : SkinReading
        wrench : (6,) array
            Moment (Nm) and force (N) at the tip, world axes.
        """
        params, T = self.params, self.params.period
        if state.fresh:
            state = self.start(terms)
        age = state.now - max(reading.stamp, 0.0)
        sensed = sense(terms, reading, wrench, self.tip, self.moved_by, age, params.timeout)
        touches = next_touches(state.touches, sensed, self.points, params.release_time, T)
        actual = terms if params.feedback == "measured" else evaluate_dynamics(self.robot, state.q, state.v)
        link, p_LC, jumped = self._body_point(state, sensed, touches)
        centre = state.centre.copy()
        points = self._desired(state, actual, sensed, touches, link, p_LC, centre)
        law = self._law(points, state.v) if points.which else None
        rate = params.hold_damping if sensed.valid else params.fault_damping
        nominal = law.acceleration if law else -rate * state.v
        # A change of the law fades in, out of sight of a main point that stays the same.
        fade, below = self._fading * state.fade, state.fade_below
        if jumped or not touches.same_law(state.touches):
            fade = state.a - nominal
            below = touches.priority == state.touches.priority
        if below and law:
            fade = law.N_1 @ fade
        low, high = velocity_bounds(state.q, *self._limits, params.approach_time)
        J = law.J if law else np.zeros((0, 3, len(fade)))
        v_asked = state.v + T * (nominal + fade)
        v_next, held_back = limit_joint_velocity(v_asked, J, low, high, params.damping_threshold)
        change, most = v_next - state.v, params.max_acceleration * T
        largest = float(np.abs(change).max())
        if largest > most:
            v_next, held_back = state.v + (most / largest) * change, True
        v_next = self._stopping_in_time(state.q, v_next)
        a = (v_next - state.v) / T
        q_next = state.q + 0.5 * T * (state.v + v_next)
        if params.feedback == "measured":  # with torques at their limits the command must not run away
            q_next = terms.q + np.clip(q_next - terms.q, -params.max_lag, params.max_lag)
        p_d, v_d = self._advance(state, points, law, v_next, v_next - v_asked)
        torque_known = state.torque + self._following * (sensed.torque - state.torque) if sensed.valid else state.torque
        weight = 1.0 - self._fading * (1.0 - state.weight) if sensed.valid else self._fading * state.weight
        torque = tracking_torque(terms, state.q, state.v, a, params.K_P, params.K_D, params.coriolis)
        torque, excess = limit_torque(torque - weight * torque_known, self.robot.tau_max)
        following = GuidingState(
            q_next, v_next, a, state.q_start, touches, p_d, v_d, centre, link, p_LC, fade, below, torque_known, weight,
            state.now + T,
        )  # fmt: skip
        held_back = held_back or points.limited or bool(excess.any())
        told = self._told(sensed, touches, points, law, held_back)
        return following, GuidingOutput(torque, excess, a, q_next, v_next, touches.priority, *told)

    def _stopping_in_time(self, q: Array, v: Array) -> Array:
        """Return a joint velocity from which `max_deceleration` stops every joint before its limit."""
        q_min, q_max, _ = self._limits
        twice = 2.0 * self.params.max_deceleration
        high, low = np.sqrt(twice * np.maximum(q_max - q, 0.0)), -np.sqrt(twice * np.maximum(q - q_min, 0.0))
        return np.minimum(np.maximum(v, low), high)

    def _body_point(self, state: GuidingState, sensed: Sensed, touches: Touches) -> tuple[int, Array, bool]:
        """Return link and position of the body point, smoothed while it is touched, and whether it jumped."""
        if not touches.touched[1] or sensed.link < 0:  # not touched, or about to be let go
            return state.link, state.p_LC, False
        if not state.touches.touched[1] or sensed.link != state.link:
            return sensed.link, sensed.p_LC, True
        return state.link, state.p_LC + self._smoothing * (sensed.p_LC - state.p_LC), False

    def _desired(
        self, state: GuidingState, actual: DynamicsTerms, sensed: Sensed, touches: Touches, link: int, p_LC: Array,
        centre: Array,
    ) -> _Points:  # fmt: skip
        """Return the touched points with their desired motion (48), (50); a new one sets its row of `centre`."""
        params = self.params
        order = (1, 0) if touches.priority == GuidingPriority.BODY else (0, 1)
        index = tuple(c for c in order if touches.touched[c])
        points = _Points(index, [], [], [], [], [], False)
        limited = False
        for c in index:
            where = (self.tip.link, self.tip.p_LC) if c == 0 else (link, p_LC)
            at = actual.point(*where)
            new = not state.touches.touched[c] or (c == 1 and link != state.link)
            if new:
                centre[c] = self.robot.kinematics(state.q_start).position(*where)
            if new or touches.priority != state.touches.priority:
                p_d, v_d = at.p_WC, at.Jv_WC @ state.v
            else:
                p_d, v_d = state.p_d[c], state.v_d[c]
                if c == 1:  # the point may have moved on the link
                    p_d = p_d + actual.R_WL[link] @ (p_LC - state.p_LC)
            limits = self.points[c]
            free, fast = admittance(v_d, sensed.force[c], *self._admittance[c], limits.max_speed)
            v_d_next, bounded = confine(free, p_d, centre[c], limits.workspace_radius, params.approach_time)
            change = (v_d_next - v_d) / params.period
            points.at.append(at)
            points.p_d.append(p_d)
            points.v_d.append(v_d)
            points.v_d_next.append(v_d_next)
            points.acceleration.append(change + params.k_d * (v_d - at.v_WC) + params.k_p * (p_d - at.p_WC))
            limited = limited or fast or bounded
        return points._replace(limited=limited)

    def _law(self, points: _Points, v: Array) -> _Law:
        J = np.array([at.Jv_WC for at in points.at])
        a = np.array([a - at.Jdotv_WC for a, at in zip(points.acceleration, points.at)])
        return _Law(J, *priority_acceleration(J, a, -self.params.null_damping * v, self.params.damping_threshold))

    def _advance(
        self, state: GuidingState, points: _Points, law: _Law | None, v_next: Array, shortfall: Array
    ) -> tuple[Array, Array]:
        """Return the desired motion of the next cycle.

        Where a point cannot go, or limits hold it back, it is that of the point itself, so that nothing winds up.
        """
        T, p_d, v_d = self.params.period, state.p_d.copy(), state.v_d.copy()
        for k, c in enumerate(points.which):
            at = points.at[k]
            v_own = at.Jv_WC @ v_next
            p_own = at.p_WC + T * v_own
            p_d[c], v_d[c] = p_own, v_own
            missed = at.Jv_WC @ shortfall
            if law is not None and missed @ missed < 1e-12:
                p_new = points.p_d[k] + 0.5 * T * (points.v_d[k] + points.v_d_next[k])
                p_d[c] += law.reachable[k] @ (p_new - p_own)
                v_d[c] += law.reachable[k] @ (points.v_d_next[k] - v_own)
        return p_d, v_d

    def _told(
        self, sensed: Sensed, touches: Touches, points: _Points, law: _Law | None, held_back: bool
    ) -> tuple[GuidingStatus, Array, Array, Array, Array, Array, Array, Array]:
        """Return the part of the output that tells what is going on."""
        p, v_d, a_d, direction = np.zeros((4, 2, 3))
        rank, lost = np.zeros((2, 2))
        status = GuidingStatus.GUIDED
        for k, c in enumerate(points.which):
            p[c], v_d[c], a_d[c] = points.at[k].p_WC, points.v_d[k], points.acceleration[k]
            if law is not None:
                rank[c], direction[c] = law.rank[k], law.lost[k]
                force = sensed.force[c]
                rest = force - law.reachable[k] @ force
                lost[c] = np.sqrt(rest @ rest)
                if lost[c] > self.params.partial_share * np.sqrt(force @ force):
                    status = GuidingStatus.PARTIAL
        if held_back:
            status = GuidingStatus.LIMITED
        if not points.which:
            status = GuidingStatus.HOLD if touches.ready else GuidingStatus.WAITING
        if not sensed.valid:
            status = GuidingStatus.SENSOR_LOST
        return status, sensed.force, p, v_d, a_d, rank, lost, direction
