"""Gauss–Newton SQP on the problem of Section 3, with the QP solver that the parameters name."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.nmpc import iteration as nmpc_sqp
from saphari_drake.control.nmpc.horizon import no_multipliers
from saphari_drake.control.nmpc.iteration import Scene
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.control.nmpc.program import build_program, solve_program
from saphari_drake.control.nmpc.qp_solvers import make_qp_solver
from saphari_drake.messages import NmpcStatus

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NmpcSolution:
    """What one control step found.

    Attributes
    ----------
    Q : (N, n) array
        Joint positions of stages 1 … N.
    v : (n,) array
        Velocity until stage 1.
    status : NmpcStatus
    iterations : int
        QPs solved.
    slack : float
        Largest violation of a distance constraint, as length (m); 0 without any.
    solve_time : float
        Wall time (s).
    """

    Q: Array
    v: Array
    status: NmpcStatus
    iterations: int
    slack: float
    solve_time: float


def make_scene(problem: NmpcProblem, q0: Array, R_ref: Array, p_ref: Array, p_WO: Array, radius: Array) -> Scene:
    """Return the inputs of one control step as contiguous arrays."""
    return Scene(*(np.ascontiguousarray(a, dtype=float) for a in (q0, R_ref, p_ref, p_WO, radius)))


def solve(problem: NmpcProblem, scene: Scene, guess: Array, iterations: int | None = None) -> NmpcSolution:
    """Solve one control step from a guess (N, n).

    Parameters
    ----------
    problem : NmpcProblem
    scene : Scene
    guess : (N, n) array
        Of the positions; what breaks the limits is clipped.
    iterations : int, optional
        Most iterations; default: 1 in mode "real_time", else those of the parameters.
    """
    start = time.perf_counter()
    p, data = problem.params, problem.data
    if iterations is None:
        iterations = 1 if p.mode == "real_time" else p.max_iterations
    if p.solver != "sqp":
        Q = nmpc_sqp.feasible_start(data, scene.q0, guess)
        Q, converged = solve_program(build_program(problem, *scene), Q, p.solver)
        count, slack = 0, 0.0
    elif p.qp_solver == "active_set":
        Q, count, converged, _, slack = nmpc_sqp.solve_sqp(
            data, scene, guess, iterations, p.tolerance, p.slack_penalty, p.exact_hessian and iterations > 1
        )
    else:
        Q, count, converged, slack = _solve_with(problem, scene, guess, iterations)
    status = NmpcStatus.SOLVED if converged else NmpcStatus.UNCONVERGED
    if iterations == 1 and p.solver == "sqp" and not converged:
        status = NmpcStatus.REAL_TIME
    return NmpcSolution(Q, (Q[0] - scene.q0) / p.period, status, count, slack, time.perf_counter() - start)


def _solve_with(problem: NmpcProblem, scene: Scene, guess: Array, iterations: int) -> tuple[Array, int, bool, float]:
    """Run the loop of `iteration.solve_sqp` with another QP solver; return Q, QPs solved, converged, and slack (m)."""
    p, data = problem.params, problem.data
    qp_solver = make_qp_solver(p.qp_solver, problem)
    Q = nmpc_sqp.feasible_start(data, scene.q0, guess)
    multipliers, penalty, slack = no_multipliers(), 0.0, 0.0
    for count in range(1, iterations + 1):
        qp = nmpc_sqp.linearize(data, scene, Q, multipliers, p.exact_hessian and iterations > 1, np.inf)
        delta, lam, slacks, largest = qp_solver(qp)
        slack = nmpc_sqp.slack_length(data, scene, qp.rows, slacks)
        if np.max(np.abs(delta)) <= p.tolerance:
            return Q + delta, count, True, slack
        penalty = max(penalty, min(2.0 * largest, p.slack_penalty))
        Q, _ = nmpc_sqp.search(data, scene, Q, qp, delta, penalty, float(np.sum(slacks)))
        multipliers = nmpc_sqp.positive(qp.rows, lam, data.swept)
    return Q, iterations, False, slack
