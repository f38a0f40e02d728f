"""The active-set solver against Clarabel on random quadratic programs of a horizon, and the stages' factorization."""

import numpy as np
import pytest
from pydrake.solvers import ClarabelSolver, MathematicalProgram, SolverOptions

from saphari_drake.control.nmpc.iteration import Subproblem, factorize
from saphari_drake.control.nmpc.qp import solve_qp
from saphari_drake.control.nmpc.qp_solvers import dense_qp
from saphari_drake.control.nmpc.rows import Rows

NOTHING = np.zeros(0, np.int64)


def random_qp(rng, N, n, m, equalities):
    """Return a random feasible subproblem and the weights beside its diagonal blocks."""
    off = rng.uniform(1.0, 10.0, n)
    H = np.empty((N, n, n))
    for k in range(N):
        A = rng.normal(size=(n, n))
        H[k] = 0.3 * A @ A.T + np.diag(off) * (2.0 if k < N - 1 else 1.0)
    L, B = np.empty((N, n, n)), np.zeros((N, n, n))
    assert factorize(H, off, L, B)

    def rows(count, stage):
        a = rng.normal(size=(count, n))
        a[stage == 1] = 0.0
        z = rng.uniform(-0.5, 1.0, count)
        none = np.zeros(count, np.int64)
        return Rows(stage.astype(np.int64), none, none, z, a, rng.normal(size=(count, n)))

    low, high = -rng.uniform(0, 3, (N, n)), rng.uniform(0, 3, (N, n))
    low[:, :1], high[:, :1] = -np.inf, np.inf
    distance, slip = rows(m, rng.integers(1, N + 1, m)), rows(equalities, np.arange(1, equalities + 1))
    slip = slip._replace(z=0.1 * slip.z)
    v = -rng.uniform(0, 1, (N, n)), rng.uniform(0, 1, (N, n))
    return Subproblem(
        0.0, 20.0 * rng.normal(size=(N, n)), H, L, B, low, high, *v, distance, slip, 0.0, np.zeros((N + 1, 0))
    ), off


def reference(qp, off, price):
    """Return δ and the slacks by Clarabel."""
    dense = dense_qp(qp, off, price)
    program = MathematicalProgram()
    x = program.NewContinuousVariables(len(dense.f))
    program.AddQuadraticCost(dense.H, dense.f, x, is_convex=True)
    program.AddBoundingBoxConstraint(dense.low, dense.high, x)
    program.AddLinearConstraint(dense.A, dense.lower, dense.upper, x)
    options = SolverOptions()
    for key in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
        options.SetOption(ClarabelSolver.id(), key, 1e-11)
    result = ClarabelSolver().Solve(program, None, options)
    assert result.is_success()
    return result.GetSolution(x)[: qp.g.size].reshape(qp.g.shape), result.GetSolution(x)[qp.g.size :]


@pytest.mark.parametrize("size", [(10, 10, 70, 10), (4, 3, 8, 0), (1, 5, 3, 0), (6, 4, 0, 6)])
@pytest.mark.parametrize("price", [1e4, 5.0])
def test_solution_is_clarabels(size, price):
    """With velocity and position limits, equalities and slacks that are and are not needed; from any guess."""
    rng = np.random.default_rng([size[0], size[2]])
    slacks = 0.0
    for _ in range(4):
        qp, off = random_qp(rng, *size)
        delta, multipliers, slack, _, ok, active, _ = solve_qp(qp, price, NOTHING)
        expected, slack_expected = reference(qp, off, price)
        assert ok
        np.testing.assert_allclose(delta, expected, atol=1e-6)
        np.testing.assert_allclose(slack, slack_expected, atol=1e-6)
        assert np.all(multipliers >= 0.0)
        np.testing.assert_allclose(slack, np.maximum(multipliers / price - 1.0, 0.0), atol=1e-12)
        limits = active[active < 4 * qp.g.size]
        wrong = rng.integers(0, 4 * qp.g.size, 10)
        for guess in (limits, wrong):
            again, *_, ok, _, _ = solve_qp(qp, price, guess)
            assert ok
            np.testing.assert_allclose(again, delta, atol=1e-8)
        slacks = max(slacks, slack.max(initial=0.0))
    assert (slacks > 0.0) == (price == 5.0 and size[2] > 0)


def test_factor_is_that_of_the_block_tridiagonal_matrix():
    """L Lᵀ = H; an indefinite H is refused."""
    qp, off = random_qp(np.random.default_rng(0), 5, 4, 0, 0)
    N, n = qp.g.shape
    full, factor = np.zeros((N * n, N * n)), np.zeros((N * n, N * n))
    for k in range(N):
        here = slice(k * n, k * n + n)
        full[here, here], factor[here, here] = qp.H[k], qp.L[k]
        if k > 0:
            before = slice(k * n - n, k * n)
            full[here, before] = full[before, here] = -np.diag(off)
            factor[here, before] = qp.B[k]
    np.testing.assert_allclose(factor @ factor.T, full, atol=1e-12)
    H = qp.H.copy()
    H[2, 1, 1] -= 100.0
    assert not factorize(H, off, qp.L.copy(), qp.B.copy())
