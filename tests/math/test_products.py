"""The compiled products and factors equal numpy's, failures are told, and no kernel calls BLAS or LAPACK."""

import ast
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import saphari_drake
from saphari_drake.math import products
from saphari_drake.math.products import (
    apply,
    bounded_multipliers,
    cholesky,
    product,
    solve_lower,
    solve_upper,
    symmetric_eigen,
)


@pytest.mark.parametrize("shape", [(3, 3, 3), (3, 7, 3), (7, 2, 5), (1, 4, 1)])
def test_products_equal_numpys(shape):
    """A B and A x."""
    rng = np.random.default_rng(sum(shape))
    n, k, m = shape
    A, B, x = rng.normal(size=(n, k)), rng.normal(size=(k, m)), rng.normal(size=k)
    np.testing.assert_allclose(product(A, B), A @ B, atol=1e-14)
    np.testing.assert_allclose(product(B.T, A.T), (A @ B).T, atol=1e-14)
    np.testing.assert_allclose(apply(A, x), A @ x, atol=1e-14)


@pytest.mark.parametrize("values", [[1.0, 2.0, 3.0], [0.0, 0.0, 1.0], [2.0, 2.0, 2.0], [-1.0, 1e-9, 5.0], [0.0] * 3])
def test_symmetric_eigen_diagonalizes(values):
    """A U = U diag(λ) with orthonormal U and ascending λ, repeated and zero ones included."""
    for seed in range(10):
        Q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
        A = Q @ np.diag(values) @ Q.T
        A = (A + A.T) / 2
        found, U = symmetric_eigen(A)
        np.testing.assert_allclose(found, np.sort(values), atol=1e-13)
        np.testing.assert_allclose(U.T @ U, np.eye(3), atol=1e-13)
        np.testing.assert_allclose(A @ U, U * found, atol=1e-13)


def test_cholesky_solves_and_refuses_what_is_not_definite():
    """L Lᵀ = A and A⁻¹b; for an indefinite, singular or NaN matrix False, and NaN for a result."""
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(4, 4)), rng.normal(size=4)
    A = A @ A.T + np.eye(4)
    L, x = np.zeros((4, 4)), b.copy()
    assert cholesky(A, L)
    np.testing.assert_allclose(L @ L.T, A, atol=1e-13)
    solve_lower(L, x, 4)
    solve_upper(L, x, 4)
    np.testing.assert_allclose(A @ x, b, atol=1e-12)
    row = np.ones((1, 4))
    for bad in (A - 30.0 * np.eye(4), row.T @ row, np.where(np.eye(4) > 0, np.nan, A)):
        x = b.copy()
        assert not cholesky(bad, L)
        solve_lower(L, x, 4)
        assert np.all(np.isnan(x))


@given(seed=st.integers(0, 10_000), count=st.integers(1, 12))
def test_the_multipliers_solve_their_problem(seed, count):
    """μ ≥ 0, H μ ≥ e, and one of the two with equality; rows may depend on one another."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((count, 5))
    H = A @ A.T + 1e-6 * np.eye(count)
    e = rng.standard_normal(count)
    mu = bounded_multipliers(H, e)
    slack = H @ mu - e
    assert np.all(mu >= 0.0)
    assert np.all(slack >= -1e-8)
    assert np.abs(mu * slack).max() < 1e-5 * (1 + np.abs(mu).max())


@pytest.mark.parametrize("H", [-np.eye(3), np.diag([1.0, 1.0, -1.0]), np.full((3, 3), np.nan)])
def test_multipliers_of_an_indefinite_problem_are_nan(H):
    assert np.all(np.isnan(bounded_multipliers(H, np.ones(3))))


def test_multipliers_that_are_not_found_in_time_are_nan(monkeypatch):
    """Three rows become active one after the other: more passes than are allowed here."""
    assert np.all(bounded_multipliers.py_func(np.eye(3), np.ones(3)) == 1.0)
    monkeypatch.setattr(products, "_MAX_PASSES", 3)
    assert np.all(np.isnan(bounded_multipliers.py_func(np.eye(3), np.ones(3))))


def test_no_kernel_needs_scipy():
    """A compiled function with ``@``, ``dot`` or ``linalg`` would fail where SciPy is not installed."""
    found = []
    for path in Path(saphari_drake.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(d) for d in node.decorator_list):
                for part in ast.walk(node):
                    matmul = isinstance(part, ast.BinOp) and isinstance(part.op, ast.MatMult)
                    call = isinstance(part, ast.Attribute) and ast.unparse(part) in ("np.dot", "np.linalg", "np.vdot")
                    if matmul or call:
                        found.append(f"{path.name}:{part.lineno}")
    assert found == []
