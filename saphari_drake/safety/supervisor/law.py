"""The states of a cell, and the one table of transitions between them."""

from enum import IntEnum
from typing import NamedTuple

from saphari_drake.safety.supervisor.parameters import SupervisorParameters


class CellState(IntEnum):
    """What the robot does, also published as a number."""

    FREE = 0  # the job, at full speed
    SLOWED = 1  # the job, slower
    STOP = 2  # protective stop: the job stands, ready to go on
    CONTACT = 3  # a touch is answered
    GUIDING = 4  # a person leads the robot
    FAULT = 5  # something is broken: brakes, until recovery is asked for


class Event(IntEnum):
    """Why a state was entered, also published as a number."""

    START = 0
    FAULTY = 1  # a status tells a fault, or an input is not finite
    RECOVERED = 2  # all is well, and recovery was asked for
    TAKEN = 3  # skin or tool is held
    LET_GO = 4
    TOUCHED = 5
    RELEASED = 6
    TOO_NEAR = 7  # people leave no speed
    NEAR = 8  # people leave some
    ROOM = 9  # people leave some again
    CLEAR = 10  # nobody is near


class Observed(NamedTuple):
    """What the supervisor sees in a cycle."""

    speed_scale: float = 1.0  # 0 … 1
    touched: bool = False
    taken: bool = False
    fault: int = -1  # index of the first status that tells one; −1: none
    recover: bool = False


class Transition(NamedTuple):
    """One row of the table."""

    sources: tuple[CellState, ...]
    event: Event
    target: CellState
    dwell: str  # parameter that tells how long the event must last (s); empty: one cycle


_JOB = (CellState.FREE, CellState.SLOWED, CellState.STOP)
_WELL = tuple(state for state in CellState if state != CellState.FAULT)

# The first row counts whose event has lasted long enough. A fault wins, then a hand that holds on, then a touch.
TRANSITIONS = (
    Transition(_WELL, Event.FAULTY, CellState.FAULT, ""),
    Transition((CellState.FAULT,), Event.RECOVERED, CellState.STOP, "recovery_time"),
    Transition((*_JOB, CellState.CONTACT), Event.TAKEN, CellState.GUIDING, "taken_time"),
    Transition((CellState.GUIDING,), Event.LET_GO, CellState.STOP, "let_go_time"),
    Transition(_JOB, Event.TOUCHED, CellState.CONTACT, "touch_time"),
    Transition((CellState.CONTACT,), Event.RELEASED, CellState.STOP, "release_time"),
    Transition((CellState.FREE, CellState.SLOWED), Event.TOO_NEAR, CellState.STOP, ""),
    Transition((CellState.FREE,), Event.NEAR, CellState.SLOWED, ""),
    Transition((CellState.STOP,), Event.ROOM, CellState.SLOWED, "go_time"),
    Transition((CellState.SLOWED,), Event.CLEAR, CellState.FREE, "free_time"),
)


class Situation(NamedTuple):
    """State of the supervisor."""

    state: CellState = CellState.STOP
    reason: Event = Event.START
    fault: int = -1  # the status that told the fault; −1: none
    since: float = 0.0  # s, in this state
    lasting: tuple[float, ...] = (0.0,) * len(Event)  # s, for which each event has lasted in this state


def events(seen: Observed, params: SupervisorParameters) -> tuple[bool, ...]:
    """Return whether each event happens."""
    held = {
        Event.START: False,
        Event.FAULTY: seen.fault >= 0,
        Event.RECOVERED: seen.fault < 0 and seen.recover,
        Event.TAKEN: seen.taken,
        Event.LET_GO: not seen.taken,
        Event.TOUCHED: seen.touched,
        Event.RELEASED: not seen.touched,
        Event.TOO_NEAR: seen.speed_scale < params.stop_below,
        Event.NEAR: seen.speed_scale < params.slow_below,
        Event.ROOM: seen.speed_scale > params.go_above and not seen.touched and not seen.taken,
        Event.CLEAR: seen.speed_scale > params.free_above,
    }
    return tuple(held[event] for event in Event)


def supervised(before: Situation, seen: Observed, params: SupervisorParameters) -> Situation:
    """Return the situation one cycle later: at most one row of `TRANSITIONS` is followed."""
    T, now = params.period, events(seen, params)
    lasting = tuple(time + T if held else 0.0 for time, held in zip(before.lasting, now))
    for row in TRANSITIONS:
        dwell = getattr(params, row.dwell) if row.dwell else 0.0
        if before.state in row.sources and now[row.event] and lasting[row.event] >= dwell - 1e-9:
            fault = seen.fault if row.target == CellState.FAULT else -1
            return Situation(row.target, row.event, fault)
    return before._replace(since=before.since + T, lasting=lasting)


def speed_limit(state: CellState, speed_scale: float) -> float:
    """Return the share of the job's speed that a state allows: what people leave in the job, else none."""
    return min(max(speed_scale, 0.0), 1.0) if state in (CellState.FREE, CellState.SLOWED) else 0.0


def told(situation: Situation, params: SupervisorParameters) -> str:
    """Return state and reason in words, for a person who watches."""
    reason = situation.reason.name.lower().replace("_", " ")
    if 0 <= situation.fault < len(params.fault_names):
        reason = params.fault_names[situation.fault]
    return f"{situation.state.name.lower()}: {reason}"
