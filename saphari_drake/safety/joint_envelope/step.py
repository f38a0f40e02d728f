"""One period of the joint envelope, from what is measured and commanded to the torque; compiled as a whole."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.products import all_finite, apply
from saphari_drake.math.tree import Tree, tree_dynamics, tree_kinematics
from saphari_drake.messages import SystemStatus
from saphari_drake.safety.joint_envelope.law import EnvelopeStatus, Motion, limited_torque, predicted
from saphari_drake.safety.joint_envelope.parameters import Envelope
from saphari_drake.safety.joint_envelope.stale import Repeated, after, same

Array = NDArray[np.float64]
OK, NO_STATE, HOLDING = (float(s) for s in (SystemStatus.OK, SystemStatus.BAD_INPUT, SystemStatus.HOLDING))
BAD_INPUT = float(EnvelopeStatus.BAD_INPUT)


class Rules(NamedTuple):
    """Constants of one envelope."""

    envelope: Envelope
    stiffness: float  # 1/s² and 1/s, of the posture that is held
    damping: float
    delay: int  # periods from a torque to its effect
    width: int  # periods of the mean torque
    velocity_age: float  # s
    stale_time: float  # s


class Step(NamedTuple):
    """What a period gives."""

    torques: Array  # (4, n) applied, excess, mean over the last periods, acting now
    numbers: Array  # (4,) status, joint, margin, system status
    memory: Array  # of the next period, as `remembered` writes it


@njit(cache=True)
def remembered(torques: Array, repeated: Repeated) -> Array:
    """Return the memory as one vector: torques (k, n) of the last periods, the latest last, and a `Repeated`."""
    time = np.array([repeated.time])
    return np.concatenate((torques.ravel(), repeated.command, repeated.state, time, repeated.q_hold))


@njit(cache=True)
def recalled(memory: Array, n: int) -> tuple[Array, Repeated]:
    """Return the torques (k, n) and the `Repeated` of a memory."""
    rest = len(memory) - 4 * n - 1
    known = memory[rest:]
    repeated = Repeated(known[:n], known[n : 3 * n], known[3 * n], known[3 * n + 1 :])
    return memory[:rest].reshape(rest // n, n), repeated


@njit(cache=True)
def stepped(tree: Tree, rules: Rules, memory: Array, q: Array, v: Array, external: Array, command: Array) -> Step:
    """Return torques and status of one period, and what is remembered after it.

    Parameters
    ----------
    tree, rules :
        Model and constants.
    memory : array
        From `remembered`.
    q, v : (n,) arrays
        Measured (rad or m, rad/s or m/s); not finite: not known.
    external, command : (n,) arrays
        What the environment does to the robot, where finite, and what the controllers ask for (Nm or N).
    """
    e, n = rules.envelope, len(q)
    torques, repeated = recalled(memory, n)
    before, wish, pushed, known = torques[-1], command.copy(), external.copy(), all_finite(command)
    for i in range(n):
        wish[i] = min(max(command[i], -1e3 * e.tau_max[i]), 1e3 * e.tau_max[i]) if known else before[i]
        pushed[i] = external[i] if np.isfinite(external[i]) else 0.0
    numbers = np.array([BAD_INPUT, -1.0, np.nan, NO_STATE])
    if all_finite(q) and all_finite(v):
        motion = tree_kinematics(tree, q, v)
        M, Cv, _, g, _ = tree_dynamics(tree, motion, v)
        h = Cv + g + e.viscous * v
        held = same(command, repeated.command) and np.isfinite(repeated.q_hold[0])
        if held or not known:
            pull = rules.stiffness * ((repeated.q_hold if held else q) - q) - rules.damping * v
            wish = apply(M, pull) + h
        now = Motion(q, v, M, h, pushed, before)
        limited = limited_torque(e, predicted(e, now, torques, rules.delay, rules.velocity_age), wish)
        torque = limited.torque
        numbers[0] = BAD_INPUT if held or not known else limited.status
        numbers[1], numbers[2], numbers[3] = limited.joint, limited.margin, HOLDING if held or not known else OK
    else:
        torque = _within_rate(e, wish, before)
    later = np.empty_like(torques)
    later[:-1], later[-1] = torques[1:], torque
    given = np.empty((4, n))
    given[0], given[1], given[3] = torque, wish - torque, later[-1 - rules.delay]
    given[2] = 0.0
    for k in range(rules.width):
        given[2] += later[k]
    given[2] /= rules.width
    repeated = after(repeated, command, np.concatenate((q, v)), e.period, rules.stale_time)
    return Step(given, numbers, remembered(later, repeated))


@njit(cache=True)
def _within_rate(e, command, before):
    """Return the torque that size and rate leave of a command (n,)."""
    torque = command.copy()
    for i in range(len(torque)):
        step = e.tau_rate[i] * e.period
        torque[i] = min(max(command[i], before[i] - step), before[i] + step)
        torque[i] = min(max(torque[i], -e.tau_max[i]), e.tau_max[i])
    return torque
