"""Other solvers for the SQP's quadratic programs: DAQP, and OSQP or Clarabel through a MathematicalProgram."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray
from pydrake.solvers import ClarabelSolver, MathematicalProgram, OsqpSolver, SolverOptions

from saphari_drake.control.nmpc.iteration import Subproblem
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.control.nmpc.rows import Rows
from saphari_drake.errors import SolverError

Array = NDArray[np.float64]


class DenseQP(NamedTuple):
    """Minimize ½ xᵀHx + fᵀx subject to low ≤ x ≤ high and lower ≤ A x ≤ upper, with x = (δ, s)."""

    H: Array
    f: Array
    low: Array
    high: Array
    A: Array
    lower: Array
    upper: Array


QpSolver = Callable[[Subproblem], tuple[Array, Array, Array, float]]


def dense_qp(qp: Subproblem, off: Array, penalty: float, soft: bool = True) -> DenseQP:
    """Write a subproblem as dense matrices, with slacks s ≥ 0 at the price penalty·(s + ½ s²) if it is `soft`.

    With hard rows, x is δ alone; their solution is that of the soft ones if no multiplier exceeds the penalty.
    """
    N, n = qp.g.shape
    size, rows, e = N * n, len(qp.rows.z), len(qp.slip.z)
    m = rows if soft else 0
    H = np.zeros((size + m, size + m))
    blocks = H[:size, :size].reshape(N, n, N, n)
    D = np.zeros((N, n, N, n))
    for k in range(N):
        blocks[k, :, k, :] = qp.H[k]
        D[k, :, k, :] = np.eye(n)
        if k > 0:
            blocks[k, :, k - 1, :] = blocks[k - 1, :, k, :] = -np.diag(off)
            D[k, :, k - 1, :] = -np.eye(n)
    H[size:, size:] = penalty * np.eye(m)
    A = np.zeros((size + rows + e, size + m))
    A[:size, :size] = D.reshape(size, size)
    A[size : size + rows, :size] = _spread(qp.rows, size)
    A[size : size + m, size:] = np.eye(m)
    A[size + rows :, :size] = _spread(qp.slip, size)
    return DenseQP(
        H,
        np.concatenate([qp.g.ravel(), np.full(m, penalty)]),
        np.concatenate([qp.low.ravel(), np.zeros(m)]),
        np.concatenate([qp.high.ravel(), np.full(m, np.inf)]),
        A,
        np.concatenate([qp.v_low.ravel(), -qp.rows.z, -qp.slip.z]),
        np.concatenate([qp.v_high.ravel(), np.full(rows, np.inf), -qp.slip.z]),
    )


def make_qp_solver(name: str, problem: NmpcProblem) -> QpSolver:
    """Return a function from a subproblem to δ (N, n), multipliers and slacks of its distance rows, and the largest.

    The largest is that of the multipliers of distance and slip rows.
    """
    solve = _daqp if name == "daqp" else _program_solver(name)
    off = problem.data.Q_v * (2.0 / problem.params.period**2)

    penalty = problem.params.slack_penalty

    def qp_solver(qp: Subproblem) -> tuple[Array, Array, Array, float]:
        size, m = qp.g.size, len(qp.rows.z)
        hard = _try_daqp(dense_qp(qp, off, penalty, soft=False))[0] if name == "daqp" else None
        if hard is not None and np.abs(hard[1][size : size + m]).max(initial=0.0) <= penalty:
            (x, dual), slack = hard, np.zeros(m)
        else:
            x, dual = solve(dense_qp(qp, off, penalty))
            slack = np.where(x[size:] > 1e-7, x[size:], 0.0)
        nonlinear = np.abs(dual[size:])
        return x[:size].reshape(qp.g.shape), nonlinear[:m], slack, float(nonlinear.max(initial=0.0))

    return qp_solver


def _try_daqp(qp: DenseQP) -> tuple[tuple[Array, Array] | None, int]:
    """Return x and the multipliers of the rows of A, or None, and DAQP's exit flag."""
    upper, lower = np.concatenate([qp.high, qp.upper]), np.concatenate([qp.low, qp.lower])
    sense = np.where(upper == lower, 5, 0).astype(np.int32)
    x, _, flag, info = daqp.solve(
        qp.H, qp.f, qp.A, np.minimum(upper, 1e30), np.maximum(lower, -1e30), sense, primal_tol=1e-9
    )
    return ((np.asarray(x), np.asarray(info["lam"])[len(x) :]) if flag > 0 else None), flag


def _daqp(qp: DenseQP) -> tuple[Array, Array]:
    solution, flag = _try_daqp(qp)
    if solution is None:
        raise SolverError("daqp", f"exit flag {flag}")
    return solution


def _program_solver(name: str) -> Callable[[DenseQP], tuple[Array, Array]]:
    """Return a function that solves by OSQP or Clarabel; its program is built once for each number of rows."""
    solver = OsqpSolver() if name == "osqp" else ClarabelSolver()
    options = SolverOptions()
    if name == "osqp":
        for key in ("eps_abs", "eps_rel"):
            options.SetOption(solver.id(), key, 1e-8)
        options.SetOption(solver.id(), "max_iter", 20000)
        options.SetOption(solver.id(), "polishing", 0)
    built: dict[tuple[int, int], tuple] = {}

    def solve(qp: DenseQP) -> tuple[Array, Array]:
        if qp.A.shape not in built:
            program = MathematicalProgram()
            x = program.NewContinuousVariables(len(qp.f))
            cost = program.AddQuadraticCost(qp.H, qp.f, x, is_convex=True)
            box = program.AddBoundingBoxConstraint(qp.low, qp.high, x)
            built[qp.A.shape] = program, x, cost, box, program.AddLinearConstraint(qp.A, qp.lower, qp.upper, x)
        program, x, cost, box, rows = built[qp.A.shape]
        cost.evaluator().UpdateCoefficients(qp.H, qp.f, 0.0, is_convex=True)
        box.evaluator().UpdateLowerBound(qp.low)
        box.evaluator().UpdateUpperBound(qp.high)
        rows.evaluator().UpdateCoefficients(qp.A, qp.lower, qp.upper)
        result = solver.Solve(program, None, options)
        if not result.is_success():
            raise SolverError(name, str(result.get_solution_result()))
        return result.GetSolution(x), np.asarray(result.GetDualSolution(rows))

    return solve


def _spread(rows: Rows, size: int) -> Array:
    """Return dense rows (rows, size) of constraints that know their stage and the one before."""
    n = rows.b.shape[1]
    G = np.zeros((len(rows.z), size))
    for row, k in enumerate(rows.stage):
        G[row, (k - 1) * n : k * n] = rows.b[row]
        if k > 1:
            G[row, (k - 2) * n : (k - 1) * n] = rows.a[row]
    return G
