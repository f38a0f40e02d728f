"""Closed loops on arrays, compiled: an arm with exact dynamics in its envelope, and one with a verified stop."""

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.products import cholesky, solve_lower, solve_upper
from saphari_drake.math.tree import tree_dynamics, tree_kinematics
from saphari_drake.safety.joint_envelope.law import BRAKING, Motion, limited_torque
from saphari_drake.safety.verified_stop.geometry import ball_distance, shape_poses
from saphari_drake.safety.verified_stop.law import STOPPING, Surroundings, checked_velocity

SEEN = 66  # cycles between two looks at the people
RISE = 0.05  # Nm or N, of a push in a cycle


@njit(cache=True)
def enveloped(tree, envelope, q, commands, push):
    """Return the largest shares of speed, position, torque and rate of torque (4,), and the cycles that only braked.

    Parameters
    ----------
    tree : Tree
    envelope : Envelope
    q : (n,) array
        Start, at rest.
    commands : (T, n) array
        Torques asked for, a row a cycle (Nm or N).
    push : (n,) array
        External torque, to which it rises (Nm or N).
    """
    n, period, braking = q.shape[0], envelope.period, 0
    q, v, worst, external = q.copy(), np.zeros(n), np.zeros(4), np.zeros(n)
    middle, half = 0.5 * (envelope.q_max + envelope.q_min), 0.5 * (envelope.q_max - envelope.q_min)
    _, _, _, tau, _ = tree_dynamics(tree, tree_kinematics(tree, q, v), v)
    L = np.zeros((n, n))
    for k in range(commands.shape[0]):
        M, Cv, _, g, _ = tree_dynamics(tree, tree_kinematics(tree, q, v), v)
        h = Cv + g
        for i in range(n):
            external[i] += min(max(push[i] - external[i], -RISE), RISE)
        given = limited_torque(envelope, Motion(q, v, M, h, external, tau), commands[k])
        braking += given.status == BRAKING
        rate = np.max(np.abs(given.torque - tau) / (envelope.tau_rate * period))
        tau = given.torque
        a = tau + external - h
        cholesky(M, L)
        solve_lower(L, a, n)
        solve_upper(L, a, n)
        v = v + period * a
        q = q + period * v
        worst[0] = max(worst[0], np.max(np.abs(v) / envelope.v_max))
        worst[1] = max(worst[1], np.max(np.abs(q - middle) / half))
        worst[2] = max(worst[2], np.max(np.abs(tau) / envelope.tau_max))
        worst[3] = max(worst[3], rate)
    return worst, braking


@njit(cache=True)
def braked(body, intervals, q, commands, people, speed, aims):
    """Return the least gap (m) of people from a moving robot, cycles outside limits, shares of moving and stopping.

    Parameters
    ----------
    body : Body
    intervals : int
    q : (n,) array
        Start, at rest.
    commands : (T, n) array
        Velocities asked for, a row a cycle.
    people : Surroundings
        Where they are, and what is known of them when they are seen.
    speed : float
        With which they run (m/s), at the link (T, people) of `aims`.
    aims : (T, people) array of int
    """
    n, count, m, period = q.shape[0], body.link.shape[0], people.p.shape[0], body.period
    q, v, at, seen = q.copy(), np.zeros(n), people.p.copy(), people.p.copy()
    links = np.empty((n, 3, 3)), np.empty((n, 3))
    poses = np.empty((count, 3, 3)), np.empty((count, 3))
    gap, outside, moved, stopping, age = np.inf, 0, 0, 0, 0.0
    for k in range(commands.shape[0]):
        age = 0.0 if k % SEEN == 0 else age + period
        if k % SEEN == 0:
            seen[:] = at
        around = Surroundings(seen, people.v, people.radius + speed * age, people.growth)
        checked = checked_velocity(body, intervals, q, v, commands[k], True, around)
        v = checked.v
        stopping += checked.status == STOPPING
        q = q + period * v
        for j in range(n):
            outside += q[j] > body.q_max[j] or q[j] < body.q_min[j]
        shape_poses(body, q, links, poses)
        for o in range(m):
            way = links[1][aims[k, o]] - at[o]
            far = np.sqrt((way**2).sum())
            at[o] += way * min(1.0, speed * period / max(far, 1e-9))
        if np.max(np.abs(v)) > 0.0:
            moved += 1
            true = Surroundings(at, people.v, people.radius, people.growth)
            for s in range(count):
                for o in range(m):
                    gap = min(gap, ball_distance(body, s, poses, true, o, 0.0) - people.radius[o])
    return gap, outside, moved / commands.shape[0], stopping / commands.shape[0]
