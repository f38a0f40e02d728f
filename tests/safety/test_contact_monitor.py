"""The monitor's modes: every transition, what is latched, and what a lost camera or an unseen contact does."""

import numpy as np
import pytest
from bench import PERIOD, Bench

from saphari_drake.errors import ParameterError
from saphari_drake.messages import CameraStatus, ContactPoint, InteractionMode, SystemStatus
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.contact_monitor import ContactMonitor, ContactMonitorParameters

HOLD, CONTACT, RETURN, YIELD, STOP = InteractionMode
PARAMS = ContactMonitorParameters()
NOTHING = ContactPoint()


def seen(link=4, offset=0.0):
    return ContactPoint(found=True, link=link, p_LC=np.array([0.06, 0.0, 0.1 + offset]))


class Situation(Bench):
    """A monitor whose robot stands at home, or `bent` from there by an angle of all joints."""

    def __init__(self, robot, **params):
        self.robot = robot
        system = ContactMonitor(robot, ContactMonitorParameters(**params))
        super().__init__(
            system, dynamics=self.terms(0.0), contact=0.0, contact_point=NOTHING, camera_status=CameraStatus.OK
        )

    def terms(self, bent, speed=0.0):
        return evaluate_dynamics(self.robot, self.robot.home + bent, np.full(self.robot.n, speed))

    def after(self, cycles=1, bent=None, speed=0.0, touched=None, point=None, camera=None):
        """Change what is given, run, and return the mode."""
        given = {"contact": touched, "contact_point": point, "camera_status": camera}
        self.set(**{name: value for name, value in given.items() if value is not None})
        if bent is not None:
            self.set(dynamics=self.terms(bent, speed))
        self.run(cycles)
        return self.mode

    @property
    def mode(self):
        return InteractionMode(int(self.read("mode")))

    @property
    def interaction(self):
        return self.read("interaction")


@pytest.fixture
def situation(lwr4):
    return lambda **params: Situation(lwr4, **params)


@pytest.fixture
def touched(situation):
    """In contact on link 4, begun at home."""
    s = situation()
    assert s.after(touched=1.0, point=seen()) == CONTACT
    return s


@pytest.fixture
def returning(touched):
    """Released while bent by 0.2 rad."""
    assert touched.after(bent=0.2) == CONTACT
    assert touched.after(touched=0.0, point=NOTHING) == RETURN
    return touched


# ---- hold ----------------------------------------------------------------------------------------------------------


def test_holds_where_it_starts(lwr4):
    """Not the home posture, if the robot stands elsewhere."""
    s = Situation(lwr4)
    s.set(dynamics=s.terms(0.3))
    s.simulator.Initialize()
    assert s.mode == HOLD
    np.testing.assert_array_equal(s.interaction.q_latched, lwr4.home + 0.3)


def test_posture_does_not_creep_while_holding(situation, lwr4):
    s = situation()
    for bent in (0.01, 0.02, -0.05):
        assert s.after(bent=bent) == HOLD
        np.testing.assert_array_equal(s.interaction.q_latched, lwr4.home)
    assert s.interaction.onset == 0


def test_seen_but_not_felt_is_no_contact(situation):
    """A hand beside the robot, or a false detection, changes nothing."""
    s = situation()
    assert s.after(50, point=seen()) == HOLD
    assert not s.read("active_contact").found


# ---- contact -------------------------------------------------------------------------------------------------------


def test_felt_and_seen_is_contact_in_one_cycle(touched, lwr4):
    """The posture at its onset is latched, the point is passed on."""
    assert touched.cycles == 1
    np.testing.assert_array_equal(touched.interaction.q_latched, lwr4.home)
    assert touched.read("active_contact") is touched.interaction.contact
    assert touched.interaction.contact.link == 4
    assert touched.interaction.onset == 1


def test_sliding_contact_keeps_its_onset(touched, lwr4):
    """Small moves of the seen point update it, and never latch anew."""
    for k in range(1, 20):
        touched.after(bent=0.01 * k, point=seen(offset=0.004 * k))
        assert touched.interaction.contact.p_LC[2] == pytest.approx(0.1 + 0.004 * k)
    assert touched.interaction.onset == 1
    np.testing.assert_array_equal(touched.interaction.q_latched, lwr4.home)


@pytest.mark.parametrize("point", [seen(link=5), seen(offset=0.06)])
@pytest.mark.parametrize("cycles", [30, 5])
def test_far_point_is_a_new_contact_that_began_where_the_touch_did(touched, lwr4, point, cycles):
    """Whether the late camera corrects itself or the hand goes elsewhere: the arm comes back to where it was."""
    touched.after(cycles)
    assert touched.after(bent=0.1, point=point) == CONTACT
    assert touched.interaction.onset == 2
    np.testing.assert_array_equal(touched.interaction.q_latched, lwr4.home)
    np.testing.assert_array_equal(touched.interaction.contact.p_LC, point.p_LC)


def test_contact_that_slides_over_the_border_of_two_links_keeps_its_onset(touched, lwr4):
    """The same place of the world on the next link is the same contact, whenever it comes."""
    touched.after(30)
    terms = touched.terms(0.1)
    here = seen()
    p_W = terms.p_WL[here.link] + terms.R_WL[here.link] @ here.p_LC + [0.01, 0.0, 0.0]
    there = ContactPoint(found=True, link=5, p_LC=terms.R_WL[5].T @ (p_W - terms.p_WL[5]))
    assert touched.after(bent=0.1, point=there) == CONTACT
    assert touched.interaction.onset == 1 and touched.interaction.contact.link == 5
    np.testing.assert_array_equal(touched.interaction.q_latched, lwr4.home)


def test_contact_that_is_no_longer_seen_goes_on_where_it_was(touched):
    """A hand that hides behind the arm still pushes."""
    before = touched.interaction
    assert touched.after(100, point=NOTHING) == CONTACT
    assert touched.interaction is before


# ---- return --------------------------------------------------------------------------------------------------------


def test_release_returns_to_the_latched_posture(returning, lwr4):
    np.testing.assert_array_equal(returning.interaction.q_latched, lwr4.home)
    assert returning.interaction.onset == 1 and returning.interaction.contact.found


def test_of_a_released_contact_no_force_is_asked(touched):
    assert touched.read("active_contact").found
    assert touched.after(touched=0.0, point=NOTHING) == RETURN
    assert not touched.read("active_contact").found


def test_return_ends_when_the_point_has_settled(returning, lwr4):
    """Near and slow for the settle time; then the posture reached is held."""
    settle = round(PARAMS.settle_time / PERIOD)
    assert returning.after(settle - 1, bent=0.0001) == RETURN
    assert returning.after(2) == HOLD
    np.testing.assert_array_equal(returning.interaction.q_latched, lwr4.home + 0.0001)
    assert not returning.read("active_contact").found


@pytest.mark.parametrize(("bent", "speed"), [(0.2, 0.0), (0.0, 0.05)])
def test_return_does_not_end_far_away_or_in_motion(returning, bent, speed):
    assert returning.after(5 * round(PARAMS.settle_time / PERIOD), bent=bent, speed=speed) == RETURN


def test_settling_starts_again_after_each_excursion(returning):
    for _ in range(3):
        assert returning.after(30, bent=0.0) == RETURN
        assert returning.after(1, bent=0.1) == RETURN
    assert returning.after(41, bent=0.0) == HOLD


def test_return_that_cannot_settle_ends_by_timeout(situation):
    """Its duration counts from the release, however long the contact was."""
    s = situation(return_timeout=0.5)
    s.after(300, touched=1.0, point=seen(), bent=0.2)
    assert s.after(touched=0.0, point=NOTHING, bent=0.3) == RETURN
    assert s.after(98) == RETURN
    assert s.after(3) == HOLD
    np.testing.assert_array_equal(s.interaction.q_latched, s.robot.home + 0.3)


def test_touched_again_while_returning(returning, lwr4):
    """At the same place it is the same contact; elsewhere a new one."""
    assert returning.after(touched=1.0, point=seen(offset=0.01)) == CONTACT
    assert returning.interaction.onset == 1
    returning.after(touched=0.0, point=NOTHING)
    assert returning.after(touched=1.0, point=seen(link=6)) == CONTACT
    assert returning.interaction.onset == 2
    np.testing.assert_array_equal(returning.interaction.q_latched, lwr4.home + 0.2)


# ---- yield ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", ["situation", "returning"])
def test_felt_but_not_seen_yields(start, request):
    """Also while returning: someone stands in the way."""
    s = request.getfixturevalue(start)
    s = s() if start == "situation" else s
    assert s.after(touched=1.0, point=NOTHING) == YIELD
    assert not s.read("active_contact").found


def test_yielding_goes_on_until_the_released_arm_is_at_rest_and_holds_where_it_was_felt(situation, lwr4):
    """No posture is latched on the way, so that touch after touch it does not creep."""
    s = situation()
    s.after(touched=1.0)
    assert s.after(20, bent=0.2) == YIELD
    assert s.after(100, touched=0.0, bent=0.1, speed=0.1) == YIELD
    settle = round(PARAMS.settle_time / PERIOD)
    assert s.after(settle - 1, bent=0.0) == YIELD
    assert s.after(2) == HOLD
    np.testing.assert_array_equal(s.interaction.q_latched, lwr4.home)


def test_yielding_ends_at_the_return_timeout(situation):
    """Something keeps the arm moving though nobody is felt."""
    s = situation(return_timeout=0.5)
    s.after(touched=1.0)
    assert s.after(99, touched=0.0, bent=0.1, speed=0.1) == YIELD
    assert s.after(3) == HOLD


def test_contact_seen_later_began_where_it_was_felt(situation, lwr4):
    s = situation()
    s.after(touched=1.0)
    assert s.after(5, bent=0.2) == YIELD
    assert s.after(point=seen()) == CONTACT
    np.testing.assert_array_equal(s.interaction.q_latched, lwr4.home)


def test_a_contact_that_is_felt_but_seen_no_more_yields_in_time(situation, lwr4):
    """A residual that does not let go is no proof that somebody is there; by default it is answered on."""
    s, patient = situation(unseen_time=0.15), situation()
    for each in (s, patient):
        each.after(touched=1.0, point=seen())
        assert each.after(29, point=NOTHING, bent=0.1) == CONTACT
    assert s.after(2) == YIELD
    np.testing.assert_array_equal(s.interaction.q_latched, lwr4.home + 0.1)
    assert patient.after(200) == CONTACT


# ---- stop ----------------------------------------------------------------------------------------------------------

START = {
    HOLD: {},
    CONTACT: {"touched": 1.0, "point": seen()},
    YIELD: {"touched": 1.0},
}


@pytest.mark.parametrize("status", [CameraStatus.STALE, CameraStatus.INVALID])
@pytest.mark.parametrize("mode", START)
def test_lost_camera_stops_within_one_period(situation, mode, status):
    """From every mode, touched or not."""
    s = situation()
    assert s.after(**START[mode]) == mode
    assert s.after(camera=status) == STOP
    assert s.after(200) == STOP
    assert not s.read("active_contact").found


def test_lost_camera_stops_a_return(returning):
    assert returning.after(camera=CameraStatus.STALE) == STOP


def test_camera_that_has_no_frame_yet_is_not_lost(situation):
    assert situation().after(10, camera=CameraStatus.WAITING) == HOLD


@pytest.mark.parametrize(
    ("then", "mode"), [({}, HOLD), ({"touched": 1.0}, YIELD), ({"touched": 1.0, "point": seen()}, CONTACT)]
)
def test_stop_ends_after_the_camera_has_worked_for_a_while(situation, then, mode):
    """A single good frame does not end it. What holds then is latched then."""
    s = situation()
    s.after(camera=CameraStatus.STALE)
    recovery = round(PARAMS.camera_recovery_time / PERIOD)
    assert s.after(recovery - 1, camera=CameraStatus.OK, bent=0.1) == STOP
    assert s.after(1, camera=CameraStatus.INVALID) == STOP
    assert s.after(recovery - 1, camera=CameraStatus.OK, **then) == STOP
    assert s.after(2) == mode
    np.testing.assert_array_equal(s.interaction.q_latched, s.robot.home + 0.1)


@pytest.mark.parametrize("status", [np.nan, 7.0, -1.0])
def test_unknown_camera_status_stops(situation, status):
    """A status that is none is no sign of a working camera."""
    assert situation().after(camera=status) == STOP


def test_onset_counts_every_latched_posture(situation):
    """A change of onset is what tells the controller that q_latched is new."""
    s, before = situation(), None
    steps = [
        {"touched": 1.0, "point": seen()},
        {"bent": 0.1, "point": seen(link=5)},
        {"touched": 0.0, "point": NOTHING},
        {"touched": 1.0, "bent": 0.2},
        {"touched": 0.0},
        {"camera": CameraStatus.STALE, "bent": 0.3},
        {"cycles": 102, "camera": CameraStatus.OK, "bent": 0.4},
    ]
    for step in steps:
        before = s.interaction
        s.after(**step)
        changed = not np.array_equal(before.q_latched, s.interaction.q_latched)
        assert not changed or s.interaction.onset > before.onset
    assert s.mode == HOLD


def test_clone_of_the_context_goes_on_by_itself(touched):
    twin = touched.clone()
    assert touched.after(touched=0.0, point=NOTHING) == RETURN
    assert twin.read("mode") == CONTACT
    twin.run(camera_status=CameraStatus.STALE)
    assert twin.read("mode") == STOP
    assert touched.mode == RETURN


@pytest.mark.parametrize("name", ContactMonitorParameters.__dataclass_fields__)
@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_bad_parameters(name, bad):
    with pytest.raises(ParameterError, match=name):
        ContactMonitorParameters(**{name: bad})


# ---- inputs that cannot be used --------------------------------------------------------------------------------------


def test_a_state_that_is_not_known_stops_until_it_has_been_known_for_a_while(touched):
    """Nothing of it is latched; then the posture is held where the arm is."""
    before = touched.interaction.q_latched
    touched.set(dynamics=touched.terms(0.0).unknown())
    assert touched.read("system_status") == SystemStatus.BAD_INPUT
    for cycles in (1, 50):
        assert touched.after(cycles) == STOP
        np.testing.assert_array_equal(touched.interaction.q_latched, before)
    assert touched.after(bent=0.1, touched=0.0, point=NOTHING) == STOP
    assert touched.after(round(PARAMS.camera_recovery_time / PERIOD) + 1) == HOLD
    np.testing.assert_array_equal(touched.interaction.q_latched, touched.terms(0.1).q)


def test_a_state_that_is_not_known_at_the_start_stops(lwr4):
    """Home, where the arm may not be, is no posture to hold."""
    terms = evaluate_dynamics(lwr4, lwr4.home + 0.3, np.zeros(7))
    bench = Bench(ContactMonitor(lwr4), dynamics=terms.unknown(), contact=0.0, contact_point=NOTHING,
                  camera_status=CameraStatus.OK)  # fmt: skip
    assert bench.read("mode") == STOP
    bench.run(200, dynamics=terms)
    assert bench.read("mode") == HOLD
    np.testing.assert_array_equal(bench.read("interaction").q_latched, terms.q)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_not_finite_fall_to_the_safe_side(situation, bad):
    """A touch that is no number is one, a point that is none is not seen, a camera status that is none no camera."""
    assert situation().after(touched=bad) == YIELD
    for point in (
        ContactPoint(True, 4, np.array([bad, 0.0, 0.0])),
        ContactPoint(True, 9, np.zeros(3)),
        ContactPoint(True),
    ):
        assert situation().after(touched=1.0, point=point) == YIELD
    assert situation().after(camera=bad) == STOP
