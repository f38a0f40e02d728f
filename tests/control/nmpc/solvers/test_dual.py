"""Both solvers of a horizon's quadratic programs against Clarabel on random ones, and what they say where they fail."""

import numpy as np
import pytest
from pydrake.solvers import ClarabelSolver, MathematicalProgram, SolverOptions

from saphari_drake.control.nmpc.solvers.dense import solve_dense
from saphari_drake.control.nmpc.solvers.dual import solve_qp
from saphari_drake.control.nmpc.solvers.subproblem import (
    QpStatus,
    Rows,
    Subproblem,
    factorize,
    factorize_shifted,
    spread,
)

NOTHING = np.zeros(0, np.int64)


def from_nothing(qp, **options):
    """Solve with the active set from no guess."""
    return solve_qp(qp, NOTHING, **options)


BOTH = pytest.mark.parametrize("solver", [from_nothing, solve_dense])


def random_qp(rng, N, n, m, equalities, price=1e4):
    """Return a random feasible subproblem."""
    off = rng.uniform(1.0, 10.0, n)
    H = np.empty((N, n, n))
    for k in range(N):
        A = rng.normal(size=(n, n))
        H[k] = 0.3 * A @ A.T + np.diag(off) * (2.0 if k < N - 1 else 1.0)
    before = H.copy()
    L, B, definite = factorize_shifted(H, off)
    assert definite
    np.testing.assert_array_equal(H, before)

    def rows(count, stage):
        a = rng.normal(size=(count, n))
        a[stage == 1] = 0.0
        z = rng.uniform(-0.5, 1.0, count)
        none = np.zeros(count, np.int64)
        return Rows(stage.astype(np.int64), none, none, z, a, rng.normal(size=(count, n)))

    free = np.full((N, n), np.inf)
    low, high = -rng.uniform(0, 3, (N, n)), rng.uniform(0, 3, (N, n))
    low[:, :1], high[:, :1] = -np.inf, np.inf
    distance, slip = rows(m, rng.integers(1, N + 1, m)), rows(equalities, np.arange(1, equalities + 1))
    slip = slip._replace(z=0.1 * slip.z)
    v = -rng.uniform(0, 1, (N, n)), rng.uniform(0, 1, (N, n))
    turn = (-rng.uniform(0, 1, (N, n)), rng.uniform(0, 1, (N, n))) if rng.random() < 0.5 else (-free, free)
    g = 20.0 * rng.normal(size=(N, n))
    return Subproblem(g, H, off, L, B, True, low, high, *v, *turn, distance, slip, price)


def full_hessian(qp):
    """Return H as one matrix."""
    N, n = qp.g.shape
    full = np.zeros((N * n, N * n))
    for k in range(N):
        here, before = slice(k * n, k * n + n), slice(k * n - n, k * n)
        full[here, here] = qp.H[k]
        if k > 0:
            full[here, before] = full[before, here] = -np.diag(qp.off)
    return full


def reference(qp):
    """Return δ and the slacks by Clarabel, with a variable for each."""
    N, n = qp.g.shape
    program = MathematicalProgram()
    x, s = program.NewContinuousVariables(N * n), program.NewContinuousVariables(len(qp.rows.z))
    program.AddQuadraticCost(full_hessian(qp), qp.g.ravel(), x, is_convex=True)
    if len(s):
        program.AddQuadraticCost(qp.price * np.eye(len(s)), np.full(len(s), qp.price), s, is_convex=True)
        program.AddBoundingBoxConstraint(0.0, np.inf, s)
        A, infinity = np.hstack([spread(qp.rows, N), np.eye(len(s))]), np.full(len(s), np.inf)
        program.AddLinearConstraint(A, -qp.rows.z, infinity, np.concatenate([x, s]))
    if len(qp.slip.z):
        program.AddLinearEqualityConstraint(spread(qp.slip, N), -qp.slip.z, x)
    program.AddBoundingBoxConstraint(qp.low.ravel(), qp.high.ravel(), x)
    for k, (low, high) in enumerate(zip(qp.v_low, qp.v_high)):
        D = np.hstack([np.eye(n), -np.eye(n)]) if k else np.eye(n)
        program.AddLinearConstraint(D, low, high, np.concatenate([x[k * n : k * n + n], x[max(k - 1, 0) * n : k * n]]))
    if np.isfinite(qp.a_high).all():
        D = np.eye(N * n) - np.eye(N * n, k=-n)
        program.AddLinearConstraint(D @ D, qp.a_low.ravel(), qp.a_high.ravel(), x)
    options = SolverOptions()
    for key in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
        options.SetOption(ClarabelSolver.id(), key, 1e-11)
    result = ClarabelSolver().Solve(program, None, options)
    assert result.is_success()
    return result.GetSolution(x).reshape(N, n), result.GetSolution(s)


@BOTH
@pytest.mark.parametrize("size", [(10, 10, 70, 10), (4, 3, 8, 0), (1, 5, 3, 0), (6, 4, 0, 6)])
@pytest.mark.parametrize("price", [1e4, 5.0])
def test_solution_is_clarabels(solver, size, price):
    """With velocity and position limits, equalities and slacks that are and are not needed."""
    rng = np.random.default_rng([size[0], size[2]])
    slacks = 0.0
    for _ in range(4):
        qp = random_qp(rng, *size, price)
        found, (expected, slack_expected) = solver(qp), reference(qp)
        assert found.status == QpStatus.SOLVED
        np.testing.assert_allclose(found.delta, expected, atol=1e-6)
        np.testing.assert_allclose(found.slack, slack_expected, atol=1e-6)
        assert np.all(found.multipliers >= 0.0) and found.largest >= found.multipliers.max(initial=0.0)
        np.testing.assert_allclose(found.slack, np.maximum(found.multipliers / price - 1.0, 0.0), atol=1e-9)
        slacks = max(slacks, found.slack.max(initial=0.0))
    assert slacks > 0.0 or price > 5.0 or size[2] == 0


def test_any_guess_leads_to_the_solution():
    """Limits that are active there, and limits that are not."""
    rng = np.random.default_rng(5)
    for price in (1e4, 5.0):
        qp = random_qp(rng, 10, 10, 70, 10, price)
        found = from_nothing(qp)
        for guess in (found.active, rng.integers(0, 6 * qp.g.size, 10)):
            again = solve_qp(qp, guess)
            assert again.status == QpStatus.SOLVED
            np.testing.assert_allclose(again.delta, found.delta, atol=1e-8)


@BOTH
@pytest.mark.parametrize("equalities", [0, 4])
def test_a_problem_without_solution_is_infeasible(solver, equalities):
    """Position limits out of reach of the velocity limits; and an equality that the limits exclude."""
    qp = random_qp(np.random.default_rng(1), 4, 3, 8, equalities)
    if equalities:
        qp = qp._replace(slip=qp.slip._replace(z=qp.slip.z + 1e3))
    else:
        qp = qp._replace(low=qp.low + 50.0, high=qp.high + 50.0)
    assert solver(qp).status == QpStatus.INFEASIBLE


def test_equalities_that_contradict_each_other_are_infeasible():
    qp = random_qp(np.random.default_rng(1), 4, 3, 8, 4)
    slip = qp.slip._replace(stage=np.full(4, 2), a=np.tile(qp.slip.a[1], (4, 1)), b=np.tile(qp.slip.b[1], (4, 1)))
    for solver in (from_nothing, solve_dense):
        assert solver(qp._replace(slip=slip)).status == QpStatus.INFEASIBLE


@BOTH
def test_a_matrix_that_is_not_definite_is_told(solver):
    """H with a negative eigenvalue, and numbers that are not finite."""
    qp = random_qp(np.random.default_rng(1), 4, 3, 8, 0)
    H = qp.H.copy()
    H[2, 1, 1] -= 1e14
    L, B, definite = factorize_shifted(H.copy(), qp.off)
    assert not definite
    assert solver(qp._replace(H=H, L=L, B=B, definite=definite)).status == QpStatus.INDEFINITE
    g = qp.g.copy()
    g[1, 1] = np.nan
    assert solver(qp._replace(g=g)).status == QpStatus.INDEFINITE


@BOTH
def test_passes_that_do_not_suffice_are_told(solver):
    qp = random_qp(np.random.default_rng(1), 10, 10, 70, 10)
    assert solver(qp, passes=0).status == QpStatus.EXHAUSTED
    assert solver(qp).status == QpStatus.SOLVED


def test_factor_is_that_of_the_block_tridiagonal_matrix():
    """L Lᵀ = H; an indefinite H is refused, or made definite on its diagonal."""
    qp = random_qp(np.random.default_rng(0), 5, 4, 0, 0)
    N, n = qp.g.shape

    def full(L, B):
        factor = np.zeros((N * n, N * n))
        for k in range(N):
            here, before = slice(k * n, k * n + n), slice(k * n - n, k * n)
            factor[here, here] = L[k]
            if k > 0:
                factor[here, before] = B[k]
        return factor @ factor.T

    np.testing.assert_allclose(full(qp.L, qp.B), full_hessian(qp), atol=1e-12)
    H = qp.H.copy()
    H[2, 1, 1] -= 100.0
    assert not factorize(H, qp.off, qp.L.copy(), qp.B.copy())
    shifted = H.copy()
    L, B, definite = factorize_shifted(shifted, qp.off)
    assert definite
    np.testing.assert_allclose(full(L, B), full_hessian(qp._replace(H=shifted)), atol=1e-9)
    added = shifted - H
    np.testing.assert_allclose(added, np.einsum("kii,ij->kij", added, np.eye(n)))
    assert added.max() > 0.0
