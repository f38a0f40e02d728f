"""The compiled products equal numpy's, and no kernel of the library calls BLAS or LAPACK."""

import ast
from pathlib import Path

import numpy as np
import pytest

import saphari_drake
from saphari_drake.math.products import apply, product, symmetric_eigen


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
