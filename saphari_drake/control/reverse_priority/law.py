"""The law of Section 4, compiled: one pass through a stack of tasks and unilateral constraints, in reverse priority.

From the lowest level up, each adds a step δ to the joint velocity of the levels below it, measured with their weight
W = λ_s² I + Σ h_i J_iᵀJ_i. A task that asks for the velocities ẋ adds (24) in its regularised form ::

    δ = W⁻¹Jᵀ(J W⁻¹Jᵀ + D)⁻¹(ẋ − J q̇),   D = μ (λ_s² (J Jᵀ + λ_s² I)⁻¹)²,

which tends to the exact step T (J T)^#(ẋ − J q̇) of (24) to (26) as λ_s → 0, is continuous in the activations h_i, which
stacking and unstacking rows is not, and stays bounded at singular postures. D is μ for singular values of J well below
λ_s and falls as (λ_s/σ)⁴ above; D = μI would let a task share with active rows below it, 1 to μ, whatever λ_s is.

A level of unilateral constraints x_i ≤ x̄_i adds ::

    δ = −W⁻¹Jᵀμ,   μ ≥ 0,   (J W⁻¹Jᵀ + diag r) μ = e  where μ > 0,   J W⁻¹Jᵀ μ ≥ e  where μ = 0,

with the excess e = ẋ_d − ẋ* of the nominal velocity (30) over the one allowed at the bound, and the softness
r_i = s_i (1 − h_i)/h_i, s_i = J_iW⁻¹J_iᵀ. For one constraint that is (32): its velocity becomes (1 − h) ẋ_d + h ẋ*, if
that is slower. For several, they hold together at h = 1, each enters and leaves continuously with its h, and one that
the others push is found as well: (32), applied one after the other, lets the later undo the earlier.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.curves import quintic
from saphari_drake.math.products import apply, bounded_multipliers, cholesky, product, solve_lower, solve_upper

Array = NDArray[np.float64]
_SOFTNESS = 1e-7  # softness of a fully active row, relative to s_i: keeps dependent rows solvable


class PriorityStatus(IntEnum):
    """What became of the tasks and constraints, also published as a number."""

    OK = 0  # as asked
    SCALED = 1  # the velocity limits scale what the tasks ask for
    LIMITED = 2  # the constraints on top alone need more than the velocity limits allow
    INFEASIBLE = 3  # constraints on top, at or beyond their bounds, contradict one another
    INVALID = 4  # an input is not finite, or there is no solution that is: no motion
    LATE = 5  # the acceleration limits hold back what is needed: on the way there


class Rows(NamedTuple):
    """Scalar rows at one state, from the highest level to the lowest: those of tasks, and constraints x ≤ x̄."""

    J: Array  # (r, n) ẋ = J q̇ + ẋ_own
    x: Array  # (r,) value
    own: Array  # (r,) ẋ_own, the velocity that the joints do not make
    goal: Array  # (r,) desired value, or x̄; infinite where a constraint is off
    wanted: Array  # (r,) ẋ with the error fed back, or ẋ*, see `allowed_rate`
    buffer: Array  # (r,) β_p and β_v of constraints, see `activation`
    velocity_buffer: Array


class Levels(NamedTuple):
    """How rows make levels, from the top."""

    is_task: NDArray[np.bool_]  # (L,)
    ends: NDArray[np.int64]  # (L,) number of rows up to the end of each
    top: int  # the first that is a task; L if there is none


class Settings(NamedTuple):
    """Constants of the law."""

    v_max: Array  # (n,) velocity limits
    period: float  # s, control cycle
    damping: float  # λ_s, in the unit of J
    task_damping: float  # μ


@njit(cache=True)
def activation(x, bound, buffer):
    """Return s((x − x̄ + β)/β) with the quintic s: 0 up to the buffer β, 1 from the bound x̄ on.

    The rule (31) is a step in position and one in velocity. Here h = h_pos h_vel with h_pos = `activation` of x, x̄, β_p
    and h_vel of ẋ_d, 0, β_v, which has two continuous derivatives. The buffers lie where (31) says 0, so that h is 1
    wherever (31) is.
    """
    return quintic((x - bound + buffer) / buffer)[0]


@njit(cache=True)
def _whitened(L, J):
    """Return Y = (L⁻¹Jᵀ)ᵀ, one row for each row of J, so that J W⁻¹Jᵀ = Y Yᵀ."""
    Y = J.copy()
    for i in range(J.shape[0]):
        solve_lower(L, Y[i], J.shape[1])
    return Y


@njit(cache=True)
def task_step(L, J, missing, settings, v):
    """Add the step of a task to v, of which `missing` = ẋ − J v (m,); L is the Cholesky factor of W."""
    m, n = J.shape
    square = settings.damping * settings.damping
    K, B = np.zeros((m, m)), square * np.eye(m)
    cholesky(product(J, J.T) + B, K)
    for i in range(m):
        solve_lower(K, B[i], m)
        solve_upper(K, B[i], m)
    Y = _whitened(L, J)
    cholesky(product(Y, Y.T) + settings.task_damping * product(B, B), K)
    step = missing.copy()
    solve_lower(K, step, m)
    solve_upper(K, step, m)
    step = apply(Y.T, step)
    solve_upper(L, step, n)
    v += step


@njit(cache=True)
def allowed_rate(J_row, excess, own, gain, v_max):
    """Return ẋ* of a constraint: 0, or with `excess` = x − x̄ > 0 that of the way back.

    The way back is exponential with its gain, and never faster than the velocity limits can make it.
    """
    return max(-gain * max(excess, 0.0), own - np.sum(np.abs(J_row) * v_max))


@njit(cache=True)
def constraint_step(L, rows, settings, v, h):
    """Add the step of a level of constraints to v, write h (m,); L is the Cholesky factor of W.

    A row that would cover more than half the distance that is left within one period is active at least as far as
    that needs, however narrow its buffer.
    """
    m, n = rows.J.shape
    near, softness, excess = np.empty(m, dtype=np.int64), np.empty(m), np.empty(m)
    count = 0
    for i in range(m):
        rate = rows.own[i]
        for j in range(n):
            rate += rows.J[i, j] * v[j]
        h_pos = activation(rows.x[i], rows.goal[i], rows.buffer[i])
        gap, way = rows.goal[i] - rows.x[i], rate * settings.period
        if gap > 0.0 and way > 0.5 * gap:
            h_pos = max(h_pos, 1.0 - 0.5 * gap / way)
        h[i] = h_pos * activation(rate - rows.wanted[i], 0.0, rows.velocity_buffer[i])
        if h_pos > 1e-12:
            near[count], softness[count], excess[count] = i, (1.0 - h_pos) / h_pos + _SOFTNESS, rate - rows.wanted[i]
            count += 1
    if count == 0 or excess[:count].max() <= 0.0:
        return
    Y = _whitened(L, rows.J[near[:count]])
    H = product(Y, Y.T)
    for a in range(count):
        H[a, a] += H[a, a] * softness[a] + 1e-9
    step = apply(Y.T, bounded_multipliers(H, excess[:count]))
    solve_upper(L, step, n)
    v -= step


@njit(cache=True)
def _between(rows, a, b):
    return Rows(
        rows.J[a:b], rows.x[a:b], rows.own[a:b], rows.goal[a:b], rows.wanted[a:b], rows.buffer[a:b],
        rows.velocity_buffer[a:b],
    )  # fmt: skip


@njit(cache=True)
def add_levels(levels, first, last, rows, settings, W, v, h):
    """Add the steps of the levels before `last` up to `first` to v, their active rows to W, and write h."""
    L = np.zeros(W.shape)
    for p in range(last - 1, first - 1, -1):
        a, b = levels.ends[p - 1] if p > 0 else 0, levels.ends[p]
        level = _between(rows, a, b)
        cholesky(W, L)
        if levels.is_task[p]:
            task_step(L, level.J, level.wanted - level.own - apply(level.J, v), settings, v)
            h[a:b] = 1.0
        else:
            constraint_step(L, level, settings, v, h[a:b])
        for i in range(a, b):
            if h[i] > 0.0:
                for j in range(v.shape[0]):
                    for k in range(v.shape[0]):
                        W[j, k] += h[i] * rows.J[i, j] * rows.J[i, k]
