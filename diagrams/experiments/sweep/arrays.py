"""Trials on arrays alone, without a diagram: the envelope and the stop check against adversaries, and the NMPC."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.nmpc.jobs import OBSTACLES, OMNIROB_POINTS, clearance, point_positions
from experiments.sweep.loops import braked, enveloped
from saphari_drake.control.nmpc.law import at_rest, nmpc_step
from saphari_drake.control.nmpc.parameters import NmpcParameters, NmpcReference, NmpcStatus
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.messages import ObstaclePoints
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import evaluate_dynamics
from saphari_drake.safety.joint_envelope.parameters import JointEnvelopeParameters, envelope_of
from saphari_drake.safety.verified_stop.law import Surroundings
from saphari_drake.safety.verified_stop.parameters import VerifiedStopParameters, body_of

Array = NDArray[np.float64]
Values = dict[str, float]
ROUNDING = 1e-9  # of shares and metres
ENVELOPE_STEPS, STOP_STEPS, NMPC_STEPS = 200, 200, 8  # cycles of a trial
FAST = 2.0  # m/s, people
RADIUS = 0.08  # m, of a person


@cache
def _envelope() -> tuple[Any, Any, Any]:
    robot, params = catalog.load("lwr4"), JointEnvelopeParameters()
    return robot, params, envelope_of(robot, params)


def envelope_trial(rng: np.random.Generator) -> Values:
    """Give the LWR4 the worst commands, and pushes within the share kept for them; no limit may be left."""
    robot, params, envelope = _envelope()
    kind, steps, n = int(rng.integers(3)), ENVELOPE_STEPS, robot.n
    middle, half = 0.5 * (envelope.q_max + envelope.q_min), 0.5 * (envelope.q_max - envelope.q_min)
    q = middle + rng.uniform(-0.9, 0.9, n) * half
    full = rng.choice([-1.0, 1.0], (steps, n)) * robot.tau_max
    if kind == 0:
        commands = rng.uniform(-3.0, 3.0, (steps, n)) * robot.tau_max
    elif kind == 1:
        commands = np.repeat(full[:1], steps, axis=0)
    else:
        switches = np.maximum.accumulate(np.where(rng.random(steps) < 0.02, np.arange(steps), 0))
        commands = full[switches]
    push = rng.uniform(-1.0, 1.0, n) * params.push_share * robot.tau_max
    worst, braking = enveloped(robot.tree, envelope, q, commands, push)
    speed, position, torque, rate = (float(share) for share in worst)
    return {"kind": float(kind), "speed_share": speed, "position_share": position, "torque_share": torque,
            "rate_share": rate, "braking": float(braking),
            "violated": float(worst.max() > 1.0 + ROUNDING)}  # fmt: skip


@cache
def _stop() -> tuple[Any, Any, Any]:
    robot, params = catalog.load("lwr4"), VerifiedStopParameters()
    return robot, params, body_of(robot, params)


def stop_trial(rng: np.random.Generator) -> Values:
    """Send people who run at the LWR4 while it is commanded at random; it may be touched where it stands alone."""
    robot, params, body = _stop()
    n, steps = robot.n, STOP_STEPS
    low, high = np.maximum(robot.q_min, robot.home - 0.5), np.minimum(robot.q_max, robot.home + 0.5)
    q = rng.uniform(low + 0.02, high - 0.02)
    way = rng.normal(size=(3, 3))
    way *= rng.uniform(0.7, 1.6, (3, 1)) / np.linalg.norm(way, axis=1, keepdims=True)
    p = robot.kinematics(q).p_WL[-2] + way
    p[:, 2] = np.abs(p[:, 2])
    commands = np.repeat(3.0 * robot.v_max * rng.normal(size=(5, n)) * (rng.random((5, n)) < 0.6), steps // 5, axis=0)
    around = Surroundings(p, np.zeros((3, 3)), np.full(3, RADIUS), np.full(3, FAST))
    found = braked(body, params.intervals, q, commands, around, FAST, rng.integers(n, size=(steps, 3)))
    gap, outside, moved, stopping = (float(value) for value in found)
    return {"least_gap_moving_m": gap, "outside_limits": outside, "moved_share": moved, "stopping_share": stopping,
            "violated": float(gap < -ROUNDING or outside > 0.0)}  # fmt: skip


@cache
def _nmpc() -> NmpcProblem:
    params = NmpcParameters(obstacle_cost=True, obstacle_constraints=True)
    robot = catalog.load("omnirob")
    return NmpcProblem(robot, robot.link_names[-1], list(OMNIROB_POINTS), params)


def nmpc_trial(rng: np.random.Generator) -> Values:
    """Start the mobile manipulator near the obstacles of Fig. 2; no command may leave its limits or lead into one."""
    problem = _nmpc()
    data, p = problem.data, problem.params
    q, obstacles = _clear_start(problem, rng)
    R, tip = problem.end_effector_pose(data.home)
    goal = tip + np.array([0.0, q[1] + rng.uniform(0.2, 1.0), 0.0]) + 0.1 * rng.normal(size=3)
    reference = NmpcReference(np.tile(goal, (problem.N + 2, 1)), np.tile(R, (problem.N + 2, 1, 1)))
    memory, least, fast, unsolved, start = at_rest(problem, q), np.inf, 0.0, 0, np.inf
    for k in range(NMPC_STEPS):
        memory = nmpc_step(problem, memory, q, reference, obstacles, 0.0)
        unsolved += memory.status == NmpcStatus.UNSOLVED
        fast = max(fast, float(np.abs(memory.command / problem.robot.v_max).max()))
        start = memory.clearance if k == 0 else start
        least = min(least, memory.clearance)
        q = q + p.period * memory.command
    outside = float(max((q - problem.robot.q_max).max(), (problem.robot.q_min - q).max(), 0.0))
    violated = fast > 1.0 + ROUNDING or outside > ROUNDING or least < min(start, 0.0) - 1e-6
    return {"least_clearance_m": least, "start_clearance_m": start, "speed_share": fast, "outside_limits": outside,
            "unsolved": float(unsolved), "violated": float(violated)}  # fmt: skip


def _clear_start(problem: NmpcProblem, rng: np.random.Generator) -> tuple[Array, ObstaclePoints]:
    """Return a posture and obstacles that are as far from each other as is asked."""
    robot, n, zero = problem.robot, problem.n, np.zeros(OBSTACLES.shape)
    while True:
        along = np.concatenate([[0.0, rng.uniform(0.0, 4.5), 0.0], np.zeros(n - 3)])
        q = problem.data.home + along + 0.1 * rng.normal(size=n)
        q = np.clip(q, robot.q_min + 0.05, robot.q_max - 0.05)
        obstacles = ObstaclePoints(OBSTACLES + 0.1 * rng.normal(size=zero.shape), zero, zero[:, 0].copy(), 0.0)
        places = point_positions(robot, OMNIROB_POINTS, evaluate_dynamics(robot, q, np.zeros(n)))
        if clearance(places, OMNIROB_POINTS, obstacles) > 0.0:
            return q, obstacles


TRIALS: dict[str, Callable[[np.random.Generator], Values]] = {
    "envelope": envelope_trial,
    "stop": stop_trial,
    "nmpc": nmpc_trial,
}
