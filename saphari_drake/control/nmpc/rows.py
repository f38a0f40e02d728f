"""Distance constraints (22) of a horizon that can become active, with their linearization.

Between two samples a point moves relative to an obstacle from a to b. On the chord the distance is smallest at
s* = −a·(b − a)/‖b − a‖², clipped to [0, 1], and the path of constant joint velocities leaves the chord by at most
e = max ‖p̈‖ T_s²/8 (the error of linear interpolation). In the first interval, the one that is executed, a is where the
robot is: with m = a + s*(b − a), z = ‖m‖² − (d_min + e)² ≥ 0 keeps the distance at or above d_min at every instant, for
obstacles of constant velocity, and dz = 2 s* m·db, as s* minimizes. In the later ones both ends vary, and s* would jump
between them: there z = ‖b‖² − ‖b − a‖²/4 − (d_min + e)², as a chord whose ends are at least √(d² + ‖b − a‖²/4) away
stays at least d away. Samples alone would let the distance fall to √(d_min² − (vT_s/2)²) on the way.

**Rows that are left out cannot become active.** All q within the velocity and position limits have
|q_k − q_0| ≤ k T_s v_max, so that a step δ that keeps them stays in the box [lo − q̄_k, hi − q̄_k]. There, and for
|δ| ≤ β, ‖J_ik δ_k‖ ≤ ρ_ik = Σ_j ‖J_ikj‖ min(β, max(|lo_j − q̄_kj|, |hi_j − q̄_kj|)), hence
z + dz ≥ z − ‖∂z/∂a‖ρ_i,k−1 − ‖∂z/∂b‖ρ_ik. Where that is positive, the row holds for every step up to β that the
limits allow. If the solution without it is such a step, it meets all rows, and no step that does is better: it is the
solution with them. The SQP guesses β from its last step, and solves again with β = ∞ if the solution turns out larger.
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.control.nmpc.horizon import CURVATURE_FACTOR, PAD, Rows


@njit(cache=True)
def reachable(data, q0, k):
    """Return lower and upper bounds (n,) of q_k that velocity and position limits leave when starting from `q0`.

    Where q0 is outside its limits already, it need not jump back.
    """
    reach = k * data.period * data.v_max
    low, high = np.empty_like(q0), np.empty_like(q0)
    for j in range(q0.shape[0]):
        low[j] = max(min(data.q_min[j], q0[j]), q0[j] - reach[j])
        high[j] = min(max(data.q_max[j], q0[j]), q0[j] + reach[j])
    return low, high


@njit(cache=True)
def sagitta(data, q_a, q_b, J, link):
    """Return how far (m) a point leaves the chord between q_a and q_b; J (n, 3) is its Jacobian at q_b.

    p̈ = Σ_ij (ω_i × J_j) q̇_i q̇_j over i ≤ j with i revolute, those with i < j twice. A platform that cannot
    slip goes along an arc instead of its chord, on top of that.
    """
    turning, total = 0.0, 0.0
    for a in range(data.depth[link]):
        j = data.chain[link, a]
        step = abs(q_b[j] - q_a[j])
        length = np.sqrt(J[j, 0] ** 2 + J[j, 1] ** 2 + J[j, 2] ** 2)
        total += length * step * (2.0 * turning + (step if data.revolute[j] else 0.0))
        if data.revolute[j]:
            turning += step
    if data.base.shape[0] == 3:
        x, y, t = data.base[0], data.base[1], data.base[2]
        total += np.hypot(q_b[x] - q_a[x], q_b[y] - q_a[y]) * abs(q_b[t] - q_a[t])
    return CURVATURE_FACTOR * total / 8.0


@njit(cache=True)
def closest_on_chord(a, b):
    """Return s* and the point a + s*(b − a) that is nearest to the origin, for (3,) arrays."""
    u = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
    length2 = u[0] ** 2 + u[1] ** 2 + u[2] ** 2
    s = 1.0
    if length2 > 1e-18:
        s = min(max(-(a[0] * u[0] + a[1] * u[1] + a[2] * u[2]) / length2, 0.0), 1.0)
    return s, (a[0] + s * u[0], a[1] + s * u[1], a[2] + s * u[2])


@njit(cache=True)
def clearance(a, b, d, k, swept):
    """Return z of the way from a to b (3,) in interval k, for distance d to keep, and its gradients in a and b."""
    nothing = (0.0, 0.0, 0.0)
    if not swept:
        return b[0] ** 2 + b[1] ** 2 + b[2] ** 2 - d * d, nothing, (2.0 * b[0], 2.0 * b[1], 2.0 * b[2])
    if k == 1:
        s, m = closest_on_chord(a, b)
        z = m[0] ** 2 + m[1] ** 2 + m[2] ** 2 - d * d
        return z, nothing, (2.0 * s * m[0], 2.0 * s * m[1], 2.0 * s * m[2])
    u = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
    z = b[0] ** 2 + b[1] ** 2 + b[2] ** 2 - d * d - 0.25 * (u[0] ** 2 + u[1] ** 2 + u[2] ** 2)
    from_a = (0.5 * u[0], 0.5 * u[1], 0.5 * u[2])
    return z, from_a, (2.0 * b[0] - from_a[0], 2.0 * b[1] - from_a[1], 2.0 * b[2] - from_a[2])


@njit(cache=True)
def length(x):
    """Norm of a tuple of three."""
    return np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)


@njit(cache=True)
def travel(data, q0, Q, J, step):
    """Return ρ (N + 1, points), how far (m) a step of entries up to `step` moves each point in the linearization."""
    N, n = Q.shape
    points = data.link_C.shape[0]
    rho = np.zeros((N + 1, points))
    for k in range(1, N + 1):
        low, high = reachable(data, q0, k)
        for i in range(points):
            for j in range(n):
                length = np.sqrt(J[k, i, j, 0] ** 2 + J[k, i, j, 1] ** 2 + J[k, i, j, 2] ** 2)
                rho[k, i] += length * min(step, max(abs(low[j] - Q[k - 1, j]), abs(high[j] - Q[k - 1, j])))
    return rho


@njit(cache=True)
def minimum_distances(data, q0, Q, J, i, k):
    """Return the distance (m) that row (k, i) has to keep, obstacle radius apart."""
    if not data.swept:
        return data.d_min[i]
    q_a = Q[k - 2] if k > 1 else q0
    return data.d_min[i] + PAD + sagitta(data, q_a, Q[k - 1], J[k, i], data.link_C[i])


@njit(cache=True)
def distance_rows(data, q0, Q, P, J, p_WO, radius, step, everything):
    """Return the linearised rows (22) that steps up to `step` can make active, or all of them if `everything`.

    Parameters
    ----------
    data, q0, Q, p_WO, radius
        As in `horizon.evaluate`.
    P, J : (N + 1, points, 3) and (N + 1, points, n, 3) arrays
        Points and Jacobians that it returns.
    """
    N, n = Q.shape
    points, m = data.link_C.shape[0], radius.shape[0]
    capacity = N * points * m if everything else min(N * points * m, 128)
    index = np.empty((3, capacity), np.int64)
    z = np.empty(capacity)
    A, B = np.zeros((capacity, n)), np.zeros((capacity, n))
    rho = travel(data, q0, Q, J, step)
    a, b = np.empty(3), np.empty(3)
    count = 0
    if data.rows_on:
        for k in range(1, N + 1):
            for i in range(points):
                d_i = minimum_distances(data, q0, Q, J, i, k)
                for o in range(m):
                    for r in range(3):
                        a[r] = P[k - 1, i, r] - p_WO[k - 1, o, r]
                        b[r] = P[k, i, r] - p_WO[k, o, r]
                    d = d_i + radius[o]
                    value, from_a, from_b = clearance(a, b, d, k, data.swept)
                    reach = length(from_a) * rho[k - 1, i] + length(from_b) * rho[k, i]
                    if not everything and (value > reach or reach == 0.0):
                        continue
                    if count == capacity:
                        capacity = 2 * capacity
                        index, z, A, B = grow(index, z, A, B, capacity)
                    index[0, count], index[1, count], index[2, count] = k, i, o
                    z[count] = value
                    for j in range(n):
                        B[count, j] = from_b[0] * J[k, i, j, 0] + from_b[1] * J[k, i, j, 1] + from_b[2] * J[k, i, j, 2]
                        if k > 1 and data.swept:
                            A[count, j] = (
                                from_a[0] * J[k - 1, i, j, 0]
                                + from_a[1] * J[k - 1, i, j, 1]
                                + from_a[2] * J[k - 1, i, j, 2]
                            )
                    count += 1
    return Rows(index[0][:count], index[1][:count], index[2][:count], z[:count], A[:count], B[:count])


@njit(cache=True)
def grow(index, z, A, B, capacity):
    """Return the same arrays with room for `capacity` rows."""
    n, count = A.shape[1], z.shape[0]
    index_, z_ = np.empty((3, capacity), np.int64), np.empty(capacity)
    A_, B_ = np.zeros((capacity, n)), np.zeros((capacity, n))
    index_[:, :count], z_[:count], A_[:count], B_[:count] = index, z, A, B
    return index_, z_, A_, B_


@njit(cache=True)
def kept_distances(data, q0, Q, J):
    """Return the distances (N + 1, points) that the rows have to keep (m), obstacle radius apart; stage 0 has none."""
    kept = np.zeros((Q.shape[0] + 1, data.link_C.shape[0]))
    if data.rows_on:
        for k in range(1, Q.shape[0] + 1):
            for i in range(kept.shape[1]):
                kept[k, i] = minimum_distances(data, q0, Q, J, i, k)
    return kept


@njit(cache=True)
def violation(data, P, kept, p_WO, radius):
    """Return Σ max(0, −z) over all rows (22), for points P (N + 1, points, 3) and `kept_distances`."""
    total = 0.0
    if not data.rows_on:
        return total
    a, b = np.empty(3), np.empty(3)
    for k in range(1, P.shape[0]):
        for i in range(P.shape[1]):
            for o in range(radius.shape[0]):
                for r in range(3):
                    a[r] = P[k - 1, i, r] - p_WO[k - 1, o, r]
                    b[r] = P[k, i, r] - p_WO[k, o, r]
                total += max(0.0, -clearance(a, b, kept[k, i] + radius[o], k, data.swept)[0])
    return total


@njit(cache=True)
def slip_rows(data, q0, Q):
    """Return the equalities −Δx sin θ̄ + Δy cos θ̄ = 0, θ̄ = (θ_{k−1} + θ_k)/2, of a platform that cannot slip.

    A platform that drives with constant speed and turning rate goes along an arc, whose chord has the direction θ̄:
    the condition −ẋ sin θ + ẏ cos θ = 0 then holds at every instant between the samples, not at the samples alone.
    """
    N, n = Q.shape
    count = N if data.base.shape[0] == 3 else 0
    index = np.zeros((3, count), np.int64)
    z, A, B = np.zeros(count), np.zeros((count, n)), np.zeros((count, n))
    for k in range(1, count + 1):
        x, y, t = data.base[0], data.base[1], data.base[2]
        before = Q[k - 2] if k > 1 else q0
        dx, dy = Q[k - 1, x] - before[x], Q[k - 1, y] - before[y]
        angle = 0.5 * (Q[k - 1, t] + before[t])
        s, c = np.sin(angle), np.cos(angle)
        index[0, k - 1] = k
        z[k - 1] = -dx * s + dy * c
        turn = 0.5 * (-dx * c - dy * s)
        B[k - 1, x], B[k - 1, y], B[k - 1, t] = -s, c, turn
        A[k - 1, x], A[k - 1, y], A[k - 1, t] = s, -c, turn
    return Rows(index[0], index[1], index[2], z, A, B)
