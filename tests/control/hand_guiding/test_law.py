"""Hand guiding as functions: priorities, admittance, limits, and the strategy closed over a robot that obeys it."""

import numpy as np
import pytest
from arms import states
from guided_arm import HOME, TIP

from saphari_drake.control.hand_guiding.law import HandGuiding
from saphari_drake.control.hand_guiding.parameters import GuidedPointParameters, HandGuidingParameters
from saphari_drake.control.hand_guiding.system import sense
from saphari_drake.control.hand_guiding.touch import GuidingPriority, GuidingStatus
from saphari_drake.errors import ParameterError, UnknownNameError
from saphari_drake.math import guided_motion as laws
from saphari_drake.messages import SkinContact, SkinReading, SkinStatus
from saphari_drake.robots.dynamics import evaluate_dynamics

SKIN = np.array([0.0, 0.065, 0.1])
PERIOD = 0.002


def jacobians(robot, q, v):
    """Return terms, and both points' kinematics."""
    terms = evaluate_dynamics(robot, q, v)
    return terms, terms.point(robot.n - 1, TIP), terms.point(2, SKIN)


class Guided:
    """The strategy on a robot that does exactly what is commanded; forces in the world."""

    def __init__(self, robot, home=HOME, skin_link=2, p_skin=SKIN, **params):
        self.params = HandGuidingParameters(feedback="commanded", tip_point=TIP.tolist(), **params)
        self.robot, self.guiding = robot, HandGuiding(robot, self.params)
        self.link, self.p = skin_link, p_skin
        self.terms = evaluate_dynamics(robot, home, np.zeros(robot.n))
        self.state = self.guiding.start(self.terms)
        self.outputs = []

    def run(self, time, F_e=(0.0, 0.0, 0.0), F_b=(0.0, 0.0, 0.0), status=SkinStatus.OK, stamp=None):
        """Run for a time (s) with constant forces; return the last output."""
        for _ in range(round(time / PERIOD)):
            terms = evaluate_dynamics(self.robot, self.state.q, self.state.v)
            contacts = ()
            if np.any(np.asarray(F_b) != 0.0):
                f_L = terms.R_WL[self.link].T @ np.asarray(F_b)
                contacts = (SkinContact(self.link, self.p, np.array([0.0, 1.0, 0.0]), f_L),)
            reading = SkinReading(contacts, status, (), self.state.now if stamp is None else stamp)
            wrench = np.concatenate([np.zeros(3), F_e])
            self.terms = terms
            fresh = self.state.now - reading.stamp <= self.params.timeout
            hands = sense(terms, reading, wrench, self.guiding.tip, fresh)
            self.state, output = self.guiding.step(self.state, terms, hands)
            self.outputs.append(output)
        return self.outputs[-1]

    def velocity(self, body=False):
        """Return the commanded velocity of a point (m/s)."""
        terms = evaluate_dynamics(self.robot, self.state.q, self.state.v)
        return terms.point(*(self.link, self.p) if body else self.guiding.tip).v_WC

    def point(self, body=False):
        """Return the commanded position of a point (m)."""
        terms = evaluate_dynamics(self.robot, self.state.q, self.state.v)
        return terms.point(*(self.link, self.p) if body else self.guiding.tip).p_WC


@pytest.mark.parametrize("arm", ["lwr4", "panda", "xarm7"])
@pytest.mark.parametrize("body_first", [False, True])
def test_the_main_task_is_exact_and_the_second_one_within_its_reach(load_arm, arm, body_first):
    """J_1q̈ = a_1 on the range of J_1; J_2q̈ = a_2 where J_2N_1 reaches; N_1J_2† as printed leaves a part undone."""
    robot, rng = load_arm(arm), np.random.default_rng(1)
    printed = []
    for q, v in states(robot, 20, 3):
        _, e, b = jacobians(robot, q, v)
        J = np.array([b.Jv_WC, e.Jv_WC] if body_first else [e.Jv_WC, b.Jv_WC])
        a, rest = rng.standard_normal((2, 3)), rng.standard_normal(robot.n)
        threshold = 1e-3
        acceleration, N_1, reachable, rank, _ = laws.priority_acceleration(J, a, rest, threshold)
        sigma = np.linalg.svd(J[0])[1]
        if np.any((sigma > 1e-5) & (sigma < threshold)):
            continue
        np.testing.assert_allclose(J[0] @ acceleration, reachable[0] @ a[0], atol=1e-4)
        sigma = np.linalg.svd(J[1] @ N_1)[1]
        if np.any((sigma > 1e-5) & (sigma < threshold)):
            continue
        U = np.linalg.svd(J[1] @ N_1)[0][:, sigma > threshold]
        assert rank[1] == U.shape[1]
        np.testing.assert_allclose(U.T @ (J[1] @ acceleration), U.T @ a[1], atol=1e-4)
        J_inv = np.linalg.pinv(J[0], rcond=1e-6)
        old = J_inv @ a[0] + N_1 @ np.linalg.pinv(J[1], rcond=1e-6) @ (a[1] - J[1] @ J_inv @ a[0])
        asked = U.T @ (a[1] - J[1] @ J_inv @ a[0])
        printed.append(np.linalg.norm(U.T @ (J[1] @ old) - U.T @ a[1]) / np.linalg.norm(asked))
    assert np.median(printed) > 0.1


def test_the_second_point_leaves_the_main_one_alone_in_a_singularity(lwr4):
    """J_1q̈ is the same whatever is asked of the second point, also where a singular value of J_1 is damped."""
    rng, threshold = np.random.default_rng(2), 0.05
    for bent in (1e-3, 0.02, 0.1):
        q = HOME.copy()
        q[3], q[5] = bent, 0.5 * bent
        _, e, b = jacobians(lwr4, q, np.zeros(7))
        assert np.linalg.svd(e.Jv_WC)[1][2] < threshold
        J, a, rest = np.array([e.Jv_WC, b.Jv_WC]), rng.standard_normal((2, 3)), rng.standard_normal(7)
        moved = [
            J[0] @ laws.priority_acceleration(J, np.array([a[0], scale * a[1]]), rest, threshold)[0]
            for scale in (0.0, 1.0, 10.0)
        ]
        np.testing.assert_allclose(moved[1:], [moved[0]] * 2, atol=1e-9)


def test_every_point_of_the_upper_arm_lacks_one_direction(lwr4):
    """On link 3 the rank is 2; the direction lost points to the shoulder, and forces along it have no effect."""
    for q, v in states(lwr4, 5):
        terms, _, b = jacobians(lwr4, q, v)
        _, reachable, rank, lost, _ = laws.task_inverse(b.Jv_WC, 1e-3)
        assert rank == 2
        radial = b.p_WC - (terms.p_WL[1])
        np.testing.assert_allclose(np.abs(lost @ radial), np.linalg.norm(radial), rtol=1e-9)
        np.testing.assert_allclose(reachable @ radial, 0.0, atol=1e-9)


def test_damped_inverse_is_bounded_continuous_and_exact_where_regular():
    """‖J†‖ stays below 1.1/ε through a singularity, without a step, and is the pseudoinverse above ε."""
    epsilon, last = 0.05, None
    U, _, VT = np.linalg.svd(np.random.default_rng(0).standard_normal((3, 7)), full_matrices=False)
    for sigma in np.linspace(0.1, 0.0, 401):
        J = (U * [0.8, 0.5, sigma]) @ VT
        J_inv = laws.task_inverse(J, epsilon)[0]
        assert np.linalg.norm(J_inv, 2) <= 1.1 / epsilon
        if sigma > epsilon:
            np.testing.assert_allclose(J_inv, np.linalg.pinv(J), atol=1e-9)
        if last is not None:
            assert np.abs(J_inv - last).max() < 0.02 / epsilon
        last = J_inv


def test_admittance_settles_at_force_over_damping_with_its_time_constant():
    """ṗ → D⁻¹F for any matrices, as 1 − exp(−tD/M); a force beyond the limit gives the limit and no more."""
    M, D, T = 5.0 * np.eye(3), 30.0 * np.eye(3), 1e-3
    matrices = laws.admittance_matrices(M, D, T)
    v, F = np.zeros(3), np.array([3.0, 0.0, -3.0])
    for k in range(1, 2001):
        v, limited = laws.admittance(v, F, *matrices, 1.0)
        assert not limited
        if k % 100 == 0:
            np.testing.assert_allclose(v, (1.0 - np.exp(-k * T * 6.0)) * F / 30.0, atol=3e-4)
    matrices = laws.admittance_matrices(np.diag([1.0, 5.0, 20.0]), np.array([[30.0, 5, 0], [5, 40, 0], [0, 0, 9]]), T)
    for _ in range(20000):
        v, _ = laws.admittance(v, F, *matrices, 1.0)
    np.testing.assert_allclose(np.array([[30.0, 5, 0], [5, 40, 0], [0, 0, 9]]) @ v, F, atol=1e-3)
    for size in (20.0, 200.0, 2e4):
        v = np.zeros(3)
        for _ in range(5000):
            v, limited = laws.admittance(v, np.array([size, 0.0, 0.0]), *matrices, 0.4)
            assert np.linalg.norm(v) <= 0.4 + 1e-12
        assert limited


def test_smooth_limit_keeps_direction_and_slope():
    d = np.array([0.6, 0.0, 0.8])
    sizes = np.linspace(0.0, 2.0, 2001)
    out = np.array([np.linalg.norm(laws.smooth_limit(s * d, 0.5)) for s in sizes])
    assert np.all(out <= 0.5)
    assert np.all(np.diff(out) >= -1e-15)
    np.testing.assert_allclose(out[sizes <= 0.4], sizes[sizes <= 0.4], atol=1e-15)
    assert np.abs(np.diff(out, 2)).max() < 1.1e-5  # C¹: no kink
    np.testing.assert_allclose(laws.smooth_limit(d, 0.5) / np.linalg.norm(laws.smooth_limit(d, 0.5)), d)


def test_joints_at_their_bounds_leave_the_main_point_alone():
    """The limited velocity is within its bounds, and moves the main point as asked if joints are left for it."""
    rng, exact = np.random.default_rng(0), 0
    for _ in range(200):
        J, v = rng.standard_normal((2, 3, 7)), rng.standard_normal(7)
        low, high = np.full(7, -3.0), np.full(7, 3.0)
        high[2] = low[2] = 0.0
        out, changed = laws.limit_joint_velocity(v, J, low, high, 0.01)
        assert changed
        assert np.all((low <= out) & (out <= high))
        if np.all(np.abs(out[np.arange(7) != 2]) < 3.0):
            exact += 1
            np.testing.assert_allclose(J[0] @ out, J[0] @ v, atol=1e-8)
    assert exact > 100
    inside, changed = laws.limit_joint_velocity(0.1 * v, J, np.full(7, -3.0), np.full(7, 3.0), 0.01)
    assert not changed
    np.testing.assert_array_equal(inside, 0.1 * v)


# ---- the strategy ----------------------------------------------------------------------------------------------


def test_the_point_that_is_led_moves_with_force_over_damping(lwr4):
    robot = Guided(lwr4)
    out = robot.run(0.1)
    assert out.status == GuidingStatus.HOLD
    out = robot.run(1.2, F_e=(4.0, 0.0, 3.0))
    assert (out.priority, out.status) == (GuidingPriority.END_EFFECTOR, GuidingStatus.GUIDED)
    np.testing.assert_allclose(robot.velocity(), np.array([4.0, 0.0, 3.0]) / 30.0, atol=2e-4)
    out = robot.run(2.0)
    assert out.status == GuidingStatus.HOLD
    assert np.abs(robot.state.v).max() < 1e-4


@pytest.mark.parametrize("body_first", [False, True])
@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_the_second_hand_does_not_disturb_the_first(lwr4, body_first, scale):
    """The main point moves as without the second hand, and the second one moves towards its force."""
    F_e, F_b = np.array([2.5, 0.0, 2.5]), np.array([4.0, 1.5, 0.0])
    first = {"F_b": F_b} if body_first else {"F_e": F_e}
    both = {"F_b": F_b, "F_e": scale * F_e} if body_first else {"F_b": scale * F_b, "F_e": F_e}
    alone, pair = Guided(lwr4), Guided(lwr4)
    for robot in (alone, pair):
        robot.run(0.02)
        robot.run(0.8, **first)
    before = pair.velocity(not body_first)
    for _ in range(6):
        alone.run(0.1, **first)
        pair.run(0.1, **both)
        error = np.linalg.norm(pair.velocity(body_first) - alone.velocity(body_first))
        assert error < 0.005 * np.linalg.norm(alone.velocity(body_first))
    gained = pair.velocity(not body_first) - before
    assert gained @ (F_e if body_first else F_b) > 0.0
    assert pair.outputs[-1].priority == (GuidingPriority.BODY if body_first else GuidingPriority.END_EFFECTOR)


def test_the_force_fed_forward_is_smoothed(lwr4):
    """A step of the hand's force reaches the torque with the time constant asked for; a lost sensor keeps it."""
    terms = evaluate_dynamics(lwr4, HOME, np.zeros(7))
    wrench = np.array([0.0, 0.0, 0.0, 1.0, 2.0, 0.5])
    fed = {}
    for time in (0.0, 0.02):
        guiding = HandGuiding(lwr4, HandGuidingParameters(tip_point=TIP.tolist(), force_time=time))
        state = guiding.start(terms)
        for _ in range(10):  # 20 ms
            state, _ = guiding.step(state, terms, sense(terms, SkinReading(), wrench, guiding.tip))
        fed[time] = state.torque
    np.testing.assert_allclose(fed[0.0], terms.point(6, TIP).Jv_WC.T @ wrench[3:], atol=1e-12)
    np.testing.assert_allclose(fed[0.02], (1.0 - np.exp(-1.0)) * fed[0.0], atol=1e-12)
    state, _ = guiding.step(state, terms, sense(terms, SkinReading(status=SkinStatus.LOST), wrench, guiding.tip))
    np.testing.assert_array_equal(state.torque, fed[0.02])


def test_priority_goes_to_the_hand_that_stays(lwr4):
    """The first one touched keeps it through a moment of small force, and loses it when it is let go."""
    robot = Guided(lwr4)
    robot.run(0.02)
    robot.run(0.3, F_e=(5.0, 0.0, 0.0))
    out = robot.run(0.3, F_e=(5.0, 0.0, 0.0), F_b=(4.0, 0.0, 0.0))
    assert out.priority == GuidingPriority.END_EFFECTOR
    out = robot.run(0.1, F_b=(4.0, 0.0, 0.0))
    assert out.priority == GuidingPriority.END_EFFECTOR  # a hand that turns round
    out = robot.run(0.2, F_b=(4.0, 0.0, 0.0))
    assert out.priority == GuidingPriority.BODY
    out = robot.run(0.2, F_e=(5.0, 0.0, 0.0), F_b=(4.0, 0.0, 0.0))
    assert out.priority == GuidingPriority.BODY
    out = robot.run(0.3)
    assert out.priority == GuidingPriority.NONE


def test_every_change_is_bumpless(lwr4):
    """No acceleration jumps at a touch, a release, a change of priority or a fault, while forces change gradually.

    From cycle to cycle it changes by what the force does, ΔF/(M σ), and by what the fade of a step does: the largest
    step is that of a motion that is asked for all at once, F/(M σ). σ: the least singular value on the way.
    """
    robot = Guided(lwr4)
    robot.run(0.1)
    F_e, F_b, zero, sigma = np.array([6.0, 0.0, 4.0]), np.array([4.5, 1.5, 0.0]), np.zeros(3), 0.08
    sequence = [(F_e, zero), (F_e, F_b), (zero, F_b), (F_e, F_b), (F_e, zero), (zero, zero)]
    before = zero, zero
    for after in sequence:
        for share in np.linspace(0.02, 1.0, 50):  # 0.1 s
            now = [(1.0 - share) * old + share * new for old, new in zip(before, after)]
            robot.run(PERIOD, F_e=now[0], F_b=now[1])
        robot.run(0.35, F_e=after[0], F_b=after[1])
        before = after
    robot.run(0.1, F_e=F_e)
    robot.run(0.2, F_e=F_e, status=SkinStatus.LOST)
    robot.run(0.3)
    kinds = {(o.priority, tuple(o.rank > 0), o.status == GuidingStatus.SENSOR_LOST) for o in robot.outputs}
    assert len(kinds) >= 6
    a = np.array([o.acceleration for o in robot.outputs])
    onset = np.flatnonzero([o.priority == GuidingPriority.END_EFFECTOR for o in robot.outputs])[-50]
    step = np.linalg.norm(F_e) / 5.0 / sigma
    change = np.linalg.norm(np.diff(a[: onset - 1], axis=0), axis=1)
    assert change.max() < 1.3 * step * PERIOD * (1.0 / 0.1 + 1.0 / robot.params.fade_time)
    assert change.max() < 0.1 * step
    stopping = np.linalg.norm(np.diff(a[onset:], axis=0), axis=1)
    assert stopping.max() < 1.3 * step * PERIOD * (1.0 / 0.1 + 1.0 / robot.params.fade_time)


def test_nothing_winds_up_along_a_direction_that_the_body_cannot_move_in(lwr4):
    """A radial force moves nothing and leaves nothing behind: desired and actual point stay together."""
    robot = Guided(lwr4)
    robot.run(0.02)
    terms = evaluate_dynamics(lwr4, HOME, np.zeros(7))
    radial = terms.point(2, SKIN).p_WC - terms.p_WL[1]
    F_b = 5.0 * radial / np.linalg.norm(radial)
    out = robot.run(1.0, F_b=F_b)
    assert out.status == GuidingStatus.PARTIAL
    assert (out.rank[1], out.rank[0]) == (2, 0)
    np.testing.assert_allclose(out.unreachable_force[1], 5.0, rtol=1e-3)
    np.testing.assert_allclose(np.abs(out.unreachable_direction[1] @ F_b), 5.0, rtol=1e-3)
    assert np.linalg.norm(robot.velocity(True)) < 1e-3
    np.testing.assert_allclose(robot.state.p_d[1], robot.point(True), atol=1e-5)
    np.testing.assert_allclose(robot.state.v_d[1], robot.velocity(True), atol=1e-5)


def test_the_second_point_starts_again_when_it_was_held_back(lwr4):
    """Pushed for long against what the first hand forbids, it keeps no velocity or distance to be made up for."""
    robot = Guided(lwr4)
    robot.run(0.02)
    robot.run(0.3, F_e=(2.5, 0.0, 2.5))
    robot.run(1.5, F_e=(2.5, 0.0, 2.5), F_b=(0.0, 0.0, 18.0))
    gap = robot.state.p_d[1] - robot.point(True)
    assert np.linalg.norm(gap) < 1e-3


@pytest.mark.parametrize("force", [(60.0, 0.0, 0.0), (0.0, 60.0, 0.0), (0.0, 0.0, -60.0), (-40.0, -40.0, 40.0)])
def test_limits_hold_at_every_sample(lwr4, force):
    """Joint positions, speeds and accelerations, point speed and workspace, however hard a hand pulls."""
    robot = Guided(lwr4, end_effector=GuidedPointParameters(max_speed=0.3, workspace_radius=0.25))
    start = robot.point()
    robot.run(0.02)
    limited = False
    for _ in range(125):
        out = robot.run(0.02, F_e=force)
        q, v = robot.state.q, robot.state.v
        assert np.all((q > lwr4.q_min) & (q < lwr4.q_max))
        assert np.all(np.abs(v) <= 0.9 * lwr4.v_max + 1e-9)
        assert np.linalg.norm(out.velocity_desired[0]) <= 0.3 + 1e-9
        assert np.linalg.norm(robot.point() - start) < 0.25 + 2e-3
        limited |= out.status == GuidingStatus.LIMITED
    assert limited
    assert np.abs([o.acceleration for o in robot.outputs]).max() <= robot.params.max_acceleration + 1e-9


@pytest.mark.parametrize("speed", [0.02, 0.3, 1.5])
def test_a_workspace_is_kept_or_left_gradually(speed):
    """Within the profile a point stays inside; one that begins outside it loses so much speed a cycle, and no more."""
    centre, radius, time, slower = np.array([0.1, 0.2, 0.3]), 0.25, 0.2, 5.0 * PERIOD
    p, v, push = centre + [0.2, 0.0, 0.0], np.array([speed, 0.1, 0.0]), np.array([0.004, 0.0, 0.0])
    fits = speed <= 0.05 / time
    for _ in range(1000):
        following, bounded = laws.confine(v + push, p, centre, radius, time, slower)
        taken = v + push - following
        assert np.linalg.norm(taken) <= slower + 1e-12 and (bounded or not taken.any())
        p, v = p + PERIOD * following, following
        assert not fits or np.linalg.norm(p - centre) <= radius + 1e-5  # less than a step sideways
    assert bounded and abs(v[0]) < 1e-2  # it rests at the border, or beyond


@pytest.mark.parametrize("force", [(0.0, 25.0, 0.0), (0.0, 25.0, 15.0)])
def test_a_stretched_arm_stays_bounded(lwr4, force):
    """Led beyond its reach, joints stay within their speeds and limits; led back, it comes."""
    robot = Guided(lwr4, np.deg2rad([90.0, -60.0, 0.0, 15.0, 0.0, -10.0, 0.0]))
    robot.run(0.02)
    robot.run(2.0, F_e=force)
    assert np.all(np.abs([o.velocity for o in robot.outputs]) <= 0.9 * lwr4.v_max + 1e-9)
    assert np.linalg.norm(robot.velocity()) < 0.1
    before = robot.point()
    robot.run(1.0, F_e=(0.0, -8.0, 0.0))
    assert (robot.point() - before)[1] < -0.05


def test_at_the_end_of_its_reach_the_second_hand_does_not_disturb_the_first(lwr4):
    """Led outwards, the end effector slows down before it is stretched, the same whatever its elbow does."""
    alone, pair = Guided(lwr4), Guided(lwr4)
    for robot in (alone, pair):
        robot.run(0.02)
        robot.run(0.6, F_e=(0.0, 7.0, 0.0))
    for _ in range(15):
        alone.run(0.1, F_e=(0.0, 7.0, 0.0))
        pair.run(0.1, F_e=(0.0, 7.0, 0.0), F_b=(5.0, 0.0, 0.0))
        assert np.linalg.norm(pair.velocity() - alone.velocity()) < 0.02 * 0.23
    for robot in (alone, pair):
        assert robot.outputs[-1].status == GuidingStatus.LIMITED
        assert 0.95 < np.linalg.norm(robot.point() - [0.0, 0.0, 0.3105]) / 0.988 < 0.9901
    assert np.linalg.norm(pair.point(True) - alone.point(True)) > 0.02


@pytest.mark.parametrize(
    "fault", [{"status": SkinStatus.LOST}, {"stamp": -1.0}, {"F_e": (np.nan, 0.0, 0.0)}, {"F_b": (np.nan, 1.0, 0.0)}]
)
def test_without_a_sensor_the_arm_stops_and_waits_for_free_hands(lwr4, fault):
    """It comes to rest within 0.5 s, says why, and is led again only after all hands have let go."""
    robot = Guided(lwr4)
    robot.run(0.02)
    F_e = (6.0, 0.0, 0.0)
    robot.run(0.8, F_e=F_e)
    assert np.linalg.norm(robot.velocity()) > 0.15
    out = robot.run(0.5, **{"F_e": F_e, **fault})
    assert out.status == GuidingStatus.SENSOR_LOST
    assert out.priority == GuidingPriority.NONE
    assert np.linalg.norm(robot.velocity()) < 1e-3
    out = robot.run(0.2, F_e=F_e)
    assert out.status == GuidingStatus.WAITING
    assert np.linalg.norm(robot.velocity()) < 1e-3
    robot.run(0.05)
    assert robot.run(0.3, F_e=F_e).status == GuidingStatus.GUIDED
    for name in ("torque", "acceleration", "position", "velocity"):
        assert np.all(np.isfinite([getattr(o, name) for o in robot.outputs]))


def test_dead_or_saturated_modules_do_not_stop_it(lwr4):
    robot = Guided(lwr4)
    robot.run(0.02)
    for status in (SkinStatus.DEGRADED, SkinStatus.SATURATED):
        assert robot.run(0.3, F_b=(5.0, 0.0, 0.0), status=status).priority == GuidingPriority.BODY


@pytest.mark.parametrize("arm", ["panda", "xarm7"])
def test_another_arm_is_led_alike(load_arm, arm):
    robot = load_arm(arm)
    if arm == "panda":
        home, frame = np.array([0.3, 0.4, 0.1, -1.6, 0.2, 1.4, 0.1]), "panda_hand"
    else:
        home, frame = np.array([0.2, 0.3, 0.1, 1.2, 0.1, 0.8, 0.0]), "link7"
    guided = Guided(robot, home, skin_link=3, p_skin=np.array([0.0, 0.05, 0.0]), tip_frame=frame)
    guided.run(0.02)
    guided.run(1.0, F_e=(4.0, 0.0, 0.0))
    np.testing.assert_allclose(guided.velocity(), [4.0 / 30.0, 0.0, 0.0], atol=1e-3)
    out = guided.run(0.4, F_e=(4.0, 0.0, 0.0), F_b=(0.0, 5.0, 0.0))
    assert out.priority == GuidingPriority.END_EFFECTOR
    np.testing.assert_allclose(guided.velocity(), [4.0 / 30.0, 0.0, 0.0], atol=1e-3)


def test_parameters_are_checked(lwr4):
    for field in ("k_p", "period", "fade_time", "max_acceleration"):
        with pytest.raises(ParameterError, match=field):
            HandGuidingParameters(**{field: -1.0})
    with pytest.raises(ParameterError, match="touch_off"):
        GuidedPointParameters(touch_on=2.0, touch_off=3.0)
    with pytest.raises(ParameterError, match="damping"):
        GuidedPointParameters(damping=[30.0, -1.0, 30.0])
    with pytest.raises(ParameterError, match="period"):
        HandGuidingParameters(period=0.05)
    with pytest.raises(UnknownNameError, match="measured, commanded"):
        HandGuidingParameters(feedback="guessed")
    with pytest.raises(UnknownNameError, match="link_7"):
        HandGuiding(lwr4, HandGuidingParameters(tip_frame="nose"))
