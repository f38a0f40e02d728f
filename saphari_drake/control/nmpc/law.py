"""Nonlinear model predictive control of an arm or a mobile manipulator among obstacles, eq. (9)–(22).

With v_k = (q_{k+1} − q_k)/T_s, e the pose error and h the home posture, minimize over q_1 … q_N ::

    Σ_{k=0}^{N−1} v_kᵀQ_v v_k + Σ_{k=1}^{N−1} [(q_k − h)ᵀQ_q(q_k − h) + e_kᵀQ_e e_k + O_k]
                              + (q_N − h)ᵀR_q(q_N − h) + e_NᵀR_e e_N + r_O O_N,
    O_k = Σ_ij c_i/(d_ijk² − d_min,i²)

subject to |v_k| ≤ v_max, q_min ≤ q_k ≤ q_max, d_ijk² ≥ d_min,i², and −Δx sin θ̄ + Δy cos θ̄ = 0 for a platform that
cannot slip. Corrected against the print: (15) pulls to a home posture, not to the origin, which would drag a platform
there; in (17) the orientation's error is twice the vector part of the quaternion of R_refᵀR, as orientations have no
differences. Added: with `pull_linear`, the terms eᵀQe grow linearly far from the pose (`barrier.pseudo_huber`). A
quadratic pull that leaves millimetres against the push of obstacles near the goal drags the robot into local minima
from afar.

The cost is evaluated in `horizon`, the constraints in `rows`, and one of `solvers` finds the minimum. A minimum
distance that cannot hold is relaxed at a high price. There is no guarantee that a feasible problem stays feasible:
obstacles are predicted with constant velocity, and one that is faster than the robot can reach it. So a result is
applied only if its first period is clear of the obstacles at all of several instants, or, with `retreat`, leaves more
room than braking; else the robot brakes, all joints in proportion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.nmpc.data import Scene
from saphari_drake.control.nmpc.kinematics import advance, command_to, joint_velocity, motion_clearance
from saphari_drake.control.nmpc.limits import feasible_start
from saphari_drake.control.nmpc.parameters import NmpcReference, NmpcStatus
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.control.nmpc.solvers.sqp import SqpOptions, solve_sqp, solve_sqp_dense, solve_sqp_within
from saphari_drake.control.nmpc.solvers.subproblem import QpStatus
from saphari_drake.math.rotations import are_rotations
from saphari_drake.messages import Immutable, ObstaclePoints, ObstacleStatus

Array = NDArray[np.float64]

SUBSTEPS = 10  # instants within a period at which an applied motion is checked
ROUNDING = 1.0e-9  # m; what rounding may take from a clearance


@dataclass(frozen=True)
class NmpcMemory(Immutable):
    """What the controller remembers from one step to the next.

    Attributes
    ----------
    command, pending : (n,) arrays
        Commands of this period and, with delay compensation, of the next one; see `kinematics.advance`.
    before : (n,) array
        Command with which this period begins; with a ramp that goes to `command`, see `kinematics.ramped`.
    motion : (N + 1, n) array
        Predicted positions, now and half a ramp after the end of each period.
    since : float
        Time (s) at which this period began.
    status : NmpcStatus
    slack, clearance : float
        Largest predicted violation of a distance constraint, and the smallest clearance in this period (m).
    iterations : int
        Quadratic programs solved.
    """

    command: Array
    pending: Array
    before: Array
    motion: Array
    status: NmpcStatus = NmpcStatus.WAITING
    slack: float = 0.0
    clearance: float = np.inf
    iterations: int = 0
    since: float = 0.0


class NmpcSolution(NamedTuple):
    """What a solver found for one control step."""

    Q: Array  # (N, n), positions of stages 1 … N
    status: NmpcStatus  # SOLVED, REAL_TIME, UNCONVERGED or UNSOLVED
    iterations: int = 0  # quadratic programs solved
    slack: float = 0.0  # largest violation of a distance constraint, as length (m)


def at_rest(problem: NmpcProblem, q: Array) -> NmpcMemory:
    """Return the memory of a controller that has not run yet."""
    zero = np.zeros(problem.n)
    return NmpcMemory(zero, zero, zero, np.tile(q, (problem.N + 1, 1)))


def solve(problem: NmpcProblem, scene: Scene, guess: Array, iterations: int | None = None) -> NmpcSolution:
    """Solve one control step with the solver that the parameters name.

    Parameters
    ----------
    problem : NmpcProblem
    scene : Scene
    guess : (N, n) array
        Of the positions; what breaks the limits is clipped.
    iterations : int, optional
        Most iterations; default: 1 in mode "real_time", else those of the parameters.
    """
    p, data = problem.params, problem.data
    if problem.program is not None:
        Q, found = problem.program.solve(scene, feasible_start(data, scene, guess))
        return NmpcSolution(Q, _status(found, found == QpStatus.SOLVED, NmpcStatus.UNCONVERGED))
    if iterations is None:
        iterations = 1 if p.mode == "real_time" else p.max_iterations
    options = SqpOptions(iterations, p.tolerance, p.slack_penalty, p.exact_hessian and iterations > 1)
    if p.deadline > 0.0 and p.solver == "active_set":
        at = solve_sqp_within(data, scene, guess, options, p.deadline)
    else:
        at = (solve_sqp_dense if p.solver == "daqp" else solve_sqp)(data, scene, guess, options)
    stopped = NmpcStatus.REAL_TIME if iterations == 1 else NmpcStatus.UNCONVERGED
    return NmpcSolution(at.Q, _status(at.status, at.converged, stopped), at.solved, at.slack)


def _status(found: QpStatus, converged: bool, stopped: NmpcStatus) -> NmpcStatus:
    if found in (QpStatus.INFEASIBLE, QpStatus.INDEFINITE):
        return NmpcStatus.UNSOLVED
    if found == QpStatus.EXHAUSTED:
        return NmpcStatus.UNCONVERGED
    return NmpcStatus.SOLVED if converged else stopped


def brake(u: Array, a_max: Array, period: float) -> Array:
    """Return a command (n,) scaled down as a whole, as fast as the acceleration limits allow in that time (s)."""
    speed = np.abs(u)
    moving = speed > 0.0
    share = np.min(a_max[moving] * period / speed[moving], initial=1.0)
    return u * (1.0 - min(1.0, share))


def nmpc_step(
    problem: NmpcProblem, memory: NmpcMemory, q: Array, reference: NmpcReference, obstacles: ObstaclePoints, age: float
) -> NmpcMemory:
    """Return the next memory, with the command to apply.

    Parameters
    ----------
    problem : NmpcProblem
    memory : NmpcMemory
    q : (n,) array
        Measured positions.
    reference : NmpcReference
    obstacles : ObstaclePoints
    age : float
        How long ago (s) the obstacles were seen.
    """
    p = problem.params
    fault = _fault(problem, q, reference, obstacles, age)
    if fault is not None:
        start = q if np.all(np.isfinite(q)) and q.shape == (problem.n,) else memory.motion[0]
        return _braking(problem, memory, start, fault, np.inf)
    v_WO = np.ascontiguousarray(obstacles.v_WO, dtype=float)
    seen = obstacles.p_WO + age * v_WO, v_WO, np.ascontiguousarray(obstacles.radius, dtype=float)

    u, ramp = memory.command, p.ramp * p.period

    def clearance(to: Array, instants: Array) -> float:
        return float(motion_clearance(problem.data, q, u, to, ramp, *seen, p.clearance_margin, instants))

    times = p.period * np.arange(1, SUBSTEPS + 1) / SUBSTEPS
    now = clearance(u, np.zeros(1))
    inside = now < -ROUNDING
    if inside and not p.retreat:
        return _braking(problem, memory, q, NmpcStatus.START_INSIDE, now)
    required = (now if inside else 0.0) - ROUNDING
    # With compensation, the command that was computed during the last period is applied now; the next starts where
    # it leads, and half a ramp later: see `limits`.
    late = p.delay_compensation
    ahead, leading = advance(problem.data, q, u, 0.5 * ramp), memory.pending if late else u
    start = advance(problem.data, ahead, leading, p.period) if late else ahead
    v0 = joint_velocity(problem.data, start, leading)
    scene = problem.scene(start, reference, obstacles, age, int(late), v0)
    before = memory.motion if memory.status != NmpcStatus.WAITING else q[None]
    guess = before[np.minimum(np.arange(2, problem.N + 2) + late, len(before) - 1)]
    solution = solve(problem, scene, guess)
    upcoming = command_to(problem.data, start, solution.Q[0], p.period)
    left = clearance(memory.pending if late else upcoming, times)
    if p.mode == "real_time" and left < required and not late:
        solution = solve(problem, scene, solution.Q, p.max_iterations)
        upcoming = command_to(problem.data, start, solution.Q[0], p.period)
        left = clearance(upcoming, times)
    if solution.status == NmpcStatus.UNSOLVED or not np.all(np.isfinite(upcoming)):
        return _braking(problem, memory, q, NmpcStatus.UNSOLVED, now)
    too_near = left < required
    if too_near:
        stopped = _braking(problem, memory, q, NmpcStatus.START_INSIDE if inside else NmpcStatus.BRAKING, now)
        if not (p.retreat and left > clearance(stopped.command, times)):
            return replace(stopped, slack=solution.slack, iterations=solution.iterations)
    status = solution.status
    if inside:
        status = NmpcStatus.START_INSIDE
    elif too_near:
        status = NmpcStatus.RETREATING
    elif solution.slack > 0.0:
        status = NmpcStatus.SLACK
    motion = np.vstack([q, start, solution.Q[:-1]] if late else [q, solution.Q])
    command, left = memory.pending if late else upcoming, min(now, left)
    return NmpcMemory(command, upcoming, u, motion, status, solution.slack, left, solution.iterations)


def _braking(problem: NmpcProblem, memory: NmpcMemory, q: Array, status: NmpcStatus, clearance: float) -> NmpcMemory:
    """Return the memory of a step that slows down, with the stop that follows as predicted motion."""
    p = problem.params
    before, time = memory.command, p.period * (p.ramp or 1.0)
    command = brake(before, problem.a_max, time)
    motion, u = [q], command
    for _ in range(problem.N):
        motion.append(advance(problem.data, motion[-1], u, p.period))
        u = brake(u, problem.a_max, time)
    following = brake(command, problem.a_max, time)
    return NmpcMemory(command, following, before, np.array(motion), status, clearance=clearance)


def _fault(
    problem: NmpcProblem, q: Array, reference: NmpcReference, obstacles: ObstaclePoints, age: float
) -> NmpcStatus | None:
    """Return what is wrong with the inputs, if anything."""
    p_WE, R_WE = np.asarray(reference.p_WE), np.asarray(reference.R_WE)
    rows = len(p_WE)
    shapes = q.shape == (problem.n,) and rows > 0 and p_WE.shape == (rows, 3) and R_WE.shape == (rows, 3, 3)
    if not (shapes and np.isfinite(q).all() and np.isfinite(p_WE).all() and are_rotations(R_WE) and obstacles.usable):
        return NmpcStatus.BAD_INPUT
    if obstacles.status == ObstacleStatus.LOST or age > problem.params.obstacle_timeout:
        return NmpcStatus.OBSTACLES_LOST
    return None
