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
solution with them. The SQP guesses β from its last step, and solves again with a larger one
if the solution turns out larger.
"""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.control.nmpc.kinematics import dot
from saphari_drake.control.nmpc.limits import reachable
from saphari_drake.control.nmpc.solvers.subproblem import Rows

# A curved path leaves its chord by at most max ‖p̈‖ T_s²/8; ‖p̈‖ is bounded at the end of the interval, and this factor
# covers its change over the interval.
CURVATURE_FACTOR = 1.25
# m; added to the minimum distance with the margin between samples, for what an iteration leaves.
PAD = 1.0e-5
ROUNDED = 1.0e-9  # m², of z


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
        total += length(J[j]) * step * (2.0 * turning + (step if data.revolute[j] else 0.0))
        if data.revolute[j]:
            turning += step
    if data.base.shape[0] == 3:
        x, y, t = data.base[0], data.base[1], data.base[2]
        total += np.hypot(q_b[x] - q_a[x], q_b[y] - q_a[y]) * abs(q_b[t] - q_a[t])
    return CURVATURE_FACTOR * total / 8.0


@njit(cache=True)
def length(x):
    """Norm of three numbers."""
    return np.sqrt(dot(x, x))


@njit(cache=True)
def clearance(a, b, d, k, swept):
    """Return z of the way from a to b (3,) in interval k, for distance d to keep, and its gradients in a and b."""
    nothing = (0.0, 0.0, 0.0)
    if not swept:
        return dot(b, b) - d * d, nothing, (2.0 * b[0], 2.0 * b[1], 2.0 * b[2])
    u = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
    if k == 1:
        s = min(max(-dot(a, u) / dot(u, u), 0.0), 1.0) if dot(u, u) > 1e-18 else 1.0
        m = (a[0] + s * u[0], a[1] + s * u[1], a[2] + s * u[2])
        return dot(m, m) - d * d, nothing, (2.0 * s * m[0], 2.0 * s * m[1], 2.0 * s * m[2])
    from_a = (0.5 * u[0], 0.5 * u[1], 0.5 * u[2])
    from_b = (2.0 * b[0] - from_a[0], 2.0 * b[1] - from_a[1], 2.0 * b[2] - from_a[2])
    return dot(b, b) - d * d - 0.25 * dot(u, u), from_a, from_b


@njit(cache=True, fastmath=True)
def surplus(p, p_WO, kept, radius, rho, k, swept, out):
    """Fill for each obstacle a number (m,) that is positive only if its row cannot become active.

    It is z less what steps can take from it, as in `distance_rows`, less its rounding; without a branch, so that
    several obstacles are worked on at once. A swept first interval, z = ‖m‖² − d² with ‖m‖ ≥ ‖b‖ − ‖b − a‖, is bounded
    by ‖b‖ alone.

    Parameters
    ----------
    p, p_WO : pairs of (3,) and of (3, m) arrays
        The point and the obstacles at both ends of the interval.
    kept : float
        Distance (m).
    rho : pair of floats
        How far steps move the point there (m).
    """
    ax, ay, az, bx, by, bz = p[0][0], p[0][1], p[0][2], p[1][0], p[1][1], p[1][2]
    share = 0.25 if swept and k > 1 else 0.0
    for o in range(out.shape[0]):
        x, y, z = bx - p_WO[1][0, o], by - p_WO[1][1, o], bz - p_WO[1][2, o]
        u, v, w = x - ax + p_WO[0][0, o], y - ay + p_WO[0][1, o], z - az + p_WO[0][2, o]
        b2, u2, bu, d = x * x + y * y + z * z, u * u + v * v + w * w, x * u + y * v + z * w, kept + radius[o]
        b, way, slope = np.sqrt(b2), np.sqrt(u2), np.sqrt(abs(b2 - 2.0 * share * bu + share * share * u2))
        near = b - way
        first = (near * near if near > 0.0 else 0.0) - 2.0 * b * rho[1]
        later = b2 - share * u2 - 2.0 * share * way * rho[0] - 2.0 * slope * rho[1]
        out[o] = (first if swept and k == 1 else later) - d * d - ROUNDED


@njit(cache=True, fastmath=True)
def shortfalls(p, p_WO, kept, radius, share):
    """Return Σ max(0, −z) over the obstacles, z = ‖b‖² − share ‖b − a‖² − d², for arguments as in `surplus`."""
    ax, ay, az, bx, by, bz = p[0][0], p[0][1], p[0][2], p[1][0], p[1][1], p[1][2]
    total = 0.0
    for o in range(radius.shape[0]):
        x, y, z = bx - p_WO[1][0, o], by - p_WO[1][1, o], bz - p_WO[1][2, o]
        u, v, w = x - ax + p_WO[0][0, o], y - ay + p_WO[0][1, o], z - az + p_WO[0][2, o]
        d = kept + radius[o]
        short = d * d + share * (u * u + v * v + w * w) - x * x - y * y - z * z
        total += short if short > 0.0 else 0.0
    return total


@njit(cache=True)
def travel(data, q0, Q, J, step):
    """Return ρ (N + 1, points), how far (m) a step of entries up to `step` moves each point in the linearization."""
    N, n = Q.shape
    rho = np.zeros((N + 1, data.link_C.shape[0]))
    for k in range(1, N + 1):
        low, high = reachable(data, q0, k)
        for i in range(rho.shape[1]):
            for j in range(n):
                far = max(abs(low[j] - Q[k - 1, j]), abs(high[j] - Q[k - 1, j]))
                rho[k, i] += length(J[k, i, j]) * min(step, far)
    return rho


@njit(cache=True)
def kept_distances(data, q0, Q, J):
    """Return the distances (N + 1, points) that the rows have to keep (m), obstacle radius apart; stage 0 has none."""
    kept = np.zeros((Q.shape[0] + 1, data.link_C.shape[0]))
    for k in range(1, kept.shape[0]):
        for i in range(kept.shape[1]):
            kept[k, i] = data.d_min[i]
            if data.swept:
                q_a = Q[k - 2] if k > 1 else q0
                kept[k, i] += PAD + sagitta(data, q_a, Q[k - 1], J[k, i], data.link_C[i])
    return kept


@njit(cache=True)
def distance_rows(data, scene, Q, at, kept, step, everything):
    """Return the linearised rows (22) that steps up to `step` can make active, or all of them if `everything`.

    Parameters
    ----------
    data, scene, Q
        As in `horizon.evaluate`.
    at : Expansion
    kept : (N + 1, points) array
        See `kept_distances`.
    """
    N, n = Q.shape
    points, m = data.link_C.shape[0], scene.radius.shape[0]
    most = N * points * m if data.rows_on else 0  # memory that is never written to costs nothing
    index, z = np.empty((3, most), np.int64), np.empty(most)
    A, B = np.empty((most, n)), np.empty((most, n))
    rho, a, b = travel(data, scene.q0, Q, at.J, step), np.empty(3), np.empty(3)
    count, room = 0, np.empty(m)
    for pair in range(N * points if data.rows_on else 0):
        k, i = pair // points + 1, pair % points
        p, p_WO, far = (at.P[k - 1, i], at.P[k, i]), (scene.p_WO[k - 1], scene.p_WO[k]), (rho[k - 1, i], rho[k, i])
        surplus(p, p_WO, kept[k, i], scene.radius, far, k, data.swept, room)
        for o in range(m):
            if room[o] > 0.0 and not everything:
                continue
            for r in range(3):
                a[r], b[r] = p[0][r] - p_WO[0][r, o], p[1][r] - p_WO[1][r, o]
            value, from_a, from_b = clearance(a, b, kept[k, i] + scene.radius[o], k, data.swept)
            reach = length(from_a) * far[0] + length(from_b) * far[1]
            if not everything and (value > reach or reach == 0.0):
                continue
            index[0, count], index[1, count], index[2, count] = k, i, o
            z[count] = value
            for j in range(n):
                A[count, j] = dot(from_a, at.J[k - 1, i, j]) if k > 1 else 0.0
                B[count, j] = dot(from_b, at.J[k, i, j])
            count += 1
    return Rows(index[0, :count], index[1, :count], index[2, :count], z[:count], A[:count], B[:count])


@njit(cache=True)
def violation(data, scene, P, kept):
    """Return Σ max(0, −z) over all rows (22), for points P (N + 1, points, 3) and `kept_distances`."""
    total, a, b = 0.0, np.empty(3), np.empty(3)
    p_WO, radius, swept = scene.p_WO, scene.radius, data.swept
    if not data.rows_on:
        return total
    for k in range(1, P.shape[0]):
        for i in range(P.shape[1]):
            if not (swept and k == 1):
                ends, obstacles = (P[k - 1, i], P[k, i]), (p_WO[k - 1], p_WO[k])
                total += shortfalls(ends, obstacles, kept[k, i], radius, 0.25 if swept else 0.0)
                continue
            for o in range(radius.shape[0]):
                for r in range(3):
                    a[r] = P[k - 1, i, r] - p_WO[k - 1, r, o]
                    b[r] = P[k, i, r] - p_WO[k, r, o]
                total += max(0.0, -clearance(a, b, kept[k, i] + radius[o], k, swept)[0])
    return total


@njit(cache=True)
def slack_length(data, scene, rows, slack):
    """Return the largest slack (m²) of the distance rows as the length (m) by which a distance falls short."""
    longest = 0.0
    for r in range(slack.shape[0]):
        d = data.d_min[rows.point[r]] + scene.radius[rows.obstacle[r]]
        longest = max(longest, d - np.sqrt(max(d * d - slack[r], 0.0)))
    return longest


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
