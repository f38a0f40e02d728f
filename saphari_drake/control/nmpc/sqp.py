"""Gauss–Newton SQP on the problem of Section 3, with the QP solver that the parameters name."""

from __future__ import annotations

import time
from dataclasses import dataclass

import daqp
import numpy as np
from numpy.typing import NDArray

from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.control.nmpc.program import build_program, solve_program
from saphari_drake.math import nmpc_sqp
from saphari_drake.math.nmpc_sqp import Scene, Subproblem
from saphari_drake.port_values import NmpcStatus

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
    Q = nmpc_sqp.feasible_start(data, scene.q0, guess)
    status, count = NmpcStatus.UNCONVERGED, 0
    if p.solver != "sqp":
        Q, ok = solve_program(build_program(problem, *scene), Q, p.solver)
        status = NmpcStatus.SOLVED if ok else NmpcStatus.UNCONVERGED
    else:
        weight, pull = np.zeros((problem.N + 1, len(data.c))), np.zeros((problem.N + 1, len(data.c), 3))
        penalty = 0.0
        while count < iterations:
            qp = nmpc_sqp.linearize(data, scene, Q, weight, pull, p.exact_hessian)
            delta, multipliers, largest = solve_daqp(qp, data.Q_v * (2.0 / data.period**2), p.slack_penalty)
            count += 1
            if np.max(np.abs(delta)) <= p.tolerance:
                Q, status = Q + delta, NmpcStatus.SOLVED
                break
            penalty = max(penalty, min(2.0 * largest, p.slack_penalty))
            Q, _ = nmpc_sqp.search(data, scene, Q, qp, delta, penalty)
            weight, pull = nmpc_sqp.curvature(data, scene, qp.rows, multipliers)
        if p.mode == "real_time" and count == 1:
            status = NmpcStatus.REAL_TIME
    return NmpcSolution(Q, (Q[0] - scene.q0) / p.period, status, count, 0.0, time.perf_counter() - start)


def solve_daqp(qp: Subproblem, off: Array, penalty: float) -> tuple[Array, Array, float]:
    """Return δ (N, n), multipliers of the distance rows, and the largest multiplier of a nonlinear row, by DAQP."""
    N, n = qp.g.shape
    m, s = len(qp.rows.z), len(qp.slip.z)
    H = np.zeros((N, n, N, n))
    for k in range(N):
        H[k, :, k, :] = qp.H[k]
        if k > 0:
            H[k, :, k - 1, :] = H[k - 1, :, k, :] = -np.diag(off)
    size = N * n
    A = np.zeros((size + m + s, size))
    for k in range(N):
        for j in range(n):
            A[k * n + j, k * n + j] = 1.0
            if k > 0:
                A[k * n + j, (k - 1) * n + j] = -1.0
    for base, rows in ((size, qp.rows), (size + m, qp.slip)):
        for r, k in enumerate(rows.stage):
            A[base + r, (k - 1) * n : k * n] = rows.b[r]
            if k > 1:
                A[base + r, (k - 2) * n : (k - 1) * n] = rows.a[r]
    upper = np.concatenate([qp.high.ravel(), qp.v_high.ravel(), np.full(m, 1e30), -qp.slip.z])
    lower = np.concatenate([qp.low.ravel(), qp.v_low.ravel(), -qp.rows.z, -qp.slip.z])
    sense = np.zeros(len(upper), dtype=np.int32)
    sense[2 * size : 2 * size + m] = 8
    sense[2 * size + m :] = 5
    x, _, _, info = daqp.solve(
        H.reshape(size, size), qp.g.ravel(), A, np.minimum(upper, 1e30), np.maximum(lower, -1e30), sense
    )
    lam = np.abs(info["lam"])[2 * size :]
    return x.reshape(N, n), lam[:m], float(lam.max(initial=0.0))
