"""The whole nonlinear program of Section 3 as a MathematicalProgram: the reference for the compiled solver."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue
from pydrake.solvers import IpoptSolver, MathematicalProgram, SnoptSolver, SolverOptions

from saphari_drake.control.nmpc.horizon import HorizonData, evaluate, no_multipliers
from saphari_drake.control.nmpc.problem import NmpcProblem
from saphari_drake.control.nmpc.rows import distance_rows, slip_rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NmpcProgram:
    """A program with its variables.

    Attributes
    ----------
    program : MathematicalProgram
    q : (N, n) array of Variable
        Joint positions of stages 1 … N.
    q0 : (n,) array
        Where the horizon starts.
    """

    program: MathematicalProgram
    q: NDArray
    q0: Array


def build_program(
    problem: NmpcProblem, q0: Array, R_ref: Array, p_ref: Array, p_WO: Array, radius: Array
) -> NmpcProgram:
    """Return the nonlinear program of `NmpcProblem`, each term a cost or constraint of its own with exact gradients.

    Parameters
    ----------
    problem : NmpcProblem
    q0 : (n,) array
        Measured positions.
    R_ref, p_ref : (N + 1, 3, 3) and (N + 1, 3) arrays
        Reference poses, see `NmpcProblem.stages`.
    p_WO, radius : (N + 1, m, 3) and (m,) arrays
        Obstacles, see `NmpcProblem.predict`.
    """
    data, N, n = problem.data, problem.N, problem.n
    program = MathematicalProgram()
    q = program.NewContinuousVariables(N, n, "q")
    eye = np.eye(n)
    Q_v = np.diag(data.Q_v) / data.period**2
    reach = data.period * data.v_max
    low, high = np.minimum(data.q_min, q0), np.maximum(data.q_max, q0)
    for k in range(1, N + 1):
        now, last = q[k - 1], k == N
        if k == 1:
            program.AddQuadraticErrorCost(Q_v, q0, now).evaluator().set_description("velocity 1")
            program.AddBoundingBoxConstraint(q0 - reach, q0 + reach, now)
        else:
            pair = np.concatenate([now, q[k - 2]])
            D = np.hstack([eye, -eye])
            cost = program.AddQuadraticCost(2.0 * D.T @ Q_v @ D, np.zeros(2 * n), pair, is_convex=True)
            cost.evaluator().set_description(f"velocity {k}")
            program.AddLinearConstraint(D, -reach, reach, pair)
        posture = np.diag(data.R_q if last else data.Q_q)
        program.AddQuadraticErrorCost(posture, data.home, now).evaluator().set_description(f"posture {k}")
        program.AddBoundingBoxConstraint(low, high, now)
        stage = (R_ref[[k, k]], p_ref[[k, k]], p_WO[[k, k]], radius)
        terms = _terms(data, last)
        for name, term in terms.items():
            cost = program.AddCost(partial(_cost, term, *stage), vars=now)
            cost.evaluator().set_description(f"{name} {k}")
    if data.rows_on and len(radius) and len(data.link_C):
        count = N * len(data.link_C) * len(radius)
        program.AddConstraint(
            partial(_distances, data, q0, R_ref, p_ref, p_WO, radius),
            lb=np.zeros(count),
            ub=np.full(count, np.inf),
            vars=q.ravel(),
        ).evaluator().set_description("distances")
    if len(data.base):
        slip = program.AddConstraint(partial(_slip, data, q0), lb=np.zeros(N), ub=np.zeros(N), vars=q.ravel())
        slip.evaluator().set_description("slip")
    return NmpcProgram(program, q, np.array(q0))


def solve_program(build: NmpcProgram, guess: Array, solver: str = "snopt") -> tuple[Array, bool]:
    """Return the solution (N, n) by "snopt" or "ipopt" from a guess (N, n), and whether the solver says it is one."""
    options = SolverOptions()
    chosen = SnoptSolver() if solver == "snopt" else IpoptSolver()
    if solver == "snopt":
        options.SetOption(chosen.id(), "Major optimality tolerance", 1e-8)
        options.SetOption(chosen.id(), "Major feasibility tolerance", 1e-9)
        options.SetOption(chosen.id(), "Major iterations limit", 1000)
    else:
        options.SetOption(chosen.id(), "tol", 1e-9)
        options.SetOption(chosen.id(), "max_iter", 1000)
    build.program.SetInitialGuess(build.q, guess)
    result = chosen.Solve(build.program, None, options)
    return result.GetSolution(build.q.ravel()).reshape(build.q.shape), bool(result.is_success())


def _terms(data: HorizonData, last: bool) -> dict[str, HorizonData]:
    """Return the problem of one stage with the pose error alone, and with the obstacles alone."""
    n = len(data.Q_v)
    only = data._replace(
        Q_v=np.zeros(n), R_q=np.zeros(n), R_e=data.R_e if last else data.Q_e, r_O=data.r_O if last else 1.0, base=NONE
    )
    terms = {"pose": only._replace(cost_on=False)}
    if data.cost_on:
        terms["obstacles"] = only._replace(R_e=np.zeros(6))
    return terms


NONE = np.zeros(0, dtype=np.int64)


def _cost(data: HorizonData, R_ref: Array, p_ref: Array, p_WO: Array, radius: Array, q: NDArray) -> object:
    x = _values(q)
    f, g, *_ = evaluate(data, x, x[None], R_ref, p_ref, p_WO, radius, no_multipliers(), False, True)
    return _with_gradient(q, np.array([f]), g)[0]


def _distances(
    data: HorizonData, q0: Array, R_ref: Array, p_ref: Array, p_WO: Array, radius: Array, q: NDArray
) -> NDArray:
    n = len(q0)
    Q = _values(q).reshape(-1, n)
    *_, P, J = evaluate(data._replace(cost_on=False), q0, Q, R_ref, p_ref, p_WO, radius, no_multipliers(), False, True)
    rows = distance_rows(data, q0, Q, P, J, p_WO, radius, np.inf, True)
    return _with_gradient(q, rows.z, _spread(rows.stage, rows.a, rows.b, Q.size))


def _slip(data: HorizonData, q0: Array, q: NDArray) -> NDArray:
    Q = _values(q).reshape(-1, len(q0))
    rows = slip_rows(data, q0, Q)
    return _with_gradient(q, rows.z, _spread(rows.stage, rows.a, rows.b, Q.size))


def _spread(stage: NDArray[np.int64], a: Array, b: Array, size: int) -> Array:
    """Return dense gradients (rows, N n) of rows that know their stage and the one before."""
    n = a.shape[1]
    G = np.zeros((len(stage), size))
    for row, k in enumerate(stage):
        G[row, (k - 1) * n : k * n] = b[row]
        if k > 1:
            G[row, (k - 2) * n : (k - 1) * n] = a[row]
    return G


def _values(q: NDArray) -> Array:
    return ExtractValue(q).ravel() if q.dtype == object else np.array(q, dtype=float)


def _with_gradient(q: NDArray, value: Array, G: Array) -> NDArray:
    """Return `value` as it is, or as AutoDiffXd by the chain rule with its gradient `G` in q."""
    if q.dtype != object:
        return value
    D = G @ ExtractGradient(q)
    return np.array([AutoDiffXd(v, d) for v, d in zip(value, D)])
