"""What readings of a joint contradict each other, or no joint can do; compiled."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit

Array = NDArray[np.float64]


class JointCheckStatus(IntEnum):
    """What is wrong with a joint, also published as a number."""

    OK = 0
    JUMP = 1  # a reading farther from the one before than the joint can move
    FROZEN = 2  # readings that do not change, of a joint that moved too fast to have stopped
    ENCODERS = 3  # the two encoders of the joint differ
    TORQUE = 4  # the drive gives another torque than it was asked for
    RECOVERING = 5  # consistent again, but not for long enough


OK, JUMP, FROZEN, ENCODERS, TORQUE, RECOVERING = (int(status) for status in JointCheckStatus)


class Joints(NamedTuple):
    """What is remembered of the joints, (n,) each; NaN where nothing is known yet."""

    q: Array  # rad or m, the last reading
    v: Array  # rad/s or m/s, speed before the readings stopped changing
    still: Array  # samples since they did
    expected: Array  # Nm or N, torque expected at the last sample
    error: Array  # Nm or N, of the torque, averaged


class Verdict(NamedTuple):
    """Result of a check."""

    status: int  # a JointCheckStatus
    joint: int  # the first one that is not believed, −1 for none


def unknown(n: int) -> Joints:
    """Return what is remembered at the start."""
    nan, zero = np.full(n, np.nan), np.zeros(n)
    return Joints(nan, zero, zero, nan, zero)


@njit(cache=True)
def judged(limits, joints, q, second):
    """Return status and joint of a sample of positions (n,) and of the second encoders' (n,), NaN where there are none.

    Only contradictions count: |q − q₋| > step, no joint is as fast; q the same, bit for bit, `still_samples` times,
    though from the speed v before it a joint needs a way of v²/2a > `slack` to stop; |q − q₂| > `encoder`; a mean
    error of the torque above its tolerance. A joint that stands, or is held, contradicts nothing.
    """
    for i in range(len(q)):
        if np.isfinite(q[i]) and abs(q[i] - joints.q[i]) > limits.step[i]:
            return JUMP, i
        if np.isfinite(q[i] + second[i]) and abs(q[i] - second[i]) > limits.encoder:
            return ENCODERS, i
        still = joints.still[i] + 1.0 if q[i] == joints.q[i] else 0.0
        way = joints.v[i] * joints.v[i] / (2.0 * limits.stop_acceleration)
        if still >= limits.still_samples and way > limits.slack:
            return FROZEN, i
        if abs(joints.error[i]) > limits.torque[i]:
            return TORQUE, i
    return OK, -1


@njit(cache=True)
def remembered(limits, joints, q, expected, measured):
    """Return what is remembered after a sample: arrays of `Joints`.

    The measured torque (n,) is compared with what was expected at this sample, the one before, and what follows at the
    same rate, whichever is nearest or between them: a drive may be up to a sample early or late. NaN is no error.
    """
    n = len(q)
    v, still, error = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        change = q[i] - joints.q[i]
        if change == 0.0:
            still[i], v[i] = joints.still[i] + 1.0, joints.v[i]
        elif abs(change) <= limits.step[i]:
            before = joints.v[i] if joints.still[i] < limits.still_samples else 0.0
            v[i] = before + limits.share * (change / limits.period - before)
        past = joints.expected[i] if np.isfinite(joints.expected[i]) else expected[i]
        width = abs(expected[i] - past)
        low, high = min(past, expected[i]) - width, max(past, expected[i]) + width
        difference = measured[i] - min(max(measured[i], low), high)
        if np.isfinite(difference):
            error[i] = joints.error[i] + limits.torque_share * (difference - joints.error[i])
    return np.where(np.isfinite(q), q, np.nan), v, still, expected.copy(), error
