"""One compiled pass through a stack of tasks and unilateral constraints, in reverse priority.

Every level adds a step δ to the joint velocity of the levels below it, measured with their weight
W = λ_s² I + Σ h_i J_iᵀJ_i. A task adds the regularised step. A level of unilateral constraints x_i ≤ x̄_i adds ::

    δ = −W⁻¹Jᵀμ,   μ ≥ 0,   (J W⁻¹Jᵀ + diag r) μ = e  where μ > 0,   J W⁻¹Jᵀ μ ≥ e  where μ = 0,

with the excess e = ẋ_d − ẋ* of the nominal velocity (30) over the one allowed at the bound, and the softness
r_i = s_i (1 − h_i)/h_i, s_i = J_iW⁻¹J_iᵀ. For one constraint that is (32): its velocity becomes (1 − h) ẋ_d + h ẋ*, if
that is slower. For several, they hold together at h = 1, each enters and leaves continuously with its h, and one that
the others push is found as well: (32), applied one after the other, lets the later undo the earlier.
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.control.reverse_priority.activation import position_activation, velocity_activation
from saphari_drake.math.products import apply, bounded_multipliers, cholesky, product, solve_lower, solve_upper

TASK, CONSTRAINTS = 0, 1
OK, SCALED, LIMITED = 0, 1, 2

_SOFTNESS = 1e-7  # softness of a fully active row, relative to s_i: keeps dependent rows solvable
_SCALE_STEPS = 10


@njit(cache=True)
def whitened(L, J):
    """Return Y = (L⁻¹Jᵀ)ᵀ, one row for each row of J, so that J W⁻¹Jᵀ = Y Yᵀ."""
    Y = J.copy()
    for i in range(J.shape[0]):
        solve_lower(L, Y[i], J.shape[1])
    return Y


@njit(cache=True)
def task_step(L, J, b, lam_s, mu, v):
    """Add the step `recursion.regularised_step` of a task to v, L the Cholesky factor of W."""
    m, n = J.shape
    K = np.zeros((m, m))
    A = product(J, J.T)
    for i in range(m):
        A[i, i] += lam_s * lam_s
    cholesky(A, K)
    D = lam_s * lam_s * np.eye(m)
    for i in range(m):
        solve_lower(K, D[i], m)
        solve_upper(K, D[i], m)
    Y = whitened(L, J)
    G = product(Y, Y.T) + mu * product(D, D)
    cholesky(G, K)
    solve_lower(K, b, m)
    solve_upper(K, b, m)
    step = apply(Y.T, b)
    solve_upper(L, step, n)
    v += step


@njit(cache=True)
def allowed_rates(J, x, drift, bound, gain, v_max, out):
    """Write the velocities ẋ* allowed at the bound: 0, or beyond it that of the way back.

    The way back is exponential with its gain, and never faster than the velocity limits can make it.
    """
    for i in range(x.shape[0]):
        reach = 0.0
        for j in range(J.shape[1]):
            reach += abs(J[i, j]) * v_max[j]
        out[i] = max(-gain[i] * max(x[i] - bound[i], 0.0), drift[i] - reach)


@njit(cache=True)
def constraint_step(L, J, x, drift, bound, buffer_p, buffer_v, allowed, period, v, h):
    """Add the step of a level of constraints to v and write their activations h = h_pos h_vel into h.

    A row that would cover more than half the distance that is left within one period is active at least as far as
    that needs, however narrow its buffer.
    """
    m, n = J.shape
    rows = np.empty(m, dtype=np.int64)
    softness, excess = np.empty(m), np.empty(m)
    count = 0
    for i in range(m):
        rate = drift[i]
        for j in range(n):
            rate += J[i, j] * v[j]
        h_pos = position_activation(x[i], bound[i], buffer_p[i])
        gap = bound[i] - x[i]
        if gap > 0.0 and rate * period > 0.5 * gap:
            h_pos = max(h_pos, 1.0 - 0.5 * gap / (rate * period))
        h[i] = h_pos * velocity_activation(rate - allowed[i], buffer_v[i])
        if h_pos > 1e-12:
            rows[count], softness[count], excess[count] = i, (1.0 - h_pos) / h_pos + _SOFTNESS, rate - allowed[i]
            count += 1
    if count == 0:
        return
    some = False
    for a in range(count):
        some = some or excess[a] > 0.0
    if not some:
        return
    Y = np.empty((count, n))
    for a in range(count):
        Y[a] = J[rows[a]]
        solve_lower(L, Y[a], n)
    H = product(Y, Y.T)
    for a in range(count):
        H[a, a] += H[a, a] * softness[a] + 1e-9
    mu = bounded_multipliers(H, excess[:count])
    step = apply(Y.T, mu)
    solve_upper(L, step, n)
    v -= step


@njit(cache=True)
def largest_share(v, v_max):
    """Return the largest |v_j|/v_max_j."""
    share = 0.0
    for j in range(v.shape[0]):
        share = max(share, abs(v[j]) / v_max[j])
    return share


@njit(cache=True)
def solve_stack(
    kinds, ends_t, ends_c, JT, rates, JC, x, drift, bound, buffer_p, buffer_v, gain, v_start, v_max, period, lam_s, mu
):
    """Return the joint velocity of a stack, within the velocity limits.

    What the levels up to the highest task ask for is scaled as a whole until the result, with the constraints above
    them, keeps the velocity limits. Should the constraints on top alone ask for more, that is scaled instead (LIMITED):
    the arm then goes the right way, as fast as it can.

    Parameters
    ----------
    kinds, ends_t, ends_c : (L,) int arrays
        Of each level from the top: TASK or CONSTRAINTS; number of task rows, and of constraints, up to its end.
    JT, rates : (t, n), (t,) arrays
        Rows and desired velocities of all tasks.
    JC, x, drift, bound, buffer_p, buffer_v, gain : (c, n) and (c,) arrays
        Rows, values, velocities not made by the joints, upper bounds, buffers β_p and β_v, recovery gains (1/s).
    v_start : (n,) array
        Velocity below all levels, eq. (27).
    v_max : (n,) array
        Velocity limits.
    period, lam_s, mu : float
        Control cycle (s), λ_s and the damping μ of tasks.

    Returns
    -------
    v (n,), h (c,), scale, status
        Command, activations, factor on the tasks, and OK, SCALED or LIMITED.
    """
    n, levels = v_start.shape[0], kinds.shape[0]
    v = v_start.copy()
    h, allowed = np.zeros(x.shape[0]), np.empty(x.shape[0])
    allowed_rates(JC, x, drift, bound, gain, v_max, allowed)
    W, L = lam_s * lam_s * np.eye(n), np.zeros((n, n))
    highest_task = levels
    for p in range(levels - 1, -1, -1):
        if kinds[p] == TASK:
            highest_task = p
    for p in range(levels - 1, highest_task - 1, -1):
        cholesky(W, L)
        if kinds[p] == TASK:
            a, b = ends_t[p - 1] if p > 0 else 0, ends_t[p]
            J = JT[a:b]
            task_step(L, J, rates[a:b] - apply(J, v), lam_s, mu, v)
            W += product(J.T, J)
        else:
            a, b = ends_c[p - 1] if p > 0 else 0, ends_c[p]
            constraint_step(
                L,
                JC[a:b],
                x[a:b],
                drift[a:b],
                bound[a:b],
                buffer_p[a:b],
                buffer_v[a:b],
                allowed[a:b],
                period,
                v,
                h[a:b],
            )
            _add_active(W, JC[a:b], h[a:b])
    top = highest_task, ends_c, JC, x, drift, bound, buffer_p, buffer_v, allowed, period
    result = v.copy()
    _constrain(W, L, top, result, h)
    if largest_share(result, v_max) <= 1.0:
        return result, h, 1.0, OK
    result[:] = 0.0
    _constrain(W, L, top, result, h)
    share = largest_share(result, v_max)
    if share > 1.0:
        return result / share, h, 0.0, LIMITED
    low, high, trial = 0.0, 1.0, v.copy()
    for _ in range(_SCALE_STEPS):
        middle = 0.5 * (low + high)
        trial[:] = middle * v
        _constrain(W, L, top, trial, h)
        if largest_share(trial, v_max) <= 1.0:
            low = middle
            result[:] = trial
        else:
            high = middle
    return result, h, low, SCALED


@njit(cache=True)
def _constrain(W, L, top, v, h):
    """Put the levels of constraints above the highest task on v."""
    highest_task, ends_c, JC, x, drift, bound, buffer_p, buffer_v, allowed, period = top
    W = W.copy()
    for p in range(highest_task - 1, -1, -1):
        a, b = ends_c[p - 1] if p > 0 else 0, ends_c[p]
        cholesky(W, L)
        constraint_step(
            L, JC[a:b], x[a:b], drift[a:b], bound[a:b], buffer_p[a:b], buffer_v[a:b], allowed[a:b], period, v, h[a:b]
        )
        _add_active(W, JC[a:b], h[a:b])


@njit(cache=True)
def _add_active(W, J, h):
    """Add Σ h_i J_iᵀJ_i to W."""
    n = W.shape[0]
    for i in range(J.shape[0]):
        if h[i] > 0.0:
            for a in range(n):
                for b in range(n):
                    W[a, b] += h[i] * J[i, a] * J[i, b]
