"""Limits of positions, velocities and changes of velocity over a horizon.

With `ramp`, a command goes linearly from the one before to its own over that share of a period, and |v_k − v_{k−1}| ≤
d = ramp T_s a_max. Such a motion is, but for the rounded corners, the polygon q_k → q_{k+1} passed half a ramp later.
So the problem stays as it is, in the positions half a ramp ahead: its start is q + ½ ramp T_s v_0, its obstacles and
its reference are those half a ramp from now. At the corners the joints cut off at most ramp T_s |v_k − v_{k−1}|/8.

Position limits yield to what braking as fast as d allows cannot prevent, so that these limits never contradict one
another.
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit


@njit(cache=True)
def reachable(data, q0, k):
    """Return lower and upper bounds (n,) of q_k that velocity and position limits leave when starting from `q0`.

    Where q0 is outside its limits already, it need not jump back.
    """
    low, high = np.empty_like(q0), np.empty_like(q0)
    for j in range(q0.shape[0]):
        reach = k * data.period * data.v_max[j]
        low[j] = max(min(data.q_min[j], q0[j]), q0[j] - reach)
        high[j] = min(max(data.q_max[j], q0[j]), q0[j] + reach)
    return low, high


@njit(cache=True)
def position_limits(data, q0, v0, N):
    """Return lower and upper bounds (N, n) of q_1 … q_N, wide enough for where the fullest braking leads."""
    n = q0.shape[0]
    low, high = np.empty((N, n)), np.empty((N, n))
    for j in range(n):
        q, v = q0[j], v0[j]
        for k in range(N):
            v = np.sign(v) * max(abs(v) - data.change[j], 0.0)
            q += data.period * v
            low[k, j] = min(data.q_min[j], q0[j], q)
            high[k, j] = max(data.q_max[j], q0[j], q)
    return low, high


@njit(cache=True)
def stoppable(room, change, period):
    """Return the largest v with which stages of v, v − d, v − 2d … together move no farther than `room` (≥ 0)."""
    if not (np.isfinite(change) and np.isfinite(room)):
        return room / period
    return max(min(room / period, change), change * (np.sqrt(2.0 * room / (change * period)) - 0.5))


@njit(cache=True)
def feasible_start(data, scene, Q):
    """Return Q (N, n) moved into all limits, stage by stage from q0."""
    out, before, v = np.empty_like(Q), scene.q0, scene.v0.copy()
    T = data.period
    for k in range(Q.shape[0]):
        for j in range(Q.shape[1]):
            q0, d = scene.q0[j], data.change[j]
            up = stoppable(max(max(data.q_max[j], q0) - before[j], 0.0), d, T)
            down = stoppable(max(before[j] - min(data.q_min[j], q0), 0.0), d, T)
            wish = min(max((Q[k, j] - before[j]) / T, -min(down, data.v_max[j])), min(up, data.v_max[j]))
            v[j] = min(max(wish, v[j] - d), v[j] + d)
            out[k, j] = before[j] + T * v[j]
        before = out[k]
    return out


@njit(cache=True)
def step_limits(data, scene, Q):
    """Return bounds that keep the limits from iterate Q on: lower and upper, each (N, n), of δ_k, of δ_k − δ_{k−1}, and
    of δ_k − 2δ_{k−1} + δ_{k−2}, with δ_0 = δ_{−1} = 0.
    """
    low, high = position_limits(data, scene.q0, scene.v0, Q.shape[0])
    v_low, v_high, a_low, a_high = np.empty_like(Q), np.empty_like(Q), np.empty_like(Q), np.empty_like(Q)
    for j in range(Q.shape[1]):
        reach, turn = data.period * data.v_max[j], data.period * data.change[j]
        before, step_before = scene.q0[j], data.period * scene.v0[j]
        for k in range(Q.shape[0]):
            step = Q[k, j] - before
            low[k, j] -= Q[k, j]
            high[k, j] -= Q[k, j]
            v_low[k, j], v_high[k, j] = -reach - step, reach - step
            a_low[k, j], a_high[k, j] = -turn - step + step_before, turn - step + step_before
            before, step_before = Q[k, j], step
    return low, high, v_low, v_high, a_low, a_high
