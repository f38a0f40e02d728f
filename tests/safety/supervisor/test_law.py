"""The table of transitions: what leads where, when, and that nothing is ever added."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from saphari_drake.safety.supervisor.law import (
    TRANSITIONS,
    CellState,
    Event,
    Observed,
    Situation,
    speed_limit,
    supervised,
    told,
)
from saphari_drake.safety.supervisor.parameters import SupervisorParameters

PARAMS = SupervisorParameters(fault_names=["camera", "encoder"])


def after(situation, seen, time):
    for _ in range(round(time / PARAMS.period)):
        situation = supervised(situation, seen, PARAMS)
    return situation


WORKING = after(Situation(), Observed(), 0.5)


def test_from_the_start_it_goes_to_work():
    assert WORKING.state == CellState.FREE and WORKING.reason == Event.CLEAR


STORIES = {
    "a person comes near": (Observed(0.5), 0.01, CellState.SLOWED, Event.NEAR),
    "too near": (Observed(0.0), 0.01, CellState.STOP, Event.TOO_NEAR),
    "a touch": (Observed(touched=True), 0.03, CellState.CONTACT, Event.TOUCHED),
    "a touch near people": (Observed(0.0, touched=True), 0.03, CellState.CONTACT, Event.TOUCHED),
    "a hand that holds on": (Observed(touched=True, taken=True), 0.3, CellState.GUIDING, Event.TAKEN),
    "a fault": (Observed(fault=1), 0.005, CellState.FAULT, Event.FAULTY),
    "a fault in all that": (Observed(0.0, True, True, 0), 0.005, CellState.FAULT, Event.FAULTY),
}


@pytest.mark.parametrize("story", STORIES)
def test_what_leads_where(story):
    seen, time, state, reason = STORIES[story]
    found = after(WORKING, seen, time)
    assert (found.state, found.reason) == (state, reason)
    again = after(found, Observed(recover=True), 1.5)
    assert again.state == CellState.FREE, "back at work"


def test_a_moment_is_not_enough():
    assert after(WORKING, Observed(touched=True), 0.01).state == CellState.FREE
    assert after(after(WORKING, Observed(0.0), 0.01), Observed(), 0.05).state == CellState.STOP


def test_between_the_thresholds_all_stays():
    slowed = after(WORKING, Observed(0.5), 0.01)
    assert after(slowed, Observed(0.97), 2.0).state == CellState.SLOWED
    assert after(WORKING, Observed(0.97), 2.0).state == CellState.FREE
    stopped = after(WORKING, Observed(0.0), 0.01)
    assert after(stopped, Observed(0.03), 2.0).state == CellState.STOP


def test_a_fault_stays_until_recovery_is_asked_for():
    broken = after(WORKING, Observed(fault=1), 0.005)
    assert broken.fault == 1 and told(broken, PARAMS) == "fault: encoder"
    assert after(broken, Observed(), 10.0).state == CellState.FAULT
    assert after(broken, Observed(fault=1, recover=True), 10.0).state == CellState.FAULT
    assert after(broken, Observed(recover=True), 0.11).state == CellState.STOP


def test_every_state_can_be_left_for_a_fault_and_reached():
    assert {row.target for row in TRANSITIONS} == set(CellState)
    for state in CellState:
        assert any(state in row.sources for row in TRANSITIONS)
        seen = Observed(1.0, True, True, 0)
        assert supervised(Situation(state=state), seen, PARAMS).state == CellState.FAULT


def test_each_row_names_a_parameter():
    assert all(not row.dwell or hasattr(PARAMS, row.dwell) for row in TRANSITIONS)


@settings(max_examples=50)
@given(st.sampled_from(list(CellState)), st.floats(-1.0, 3.0))
def test_it_only_reduces(state, scale):
    limit = speed_limit(state, scale)
    assert 0.0 <= limit <= min(max(scale, 0.0), 1.0)
    assert state in (CellState.FREE, CellState.SLOWED) or limit == 0.0


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(0, 1), st.booleans(), st.booleans(), st.sampled_from([-1, 0])), max_size=40))
def test_no_job_moves_while_it_is_touched_or_too_near_for_long(history):
    """Whatever happened before: a touch of two cycles more than its time has ended the job."""
    situation = WORKING
    for seen in history:
        situation = supervised(situation, Observed(*seen), PARAMS)
    for seen in (Observed(touched=True), Observed(0.0), Observed(fault=0)):
        assert speed_limit(after(situation, seen, 0.03).state, 1.0) == 0.0
    assert np.isfinite(situation.since)
