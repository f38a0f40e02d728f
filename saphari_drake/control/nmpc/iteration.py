"""The pieces of a sequential quadratic program over a horizon: linearization, factorization, merit and line search."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.control.nmpc.horizon import Multipliers, evaluate, no_multipliers
from saphari_drake.control.nmpc.qp import solve_qp
from saphari_drake.control.nmpc.rows import Rows, distance_rows, kept_distances, slip_rows, violation

# Shares of the velocity term's Hessian: the least pivot of a factorization, and what is added to an indefinite H first.
_LEAST_PIVOT, _FIRST_SHIFT, _SHIFT_FACTOR = 0.01, 0.02, 4.0
# Of the line search.
_ARMIJO = 1.0e-4
_SMALLEST_STEP = 1.0e-3


# rad or m; guesses of the largest entry of a step, see `nmpc_rows`.
FIRST_REACH, REACH_FACTOR, LEAST_REACH = 0.15, 2.0, 0.01


class Scene(NamedTuple):
    """What one control step is given."""

    q0: NDArray[np.float64]  # (n,)
    R_ref: NDArray[np.float64]  # (N + 1, 3, 3)
    p_ref: NDArray[np.float64]  # (N + 1, 3)
    p_WO: NDArray[np.float64]  # (N + 1, m, 3)
    radius: NDArray[np.float64]  # (m,)


class Subproblem(NamedTuple):
    """The quadratic program at one iterate: minimize gᵀδ + ½ δᵀHδ within bounds and rows.

    H has the diagonal blocks L L_kᵀ + L_{k,k−1} L_{k,k−1}ᵀ of its factor and −2Q_v/T_s² beside them.
    """

    f: float
    g: NDArray[np.float64]  # (N, n)
    H: NDArray[np.float64]  # (N, n, n), diagonal blocks, made positive definite
    L: NDArray[np.float64]  # (N, n, n), lower triangular
    B: NDArray[np.float64]  # (N, n, n), L_{k,k−1}; the first is zero
    low: NDArray[np.float64]  # (N, n), bounds of δ
    high: NDArray[np.float64]
    v_low: NDArray[np.float64]  # (N, n), bounds of δ_k − δ_{k−1}
    v_high: NDArray[np.float64]
    rows: Rows
    slip: Rows
    excess: float  # Σ max(0, −z) over all rows, and Σ |slip|
    kept: NDArray[np.float64]  # (N + 1, points), distances that the rows keep


@njit(cache=True)
def factorize(H, off, L, B):
    """Factorize the block tridiagonal H: diagonal blocks, and −diag(off) beside them; False if it is not definite."""
    N, n = H.shape[0], H.shape[1]
    for k in range(N):
        A = L[k]
        for i in range(n):
            for j in range(i + 1):
                A[i, j] = H[k, i, j]
            for j in range(i + 1, n):
                A[i, j] = 0.0
        if k > 0:
            # B = −diag(off) L_{k−1}⁻ᵀ, whose row i starts at column i.
            before, C = L[k - 1], B[k]
            for i in range(n):
                for j in range(i):
                    C[i, j] = 0.0
                C[i, i] = -off[i] / before[i, i]
                for j in range(i + 1, n):
                    total = 0.0
                    for l in range(i, j):
                        total -= before[j, l] * C[i, l]
                    C[i, j] = total / before[j, j]
            for i in range(n):
                for j in range(i + 1):
                    total = 0.0
                    for l in range(i, n):
                        total += C[i, l] * C[j, l]
                    A[i, j] -= total
        for j in range(n):
            pivot = A[j, j]
            for l in range(j):
                pivot -= A[j, l] * A[j, l]
            if not pivot > _LEAST_PIVOT * off[j]:
                return False
            root = np.sqrt(pivot)
            A[j, j] = root
            for i in range(j + 1, n):
                total = A[i, j]
                for l in range(j):
                    total -= A[i, l] * A[j, l]
                A[i, j] = total / root
    return True


@njit(cache=True)
def linearize(data, scene, Q, multipliers, exact, step):
    """Return the `Subproblem` at iterate Q (N, n), with the rows that steps up to `step` can make active."""
    N, n = Q.shape
    f, g, H, P, J = evaluate(
        data, scene.q0, Q, scene.R_ref, scene.p_ref, scene.p_WO, scene.radius, multipliers, exact, True
    )
    L, B = np.empty((N, n, n)), np.zeros((N, n, n))
    off = 2.0 / data.period**2 * data.Q_v
    shift = _FIRST_SHIFT
    while not factorize(H, off, L, B):
        for k in range(N):
            for j in range(n):
                H[k, j, j] += shift * off[j]
        shift *= _SHIFT_FACTOR
        if shift > 1e12:
            break
    rows = distance_rows(data, scene.q0, Q, P, J, scene.p_WO, scene.radius, step, False)
    kept = kept_distances(data, scene.q0, Q, J)
    slip = slip_rows(data, scene.q0, Q)
    low, high = np.empty((N, n)), np.empty((N, n))
    v_low, v_high = np.empty((N, n)), np.empty((N, n))
    for k in range(N):
        for j in range(n):
            step = Q[k, j] - (Q[k - 1, j] if k > 0 else scene.q0[j])
            low[k, j] = min(data.q_min[j], scene.q0[j]) - Q[k, j]
            high[k, j] = max(data.q_max[j], scene.q0[j]) - Q[k, j]
            v_low[k, j] = -data.period * data.v_max[j] - step
            v_high[k, j] = data.period * data.v_max[j] - step
    excess = 0.0
    for z in rows.z:
        excess += max(0.0, -z)
    for z in slip.z:
        excess += abs(z)
    return Subproblem(f, g, H, L, B, low, high, v_low, v_high, rows, slip, excess, kept)


@njit(cache=True)
def merit(data, scene, Q, kept):
    """Return cost and constraint violation Σ max(0, −z) + Σ |slip| of an iterate, for distances to keep as given."""
    f, _, _, P, _ = evaluate(
        data, scene.q0, Q, scene.R_ref, scene.p_ref, scene.p_WO, scene.radius, no_multipliers(), False, False
    )
    excess = violation(data, P, kept, scene.p_WO, scene.radius)
    for z in slip_rows(data, scene.q0, Q).z:
        excess += abs(z)
    return f, excess


@njit(cache=True)
def search(data, scene, Q, qp, delta, penalty, left):
    """Return the iterate Q + α δ with the largest α = 1, ½, ¼ … that lowers cost + penalty·violation enough.

    `left` is the violation that the quadratic program could not remove.
    """
    slope = 0.0
    for k in range(Q.shape[0]):
        for j in range(Q.shape[1]):
            slope += qp.g[k, j] * delta[k, j]
    slope -= penalty * max(qp.excess - left, 0.0)
    start = qp.f + penalty * qp.excess
    alpha = 1.0
    while True:
        trial = Q + alpha * delta
        f, excess = merit(data, scene, trial, qp.kept)
        if f + penalty * excess <= start + _ARMIJO * alpha * min(slope, 0.0) + 1e-12 * abs(start):
            return trial, alpha
        alpha *= 0.5
        if alpha < _SMALLEST_STEP:
            return trial, alpha


@njit(cache=True)
def positive(rows, multipliers, swept):
    """Return the `Multipliers` > 0 of rows; not that of the swept first interval, which bends otherwise."""
    index, count = np.empty(multipliers.shape[0], np.int64), 0
    for r in range(multipliers.shape[0]):
        if multipliers[r] > 0.0 and not (swept and rows.stage[r] == 1):
            index[count] = r
            count += 1
    index = index[:count]
    return Multipliers(rows.stage[index], rows.point[index], rows.obstacle[index], multipliers[index])


@njit(cache=True)
def feasible_start(data, q0, Q):
    """Return Q (N, n) moved into velocity and position limits, stage by stage from q0."""
    out = np.empty_like(Q)
    before = q0
    for k in range(Q.shape[0]):
        for j in range(Q.shape[1]):
            reach = data.period * data.v_max[j]
            low = max(min(data.q_min[j], q0[j]), before[j] - reach)
            high = min(max(data.q_max[j], q0[j]), before[j] + reach)
            out[k, j] = min(max(Q[k, j], low), high)
        before = out[k]
    return out


@njit(cache=True)
def slack_length(data, scene, rows, slack):
    """Return the largest slack (m²) of the distance rows as the length (m) by which a distance falls short."""
    longest = 0.0
    for r in range(slack.shape[0]):
        d = data.d_min[rows.point[r]] + scene.radius[rows.obstacle[r]]
        longest = max(longest, d - np.sqrt(max(d * d - slack[r], 0.0)))
    return longest


@njit(cache=True)
def solve_sqp(data, scene, guess, iterations, tolerance, price, exact):
    """Run the SQP with the active-set solver.

    Parameters
    ----------
    data : HorizonData
    scene : Scene
    guess : (N, n) array
    iterations : int
        Most QPs to solve.
    tolerance : float
        Largest entry of the last step (rad or m).
    price : float
        Of 1 m² of slack.
    exact : bool
        Exact Hessian of the Lagrangian.

    Returns
    -------
    Q : (N, n) array
    count : int
        QPs solved.
    converged, ok : bool
        `ok` is False if a QP had no solution.
    slack : float
        Of the last QP (m).
    """
    Q = feasible_start(data, scene.q0, guess)
    multipliers = no_multipliers()
    active = np.zeros(0, np.int64)
    penalty, slack, reach = 0.0, 0.0, FIRST_REACH
    for count in range(1, iterations + 1):
        qp = linearize(data, scene, Q, multipliers, exact, reach)
        delta, lam, slacks, largest, ok, active_rows, _ = solve_qp(qp, price, active)
        step = np.max(np.abs(delta))
        if step > reach:
            qp = linearize(data, scene, Q, multipliers, exact, np.inf)
            delta, lam, slacks, largest, ok, active_rows, _ = solve_qp(qp, price, active)
            step = np.max(np.abs(delta))
        if not ok:
            return Q, count, False, False, slack
        slack = slack_length(data, scene, qp.rows, slacks)
        if step <= tolerance:
            return Q + delta, count, True, True, slack
        penalty = max(penalty, min(2.0 * largest, price))
        Q, _ = search(data, scene, Q, qp, delta, penalty, np.sum(slacks))
        multipliers = positive(qp.rows, lam, data.swept)
        active = hard_limits(active_rows, 4 * Q.size)
        reach = max(REACH_FACTOR * step, LEAST_REACH)
    return Q, iterations, False, True, slack


@njit(cache=True)
def hard_limits(active, first_row):
    """Return the active constraints that are limits; the others have other indices at the next iterate."""
    out, count = np.empty_like(active), 0
    for index in active:
        if index < first_row:
            out[count] = index
            count += 1
    return out[:count]
