"""Motion of one or two guided points: admittance (48), joint accelerations by priority (49), and limits of both.

Compiled, without BLAS; all arrays are float64 and contiguous.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.products import apply, product, symmetric_eigen

Array = NDArray[np.float64]
NO_MOTION = 1e-6  # m/rad (m/m); a smaller singular value is that of a direction in which no joint moves the point
KNEE = 0.8  # share of the speed limit up to which the admittance is left as it is


@njit(cache=True)
def norm(v):
    """Return the Euclidean length of a vector."""
    total = 0.0
    for x in v:
        total += x * x
    return np.sqrt(total)


@njit(cache=True)
def task_inverse(J, threshold):
    """Return J† with singular values σ below `threshold` damped so that it stays continuous and bounded.

    1/σ becomes (2 − σ²/ε²)σ/ε² for σ < ε, which fits value and slope at ε and goes to zero with σ. Above ε it is exact.

    Parameters
    ----------
    J : (m, n) array
        Jacobian of any rank.
    threshold : float
        ε, in the unit of J.

    Returns
    -------
    J_inv : (n, m) array
    reachable : (m, m) array
        J J†, the projector on the directions in which the point can move.
    rank : int
        Number of singular values above the threshold.
    lost : (m,) array
        Unit direction in which the point moves the least; zero at full rank.
    moving : (n, n) array
        Projector on the joint motion that moves the point, however little: J (I − moving) = 0, damped or not.
    """
    squares, U = symmetric_eigen(product(J, J.T))
    squares, limit = np.maximum(squares, 0.0), threshold * threshold
    V = product(J.T, U * np.where(squares > NO_MOTION**2, 1.0 / np.sqrt(np.maximum(squares, NO_MOTION**2)), 0.0))
    full = squares >= limit
    scale = np.where(full, 1.0 / np.maximum(squares, limit), (2.0 - squares / limit) / limit)
    J_inv = product(J.T, product(U * scale, U.T))
    reachable, rank = product(U * (scale * squares), U.T), np.sum(full)
    lost = U[:, 0].copy() if rank < len(squares) else np.zeros(len(squares))
    return J_inv, reachable, rank, lost, product(V, V.T)


@njit(cache=True)
def priority_acceleration(J, a, rest, threshold):
    """Return the joint acceleration that moves one point exactly, and another as far as the first leaves it free.

        q̈_c = q̈_1 + (J_2N_1)†(a_2 − J_2q̈_1),   q̈_1 = J_1†a_1 + (I − J_1†J_1) r,   J_1N_1 = 0.

    Corrected: (49) prints N_1J_2† for (J_2N_1)†, which realises only a part of the second acceleration that is
    possible. The term of r, not in (49), says what joint motion does that no point asks for. N_1 leaves out all that
    moves the main point, also where J_1† is damped: J_1q̈_c = J_1q̈_1 whatever a_2 is, and J_1J_1†a_1 whatever r is
    as long as the singular values of J_1 are zero or above the threshold.

    Parameters
    ----------
    J : (k, 3, n) array
        Jacobians of the main point and, if k = 2, of the second one.
    a : (k, 3) array
        a_c = ẍ_{c,d} − J̇_cq̇.
    rest : (n,) array
        r (rad/s²).
    threshold : float
        Singular values below this are damped.

    Returns
    -------
    acceleration : (n,) array
    N_1 : (n, n) array
    reachable : (k, 3, 3) array
        Directions in which each point can move, the second one without moving the first.
    rank : (k,) array
    lost : (k, 3) array
        See `task_inverse`.
    """
    k, n = J.shape[0], J.shape[2]
    reachable, rank, lost = np.empty((k, 3, 3)), np.empty(k), np.empty((k, 3))
    J_inv, reachable[0], rank[0], lost[0], moving = task_inverse(J[0], threshold)
    N_1 = np.eye(n) - moving
    acceleration = rest + apply(J_inv, a[0] - apply(J[0], rest))
    if k > 1:
        J_inv, reachable[1], rank[1], lost[1], _ = task_inverse(product(J[1], N_1), threshold)
        acceleration += apply(J_inv, a[1] - apply(J[1], acceleration))
    return acceleration, N_1, reachable, rank, lost


@njit(cache=True)
def smooth_limit(v, limit):
    """Return a vector shortened to less than `limit`, in the same direction; unchanged below 0.8 of it, C¹ beyond."""
    size, knee = norm(v), KNEE * limit
    if size <= knee:
        return v.copy()
    rest = limit - knee
    return v * ((limit - rest * np.exp(-(size - knee) / rest)) / size)


@njit(cache=True)
def admittance(v, force, compliance, step, max_speed):
    """Return ṗ_d (3,) of the next cycle by (48), M_c p̈_d = F − D_c ṗ_d, and whether the speed limit showed.

    Implicit Euler, ṗ' = ṗ + (M + T D)⁻¹T D (D⁻¹F − ṗ): stable for any gains, with ṗ_d = D⁻¹F at rest. D⁻¹F is
    limited by `smooth_limit`. A motion that is faster, as the other point can bring about, is only slowed by D.

    Parameters
    ----------
    v, force : (3,) arrays
        ṗ_d (m/s) and F (N).
    compliance, step : (3, 3) arrays
        D⁻¹ (m/s/N) and (M + T D)⁻¹T D, see `admittance_matrices`.
    max_speed : float
        In m/s.
    """
    target = apply(compliance, force)
    limited = norm(target) > KNEE * max_speed
    following = v + apply(step, smooth_limit(target, max_speed) - v)
    limit, size = max(max_speed, norm(v)), norm(following)
    if size > limit:
        following *= limit / size
    return following, limited


def admittance_matrices(mass: Array, damping: Array, period: float) -> tuple[Array, Array]:
    """Return D⁻¹ and (M + T D)⁻¹T D, both (3, 3), of an admittance with M (kg) and D (Ns/m) at a period T (s)."""
    step = np.linalg.solve(mass + period * damping, period * damping)
    return np.ascontiguousarray(np.linalg.inv(damping)), np.ascontiguousarray(step)


@njit(cache=True)
def confine(v, p, centre, radius, time, slower):
    """Return a velocity whose part out of a sphere does not exceed (distance to the sphere)/time, and if it did.

    A point that starts inside then stays there, as its distance to the sphere decays no faster than exp(−t/time). One
    that is outside already is not driven back, and one that begins too fast is slowed down gradually.

    Parameters
    ----------
    v, p, centre : (3,) arrays
        Velocity, position and centre of the sphere (m).
    radius, time, slower : float
        Radius (m; 0: no bound), time constant (s), and what is taken from the velocity at most (m/s).
    """
    away = p - centre
    distance = norm(away)
    if radius == 0.0 or distance < 1e-9:
        return v, False
    away /= distance
    excess = -max(radius - distance, 0.0) / time
    for i in range(3):
        excess += v[i] * away[i]
    return (v - min(excess, slower) * away, True) if excess > 0.0 else (v, False)


@njit(cache=True)
def limit_joint_velocity(v, J, low, high, threshold):
    """Return a joint velocity within bounds, and whether it had to be changed.

    Joints beyond their bounds are held there, one after the other, and the rest moves so that the main point goes on as
    asked for, and then the second one, as far as that is possible.

    Parameters
    ----------
    v : (n,) array
        Velocity asked for.
    J : (k, 3, n) array
        Jacobians of the main and the second point, k from 0 to 2.
    low, high : (n,) arrays
        Bounds, low ≤ high.
    threshold : float
        Singular values below this are damped.
    """
    k, n = J.shape[0], len(v)
    inside = True
    for j in range(n):
        inside = inside and low[j] <= v[j] <= high[j]
    if inside:
        return v, False
    free, following, held = np.ones(n), v.copy(), v.copy()
    for _ in range(n if k > 0 else 0):
        worst, joint = 0.0, -1
        for j in range(n):
            excess = max(following[j] - high[j], low[j] - following[j])
            if free[j] == 1.0 and excess > worst + 1e-12:
                worst, joint = excess, j
        if joint < 0:
            break
        free[joint], held[joint] = 0.0, min(max(following[joint], low[joint]), high[joint])
        following = held.copy()
        N = np.diag(free)
        for i in range(k):
            J_inv, _, _, _, moving = task_inverse(product(J[i], N), threshold)
            following += apply(J_inv, apply(J[i], v - following))
            N = N - moving
    return np.minimum(np.maximum(following, low), high), True


class JointLimits(NamedTuple):
    """What bounds the motion of the joints."""

    q_min: Array  # (n,) rad (m)
    q_max: Array
    v_max: Array  # (n,) rad/s (m/s)
    approach_time: float  # s; limits of position are approached with this time constant
    max_acceleration: float  # rad/s² (m/s²)
    max_deceleration: float  # with which a joint can always be stopped before its limit
    period: float  # s

    def velocity(self, q: Array, v: Array, v_asked: Array, J: Array, threshold: float) -> tuple[Array, bool]:
        """Return the joint velocity (n,) that follows `v` at `q`, and whether `v_asked` had to be changed for it.

        The bounds of `limit_joint_velocity` are (distance to the limit)/`approach_time`, at most v_max, as far as the
        acceleration allows. Braking in time for a limit comes last, and is not told.
        """
        below, above = np.maximum(q - self.q_min, 0.0), np.maximum(self.q_max - q, 0.0)
        low, high = (
            sign * np.minimum(room / self.approach_time, self.v_max) for sign, room in ((-1, below), (1, above))
        )
        most = self.max_acceleration * self.period
        low, high = (np.minimum(np.maximum(bound, v - most), v + most) for bound in (low, high))
        following, changed = limit_joint_velocity(v_asked, J, low, high, threshold)
        twice = 2.0 * self.max_deceleration
        return np.minimum(np.maximum(following, -np.sqrt(twice * below)), np.sqrt(twice * above)), changed
