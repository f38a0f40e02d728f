"""One control step: inputs checked, problem solved, result checked for clearance, and braking where that fails."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.nmpc.motion import advance, command_to, motion_clearance
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.control.nmpc.sqp import NmpcSolution, make_scene, solve
from saphari_drake.messages import Immutable, NmpcReference, NmpcStatus, ObstaclePoints, ObstacleStatus

Array = NDArray[np.float64]

# Instants within a period at which an applied motion is checked.
SUBSTEPS = 10
# m; what rounding may take from a clearance.
ROUNDING = 1.0e-9


@dataclass(frozen=True)
class NmpcMemory(Immutable):
    """What the controller remembers from one step to the next.

    Attributes
    ----------
    command, pending : (n,) arrays
        Commands of this period and, with delay compensation, of the next one; see `motion.advance`.
    motion : (N + 1, n) array
        Predicted positions, from now on.
    status : NmpcStatus
    slack, clearance : float
        Largest predicted violation of a distance constraint, and the smallest clearance in this period (m).
    iterations : int
    solve_time : float
        Wall time of the last solution (s).
    """

    command: Array
    pending: Array
    motion: Array
    status: NmpcStatus = NmpcStatus.WAITING
    slack: float = 0.0
    clearance: float = np.inf
    iterations: int = 0
    solve_time: float = 0.0


def at_rest(problem: NmpcProblem, q: Array) -> NmpcMemory:
    """Return the memory of a controller that has not run yet."""
    zero = np.zeros(problem.n)
    return NmpcMemory(zero, zero, np.tile(q, (problem.N + 1, 1)))


def brake(u: Array, a_max: Array, period: float) -> Array:
    """Return a command (n,) scaled down as a whole, as fast as the acceleration limits allow in one period."""
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
    p_WO, radius = problem.predict(obstacles, age)
    v_WO = np.ascontiguousarray(obstacles.v_WO, dtype=float)

    def clearance(u: Array, instants: Array) -> float:
        return float(motion_clearance(problem.data, q, u, p_WO[0], v_WO, radius, p.clearance_margin, instants))

    times = p.period * np.arange(1, SUBSTEPS + 1) / SUBSTEPS
    now = clearance(memory.command, np.zeros(1))
    inside = now < -ROUNDING
    if inside and not p.retreat:
        return _braking(problem, memory, q, NmpcStatus.START_INSIDE, now)
    required = now if inside else 0.0
    if p.delay_compensation:
        # The command that was computed during the last period is applied now; the next one starts where it leads.
        command, first = memory.pending, 1
        start = advance(problem.data, q, command, p.period)
        p_WO, radius = problem.predict(obstacles, age + p.period)
    else:
        command, first, start = memory.command, 0, q
    scene = make_scene(problem, start, *problem.stages(reference, first), p_WO, radius)
    before = memory.motion if memory.status != NmpcStatus.WAITING else q[None]
    solution = solve(problem, scene, before[np.minimum(np.arange(2, problem.N + 2) + first, len(before) - 1)])
    upcoming = _command(problem, start, solution)
    if not p.delay_compensation:
        command = upcoming
    left = clearance(command, times)
    if p.mode == "real_time" and left < required - ROUNDING and not p.delay_compensation:
        again = solve(problem, scene, solution.Q, p.max_iterations)
        solution = replace(again, solve_time=again.solve_time + solution.solve_time)
        command = upcoming = _command(problem, start, solution)
        left = clearance(command, times)
    if not np.all(np.isfinite(upcoming)):
        return _braking(problem, memory, q, NmpcStatus.BRAKING, now)
    if left < required - ROUNDING:
        stopped = _braking(problem, memory, q, NmpcStatus.START_INSIDE if inside else NmpcStatus.BRAKING, now)
        return replace(stopped, slack=solution.slack, iterations=solution.iterations, solve_time=solution.solve_time)
    status = solution.status
    if inside:
        status = NmpcStatus.START_INSIDE
    elif solution.slack > 0.0:
        status = NmpcStatus.SLACK
    motion = np.vstack([q, start, solution.Q[:-1]] if p.delay_compensation else [q, solution.Q])
    return NmpcMemory(
        command, upcoming, motion, status, solution.slack, min(now, left), solution.iterations, solution.solve_time
    )


def _command(problem: NmpcProblem, start: Array, solution: NmpcSolution) -> Array:
    return np.asarray(command_to(problem.data, start, solution.Q[0], problem.params.period))


def _braking(problem: NmpcProblem, memory: NmpcMemory, q: Array, status: NmpcStatus, clearance: float) -> NmpcMemory:
    """Return the memory of a step that slows down, with the stop that follows as predicted motion."""
    p = problem.params
    command = brake(memory.command, problem.a_max, p.period)
    motion, u = [q], command
    for _ in range(problem.N):
        motion.append(advance(problem.data, motion[-1], u, p.period))
        u = brake(u, problem.a_max, p.period)
    following = brake(command, problem.a_max, p.period)
    return NmpcMemory(command, following, np.array(motion), status, 0.0, clearance)


def _fault(
    problem: NmpcProblem, q: Array, reference: NmpcReference, obstacles: ObstaclePoints, age: float
) -> NmpcStatus | None:
    """Return what is wrong with the inputs, if anything."""
    p_WE, R_WE = np.asarray(reference.p_WE), np.asarray(reference.R_WE)
    rows, m = len(p_WE), len(obstacles.p_WO)
    shapes = (
        q.shape == (problem.n,)
        and rows > 0
        and p_WE.shape == (rows, 3)
        and R_WE.shape == (rows, 3, 3)
        and np.shape(obstacles.p_WO) == (m, 3)
        and np.shape(obstacles.v_WO) == (m, 3)
        and np.shape(obstacles.radius) == (m,)
    )
    values = (q, p_WE, R_WE, obstacles.p_WO, obstacles.v_WO, obstacles.radius)
    if not shapes or not all(np.isfinite(np.add.reduce(value, axis=None)) for value in values):
        return NmpcStatus.BAD_INPUT
    if obstacles.status == ObstacleStatus.LOST or age > problem.params.obstacle_timeout:
        return NmpcStatus.OBSTACLES_LOST
    return None
