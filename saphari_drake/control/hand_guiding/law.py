"""One control cycle of hand guiding: state of the controller and forces of the hands in, next state and commands out.

| M_c p̈_d = F_c − D_c ṗ_d (48),   ẍ_c = p̈_d + k_d(ṗ_d − ṗ_c) + k_p(p_d − p_c) (50),   c = e, b
| q̈_c of both a_c = ẍ_c − J̇_cq̇ by `priority_acceleration` (49, corrected)
| τ = M(q̈_c + K_D(q̇_c − q̇) + K_P(q_c − q)) + C q̇ + g + D_v q̇_c − J_eᵀF_e − J_bᵀF_b (47, with viscous friction)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.hand_guiding.parameters import HandGuidingParameters
from saphari_drake.control.hand_guiding.touch import GuidingPriority, GuidingStatus, HandForces, Touches, next_touches
from saphari_drake.math.guided_motion import (
    JointLimits,
    admittance,
    admittance_matrices,
    confine,
    priority_acceleration,
)
from saphari_drake.messages import Immutable
from saphari_drake.parameters import positive_definite
from saphari_drake.robots.dynamics import DynamicsTerms, evaluate_dynamics
from saphari_drake.robots.kinematics import PointKinematics
from saphari_drake.robots.model import RobotModel
from saphari_drake.robots.reach import reach

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GuidingState(Immutable):
    """Memory of the controller between two cycles."""

    q: Array  # (n,) commanded position and velocity of this cycle, acceleration of the one before
    v: Array
    a: Array
    q_start: Array  # (n,) posture at the start, where the centres of the workspaces are; NaN before
    touches: Touches
    p_d: Array  # (2, 3) desired position (m) and velocity (m/s) of end effector and body point, world
    v_d: Array
    centre: Array  # (2, 3) centres of their workspaces (m)
    link: int  # of the body point; −1: never touched
    p_LC: Array  # (3,) the body point in it (m)
    fade: Array  # (n,) what is left of the step that a change of the law would have made in the acceleration
    fade_below: bool  # whether it belongs to the null space of the main point
    torque: Array  # (n,) torque of the measured forces, smoothed, when last known
    weight: float  # share of it that is fed forward
    now: float = 0.0  # s; nominal time at which this cycle began
    fresh: bool = False  # the next cycle with a known joint state starts there, at rest


class GuidingOutput(NamedTuple):
    """What one cycle gives out; see the ports of `HandGuidingController`."""

    torque: Array  # (n,)
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


class _Point(NamedTuple):
    """A touched point within a cycle."""

    which: int  # 0: end effector, 1: body
    at: PointKinematics
    centre: Array
    p_d: Array
    v_d: Array
    v_d_next: Array
    acceleration: Array  # ẍ_c of (50)
    limited: bool  # by speed or workspace


class _Law(NamedTuple):
    """Joint acceleration (49) of the touched points, the main one first."""

    points: list[_Point]
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
        self.tip = link, np.array(X_LF @ np.asarray(params.tip_point, dtype=float))
        self.points, T = (params.end_effector, params.body), params.period
        self._admittance = [
            admittance_matrices(positive_definite(p.mass, 3, "mass"), positive_definite(p.damping, 3, "damping"), T)
            for p in self.points
        ]
        q_min, q_max = robot.q_min + params.joint_margin, robot.q_max - params.joint_margin
        v_max, most = params.joint_speed_share * robot.v_max, (params.max_acceleration, params.max_deceleration)
        self._limits = JointLimits(q_min, q_max, v_max, params.approach_time, *most, T)
        self._fading, self._resting = (float(np.exp(-T / time)) for time in (params.fade_time, params.point_time))
        self._following = -float(np.expm1(-T / params.force_time)) if params.force_time > 0.0 else 1.0
        self._shoulder, self._reach = reach(robot, *self.tip)
        # A cycle with two hands compiles the kernels before the first control step.
        terms, link, one = evaluate_dynamics(robot, robot.home, np.zeros(robot.n)), self.tip[0], np.ones((2, 3))
        touched = replace(self.start(terms), touches=Touches((True, True), GuidingPriority.BODY, True), link=link)
        self.step(touched, terms, HandForces(one, np.zeros(robot.n), link, np.zeros(3), True))

    def start(self, terms: DynamicsTerms) -> GuidingState:
        """Return the state at rest at the measured posture."""
        none, zero, q = np.zeros(self.robot.n), np.zeros((2, 3)), terms.q
        return GuidingState(q, none, none, q, Touches(), zero, zero, zero, -1, np.zeros(3), none, False, none, 1.0)

    def step(self, state: GuidingState, terms: DynamicsTerms, hands: HandForces) -> tuple[GuidingState, GuidingOutput]:
        """Return the next state and the commands of this cycle; `terms` are those of the measured state."""
        params, T = self.params, self.params.period
        measured = params.feedback == "measured"
        if not terms.finite and (measured or state.fresh):
            return self._unknown(state)
        if state.fresh:
            q_start = np.where(np.isnan(state.q_start), terms.q, state.q_start)
            state = replace(self.start(terms), q_start=q_start, now=state.now)
        touches = next_touches(state.touches, hands, self.points, params.release_time, T)
        actual = terms if measured else evaluate_dynamics(self.robot, state.q, state.v)
        link, p_LC, jumped = self._body_point(state, hands, touches)
        points = [self._desired(c, state, actual, hands, touches, (link, p_LC)) for c in touches.order]
        J, law = np.array([point.at.Jv_WC for point in points]).reshape(-1, 3, self.robot.n), None
        if points:
            a = np.array([point.acceleration - point.at.Jdotv_WC for point in points])
            rest = -params.null_damping * state.v
            law = _Law(points, *priority_acceleration(J, a, rest, params.damping_threshold))
        nominal = law.acceleration if law else -(params.hold_damping if hands.known else params.fault_damping) * state.v
        # A change of the law fades in, out of sight of a main point that stays the same.
        fade, below = self._fading * state.fade, state.fade_below
        if jumped or not touches.same_law(state.touches):
            fade, below = state.a - nominal, touches.priority == state.touches.priority
        if below and law:
            fade = law.N_1 @ fade
        v_asked = state.v + T * (nominal + fade)
        v_next, held_back = self._limits.velocity(state.q, state.v, v_asked, J, params.damping_threshold)
        a = (v_next - state.v) / T
        q_next = state.q + 0.5 * T * (state.v + v_next)
        if measured:  # with torques at their limits the command must not run away
            q_next = terms.q + np.clip(q_next - terms.q, -params.max_lag, params.max_lag)
        p_d, v_d = self._advance(state, law, v_next, v_next - v_asked)
        fed, weight = state.torque, self._fading * state.weight
        if hands.known:
            fed, weight = fed + self._following * (hands.torque - fed), 1.0 - self._fading * (1.0 - state.weight)
        track = params.K_D * (state.v - terms.v) + params.K_P * (state.q - terms.q)
        torque = terms.M @ (a + track) + terms.g + self.robot.viscous * state.v - weight * fed
        torque += terms.Cv if params.coriolis else 0.0
        centre = state.centre.copy()
        for point in points:
            centre[point.which] = point.centre
        following = GuidingState(
            q_next, v_next, a, state.q_start, touches, p_d, v_d, centre, link, p_LC, fade, below, fed, weight,
            state.now + T,
        )  # fmt: skip
        return following, self._output(following, torque, hands, law, held_back)

    def _unknown(self, state: GuidingState) -> tuple[GuidingState, GuidingOutput]:
        """Forget all motion while the joint state is not known: NaN, from which the next system brakes."""
        none, zero, two = np.full(self.robot.n, np.nan), np.zeros((2, 3)), np.zeros(2)
        told = GuidingPriority.NONE, GuidingStatus.SENSOR_LOST, zero, zero, zero, zero, two, two, zero
        following = replace(state, touches=Touches(), now=state.now + self.params.period, fresh=True)
        return following, GuidingOutput(none, none, none, none, *told)

    def _body_point(self, state: GuidingState, hands: HandForces, touches: Touches) -> tuple[int, Array, bool]:
        """Return link and position of the body point, smoothed while it is touched, and whether it jumped."""
        if not touches.touched[1] or hands.link < 0:  # not touched, or about to be let go
            return state.link, state.p_LC, False
        if not state.touches.touched[1] or hands.link != state.link:
            return hands.link, hands.p_LC, True
        return state.link, hands.p_LC + self._resting * (state.p_LC - hands.p_LC), False

    def _desired(
        self, c: int, state: GuidingState, actual: DynamicsTerms, hands: HandForces, touches: Touches,
        body: tuple[int, Array],
    ) -> _Point:  # fmt: skip
        """Return a touched point with its desired motion (48), (50)."""
        params, (link, p_LC) = self.params, body if c == 1 else self.tip
        at = actual.point(link, p_LC)
        new = not state.touches.touched[c] or (c == 1 and link != state.link)
        centre = self.robot.kinematics(state.q_start).position(link, p_LC) if new else state.centre[c]
        if new or touches.priority != state.touches.priority:
            p_d, v_d = at.p_WC, at.Jv_WC @ state.v
        else:
            p_d, v_d = state.p_d[c], state.v_d[c]
            if c == 1:  # the point may have moved on the link
                p_d = p_d + actual.R_WL[link] @ (p_LC - state.p_LC)
        limits, far_off = self.points[c], 0.0 if c else params.reach_share * self._reach
        free, fast = admittance(v_d, hands.force[c], *self._admittance[c], limits.max_speed)
        bounds = limits.workspace_radius, params.approach_time, params.point_deceleration * params.period
        v_d_next, bounded = confine(free, p_d, centre, *bounds)
        v_d_next, far = confine(v_d_next, p_d, self._shoulder, far_off, *bounds[1:])
        acceleration = (v_d_next - v_d) / params.period + params.k_d * (v_d - at.v_WC) + params.k_p * (p_d - at.p_WC)
        return _Point(c, at, centre, p_d, v_d, v_d_next, acceleration, fast or bounded or far)

    def _advance(self, state: GuidingState, law: _Law | None, v_next: Array, shortfall: Array) -> tuple[Array, Array]:
        """Return the desired motion of the next cycle.

        Where a point cannot go, or limits hold it back, it is that of the point itself, so that nothing winds up.
        """
        T, p_d, v_d = self.params.period, state.p_d.copy(), state.v_d.copy()
        for point, reachable in zip(law.points, law.reachable) if law else ():
            c, J = point.which, point.at.Jv_WC
            v_own = J @ v_next
            p_own = point.at.p_WC + T * v_own
            p_d[c], v_d[c], missed = p_own, v_own, J @ shortfall
            if missed @ missed < 1e-12:
                p_new = point.p_d + 0.5 * T * (point.v_d + point.v_d_next)
                p_d[c] += reachable @ (p_new - p_own)
                v_d[c] += reachable @ (point.v_d_next - v_own)
        return p_d, v_d

    def _output(
        self, now: GuidingState, torque: Array, hands: HandForces, law: _Law | None, held_back: bool
    ) -> GuidingOutput:
        p, v_d, a_d, direction = np.zeros((4, 2, 3))
        rank, lost = np.zeros((2, 2))
        status = GuidingStatus.GUIDED
        for point, reachable, free, away in zip(law.points, law.reachable, law.rank, law.lost) if law else ():
            c, force = point.which, hands.force[point.which]
            p[c], v_d[c], a_d[c], rank[c], direction[c] = point.at.p_WC, point.v_d, point.acceleration, free, away
            lost[c] = np.linalg.norm(force - reachable @ force)
            if lost[c] > self.params.partial_share * np.sqrt(force @ force):
                status = GuidingStatus.PARTIAL
            held_back = held_back or point.limited
        status = GuidingStatus.LIMITED if held_back else status
        if law is None:
            status = GuidingStatus.HOLD if now.touches.ready else GuidingStatus.WAITING
        if not hands.known:
            status = GuidingStatus.SENSOR_LOST
        told = hands.force, p, v_d, a_d, rank, lost, direction
        return GuidingOutput(torque, now.a, now.q, now.v, now.touches.priority, status, *told)
