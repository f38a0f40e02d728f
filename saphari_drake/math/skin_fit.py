"""Pressure bells on a grid of modules: fitted to what the modules carry, so that gaps and edges can be filled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from saphari_drake.math.small_solvers import cholesky, solve_lower, solve_upper

_ROOT2 = math.sqrt(2.0)
_ROOT2PI = math.sqrt(2.0 * math.pi)


@njit(cache=True)
def bell_share(uv, pitch, u, v, width, share, slope):
    """Fill how much of a unit Gaussian bell each module carries (k,), and its slope over u, v and log width (k, 3).

    The bell is integrated over the square of the module, so that an endless grid carries all of it.
    """
    half = 0.5 * pitch
    for i in range(uv.shape[0]):
        a0, a1 = (uv[i, 0] - half - u) / width, (uv[i, 0] + half - u) / width
        b0, b1 = (uv[i, 1] - half - v) / width, (uv[i, 1] + half - v) / width
        pu = 0.5 * (math.erf(a1 / _ROOT2) - math.erf(a0 / _ROOT2))
        pv = 0.5 * (math.erf(b1 / _ROOT2) - math.erf(b0 / _ROOT2))
        ga0, ga1 = math.exp(-0.5 * a0 * a0) / _ROOT2PI, math.exp(-0.5 * a1 * a1) / _ROOT2PI
        gb0, gb1 = math.exp(-0.5 * b0 * b0) / _ROOT2PI, math.exp(-0.5 * b1 * b1) / _ROOT2PI
        share[i] = pu * pv
        slope[i, 0] = -(ga1 - ga0) / width * pv
        slope[i, 1] = -(gb1 - gb0) / width * pu
        slope[i, 2] = -(ga1 * a1 - ga0 * a0) * pv - (gb1 * b1 - gb0 * b0) * pu


@njit(cache=True)
def fit_bells(uv, pitch, forces, usable, centre, width, force, prior, rounds, share):
    """Fit K bells to the forces of modules by damped Gauss–Newton; return the root of the sum of squared residuals.

    Σ_i ‖F_i − Σ_k B_i(u_k, v_k, s_k) f_k‖² over usable modules, plus a weak pull of each log width to that of `prior`.

    Parameters
    ----------
    uv : (k, 2) array
        Surface coordinates of the modules (m).
    pitch : float
    forces : (k, 3) array
        Force of each module, in one frame (N).
    usable : (k,) bool array
    centre, width : (K, 2) and (K,) arrays
        Start, and then result (m).
    force : (K, 3) array
        Start, and then result (N).
    prior : (3,) array
        Width (m) towards which the widths are pulled, weight of that relative to the bell's force, and least width.
    rounds : int
    share : (K, k) array
        Filled with the bells.
    """
    count, bells = uv.shape[0], width.shape[0]
    size = 6 * bells
    slope = np.empty((bells, count, 3))
    new_slope, new_share = np.empty((bells, count, 3)), np.empty((bells, count))
    H, L, g, step = np.empty((size, size)), np.zeros((size, size)), np.empty(size), np.empty(size)
    row = np.empty((3, size))
    new_centre, new_width, new_force = np.empty_like(centre), np.empty_like(width), np.empty_like(force)
    for k in range(bells):
        bell_share(uv, pitch, centre[k, 0], centre[k, 1], width[k], share[k], slope[k])
    cost = _cost(forces, usable, width, force, prior, share)
    damping = 1e-3
    for _ in range(rounds):
        H[:], g[:] = 0.0, 0.0
        for i in range(count):
            if not usable[i]:
                continue
            near = False
            for k in range(bells):
                near = near or share[k, i] > 1e-7
            if not near:
                continue
            for c in range(3):
                r = forces[i, c]
                for k in range(bells):
                    r -= share[k, i] * force[k, c]
                    for d in range(3):
                        row[c, 6 * k + d] = slope[k, i, d] * force[k, c]
                        row[c, 6 * k + 3 + d] = share[k, i] if d == c else 0.0
                for a in range(size):
                    if row[c, a] != 0.0:
                        g[a] += row[c, a] * r
                        for b in range(a + 1):
                            H[a, b] += row[c, a] * row[c, b]
        for k in range(bells):
            weight = prior[1] * prior[1] * (force[k, 0] ** 2 + force[k, 1] ** 2 + force[k, 2] ** 2)
            H[6 * k + 2, 6 * k + 2] += weight
            g[6 * k + 2] -= weight * math.log(width[k] / prior[0])
        accepted = False
        for _ in range(4):
            for a in range(size):
                step[a] = g[a]
                for b in range(a + 1):
                    L[a, b] = H[a, b]
                    H[b, a] = H[a, b]
            damped = H.copy()
            for a in range(size):
                damped[a, a] += damping * H[a, a] + 1e-12
            cholesky(damped, L)
            solve_lower(L, step, size)
            solve_upper(L, step, size)
            for k in range(bells):
                for d in range(2):
                    new_centre[k, d] = centre[k, d] + min(max(step[6 * k + d], -pitch), pitch)
                new_width[k] = max(width[k] * math.exp(min(max(step[6 * k + 2], -0.7), 0.7)), prior[2])
                for d in range(3):
                    new_force[k, d] = force[k, d] + step[6 * k + 3 + d]
                bell_share(uv, pitch, new_centre[k, 0], new_centre[k, 1], new_width[k], new_share[k], new_slope[k])
            new_cost = _cost(forces, usable, new_width, new_force, prior, new_share)
            if new_cost <= cost:
                accepted = True
                break
            damping *= 10.0
        if not accepted:
            break
        gained = cost - new_cost
        cost = new_cost
        centre[:], width[:], force[:] = new_centre, new_width, new_force
        share[:], slope[:] = new_share, new_slope
        damping = max(0.1 * damping, 1e-9)
        if gained <= 1e-5 * cost:
            break
    return math.sqrt(cost)


@njit(cache=True)
def _cost(forces, usable, width, force, prior, share):
    total = 0.0
    for i in range(forces.shape[0]):
        if usable[i]:
            for c in range(3):
                r = forces[i, c]
                for k in range(width.shape[0]):
                    r -= share[k, i] * force[k, c]
                total += r * r
    for k in range(width.shape[0]):
        pull = prior[1] * math.log(width[k] / prior[0])
        total += pull * pull * (force[k, 0] ** 2 + force[k, 1] ** 2 + force[k, 2] ** 2)
    return total
