"""Products and eigenvectors of small matrices for compiled kernels.

numba's own ``@``, ``dot`` and ``linalg`` call BLAS and LAPACK through SciPy, which nothing else here needs, and are
slower at these sizes.
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit


@njit(cache=True)
def product(A, B):
    """Return A B of matrices (n, k) and (k, m)."""
    n, k, m = A.shape[0], A.shape[1], B.shape[1]
    C = np.empty((n, m))
    for i in range(n):
        for j in range(m):
            total = 0.0
            for l in range(k):
                total += A[i, l] * B[l, j]
            C[i, j] = total
    return C


@njit(cache=True)
def apply(A, x):
    """Return A x of a matrix (n, k) and a vector (k,)."""
    y = np.empty(A.shape[0])
    for i in range(A.shape[0]):
        total = 0.0
        for l in range(A.shape[1]):
            total += A[i, l] * x[l]
        y[i] = total
    return y


@njit(cache=True)
def symmetric_eigen(A):
    """Return eigenvalues (n,), ascending, and eigenvectors as columns (n, n), of a symmetric matrix (Jacobi)."""
    n = A.shape[0]
    D, U = A.copy(), np.eye(n)
    for _ in range(50):
        off, size = 0.0, 0.0
        for i in range(n):
            size += D[i, i] * D[i, i]
            for j in range(i):
                off += D[i, j] * D[i, j]
        if off <= 1e-30 * (size + off):
            break
        for i in range(n):
            for j in range(i):
                if D[i, j] == 0.0:
                    continue
                theta = 0.5 * (D[i, i] - D[j, j]) / D[i, j]
                t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(n):
                    a, b = D[k, i], D[k, j]
                    D[k, i], D[k, j] = c * a + s * b, c * b - s * a
                for k in range(n):
                    a, b = D[i, k], D[j, k]
                    D[i, k], D[j, k] = c * a + s * b, c * b - s * a
                for k in range(n):
                    a, b = U[k, i], U[k, j]
                    U[k, i], U[k, j] = c * a + s * b, c * b - s * a
    values = np.empty(n)
    for i in range(n):
        values[i] = D[i, i]
    order = np.argsort(values)
    vectors = np.empty((n, n))
    for i in range(n):
        for k in range(n):
            vectors[k, i] = U[k, order[i]]
    return values[order], vectors
