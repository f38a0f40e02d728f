"""Bells of pressure fitted to what the modules of a skin carry, so that gaps and edges can be filled."""

from __future__ import annotations

import math

import numpy as np

from saphari_drake.compiled import njit
from saphari_drake.math.products import cholesky, solve_lower, solve_upper
from saphari_drake.perception.skin.bell import bell_share

SHAPE = 5  # u, v, log widths along both, and skew
SIZE = SHAPE + 3  # and the force
_LARGEST_SKEW = 0.6


@njit(cache=True)
def fit_bells(u, v, pitch, forces, weight, shape, force, prior, rounds, share):
    """Fit K bells to the forces of modules by damped Gauss–Newton; return the cost.

    Σ_i w_i ‖F_i − Σ_k B_i(shape_k) f_k‖², plus a weak pull towards a round bell of usual width.

    Parameters
    ----------
    u, v : (a,) and (b,) arrays
        Surface coordinates of the rows and columns of a grid of k = a·b modules (m).
    pitch : float
    forces : (k, 3) array
        Force of each module, in one frame (N).
    weight : (k,) array
        w, zero for modules that do not work.
    shape : (K, 5) array
        Start, and then result; see `bell_share`.
    force : (K, 3) array
        Start, and then result (N).
    prior : (4,) array
        Logs of the usual and the least width (m), and weights relative to the bell's force of the pulls of the mean
        log width to the usual one, and of aspect and skew to zero.
    rounds : int
    share : (K, k) array
        Filled with the bells.
    """
    count, bells = forces.shape[0], shape.shape[0]
    size = SIZE * bells
    slope, new_slope = np.empty((bells, count, SHAPE)), np.empty((bells, count, SHAPE))
    new_share, new_shape, new_force = np.empty((bells, count)), np.empty_like(shape), np.empty_like(force)
    H, L, damped = np.empty((size, size)), np.zeros((size, size)), np.empty((size, size))
    g, step, row = np.empty(size), np.empty(size), np.empty(size)
    for k in range(bells):
        bell_share(u, v, pitch, shape[k], share[k], slope[k])
    cost = _cost(forces, weight, shape, force, prior, share)
    damping = 1e-3
    for _ in range(rounds):
        _normal_equations(forces, weight, shape, force, prior, share, slope, row, H, g)
        accepted, new_cost = False, cost
        for _ in range(4):
            for a in range(size):
                step[a] = g[a]
                for b in range(a + 1):
                    damped[a, b] = H[a, b]
                    damped[b, a] = H[a, b]
                damped[a, a] += damping * H[a, a] + 1e-12
            if not cholesky(damped, L):
                damping *= 10.0
                continue
            solve_lower(L, step, size)
            solve_upper(L, step, size)
            for k in range(bells):
                _stepped(shape[k], step[SIZE * k : SIZE * k + SHAPE], pitch, prior[1], new_shape[k])
                for d in range(3):
                    new_force[k, d] = force[k, d] + step[SIZE * k + SHAPE + d]
                bell_share(u, v, pitch, new_shape[k], new_share[k], new_slope[k])
            new_cost = _cost(forces, weight, new_shape, new_force, prior, new_share)
            if new_cost <= cost:
                accepted = True
                break
            damping *= 10.0
        if not accepted:
            break
        gained, cost = cost - new_cost, new_cost
        shape[:], force[:] = new_shape, new_force
        share[:], slope[:] = new_share, new_slope
        damping = max(0.1 * damping, 1e-9)
        if gained <= 1e-4 * cost:
            break
    return cost


@njit(cache=True)
def _stepped(shape, step, pitch, least, out):
    """Fill the shape after a step, cut to one pitch, half the width, and sound values."""
    for d in range(2):
        out[d] = shape[d] + min(max(step[d], -pitch), pitch)
    for d in range(2, 4):
        out[d] = max(shape[d] + min(max(step[d], -0.7), 0.7), least)
    out[4] = min(max(shape[4] + step[4], -_LARGEST_SKEW), _LARGEST_SKEW)


@njit(cache=True)
def _normal_equations(forces, weight, shape, force, prior, share, slope, row, H, g):
    H[:], g[:] = 0.0, 0.0
    bells = shape.shape[0]
    for i in range(forces.shape[0]):
        if weight[i] == 0.0:
            continue
        for c in range(3):
            r = forces[i, c]
            for k in range(bells):
                r -= share[k, i] * force[k, c]
                for d in range(SHAPE):
                    row[SIZE * k + d] = slope[k, i, d] * force[k, c]
                for d in range(3):
                    row[SIZE * k + SHAPE + d] = share[k, i] if d == c else 0.0
            for a in range(row.shape[0]):
                wa = weight[i] * row[a]
                if wa != 0.0:
                    g[a] += wa * r
                    for b in range(a + 1):
                        H[a, b] += wa * row[b]
    for k in range(bells):
        square = force[k, 0] ** 2 + force[k, 1] ** 2 + force[k, 2] ** 2
        o = SIZE * k
        mean, aspect = _pulls(shape[k], prior)
        wide, other = prior[2] * prior[2] * square, prior[3] * prior[3] * square
        g[o + 2] -= 0.5 * wide * mean + other * aspect
        g[o + 3] -= 0.5 * wide * mean - other * aspect
        g[o + 4] -= other * shape[k, 4]
        H[o + 2, o + 2] += 0.25 * wide + other
        H[o + 3, o + 3] += 0.25 * wide + other
        H[o + 3, o + 2] += 0.25 * wide - other
        H[o + 4, o + 4] += other


@njit(cache=True)
def _pulls(shape, prior):
    """Return how far the mean log width is from the usual one, and the log of the aspect."""
    return 0.5 * (shape[2] + shape[3]) - prior[0], shape[2] - shape[3]


@njit(cache=True)
def _cost(forces, weight, shape, force, prior, share):
    total = 0.0
    for i in range(forces.shape[0]):
        if weight[i] > 0.0:
            for c in range(3):
                r = forces[i, c]
                for k in range(shape.shape[0]):
                    r -= share[k, i] * force[k, c]
                total += weight[i] * r * r
    for k in range(shape.shape[0]):
        square = force[k, 0] ** 2 + force[k, 1] ** 2 + force[k, 2] ** 2
        mean, aspect = _pulls(shape[k], prior)
        total += square * ((prior[2] * mean) ** 2 + prior[3] ** 2 * (aspect**2 + shape[k, 4] ** 2))
    return total


@njit(cache=True)
def fit_window(f_L, usable, rows, columns, u, v, pitch, floor, shape, force, prior, rounds, share):
    """Fit bells to the modules of a window of a patch; return what they leave there as a share of the forces.

    Parameters
    ----------
    f_L : (m, 3) array
        Force of each module of the patch (N).
    usable : (m,) bool array
    rows, columns : (2,) int arrays
        First row and column of the window, and those behind its last.
    u, v : arrays
        Surface coordinates of all rows and columns of the patch (m).
    pitch, floor : float
        Spacing (m), and what a module's weight rests on: w = 1/(floor + its force/the largest)², 1 for the least.
    shape, force, prior, rounds
        As in `fit_bells`.
    share : (K, m) array
        Filled with the bells, zero outside the window.
    """
    width = columns[1] - columns[0]
    count, bells = (rows[1] - rows[0]) * width, shape.shape[0]
    forces, weight, part = np.empty((count, 3)), np.zeros(count), np.empty((bells, count))
    largest, total = 1e-9, 1e-18
    for k in range(count):
        i = (rows[0] + k // width) * v.shape[0] + columns[0] + k % width
        forces[k] = f_L[i]
        if usable[i]:
            square = f_L[i, 0] ** 2 + f_L[i, 1] ** 2 + f_L[i, 2] ** 2
            weight[k] = math.sqrt(square)
            largest, total = max(largest, weight[k]), total + square
    for k in range(count):
        i = (rows[0] + k // width) * v.shape[0] + columns[0] + k % width
        weight[k] = ((1.0 + floor) / (floor + weight[k] / largest)) ** 2 if usable[i] else 0.0
    fit_bells(
        u[rows[0] : rows[1]], v[columns[0] : columns[1]], pitch, forces, weight, shape, force, prior, rounds, part
    )
    share[:] = 0.0
    left = 0.0
    for k in range(count):
        i = (rows[0] + k // width) * v.shape[0] + columns[0] + k % width
        for b in range(bells):
            share[b, i] = part[b, k]
        if usable[i]:
            for c in range(3):
                r = forces[k, c]
                for b in range(bells):
                    r -= part[b, k] * force[b, c]
                left += r * r
    return math.sqrt(left / total)


@njit(cache=True)
def completed_forces(f_L, usable, share, force):
    """Return for each bell what usable modules carry of it, and its own where there is none, (K, 3) in N.

    Where bells overlap, a module's force is divided as they are.
    """
    bells = force.shape[0]
    out = np.zeros((bells, 3))
    size, missing = np.empty(bells), np.ones(bells)
    for b in range(bells):
        size[b] = math.sqrt(force[b, 0] ** 2 + force[b, 1] ** 2 + force[b, 2] ** 2)
    for i in range(f_L.shape[0]):
        if not usable[i]:
            continue
        total = 1e-12
        for b in range(bells):
            missing[b] -= share[b, i]
            total += share[b, i] * size[b]
        for b in range(bells):
            if share[b, i] > 1e-3:
                part = share[b, i] * size[b] / total
                for c in range(3):
                    out[b, c] += part * f_L[i, c]
    for b in range(bells):
        for c in range(3):
            out[b, c] += missing[b] * force[b, c]
    return out
