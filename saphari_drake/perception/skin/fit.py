"""Bells of pressure fitted to what the modules of a skin carry, so that gaps and edges can be filled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from saphari_drake.compiled import njit
from saphari_drake.math.products import cholesky, solve_lower, solve_upper
from saphari_drake.perception.skin.bell import Grid, bell_share

Array = NDArray[np.float64]

SHAPE = 5  # u, v, log widths along both, and skew
SIZE = SHAPE + 3  # and the force
_LARGEST_SKEW = 0.6


class Load(NamedTuple):
    """What the modules of a grid carry."""

    force: NDArray[np.float64]  # (k, 3) N, in one frame
    weight: NDArray[np.float64]  # (k,) in the fit, zero for modules that do not work


class Prior(NamedTuple):
    """What bells usually are, and how they are fitted; the pulls are relative to a bell's force."""

    usual: float  # log of the usual width (m)
    least: float  # log of the least width (m)
    width: float  # pull of the mean log width to the usual one
    round: float  # pull of aspect and skew to zero
    floor: float  # of a module's weight, which is 1/(floor + its force/the largest)², and 1 for the least
    rounds: int  # of the fit at most


@njit(cache=True)
def fit_bells(grid, load, shape, force, prior, share):
    """Fit K bells to the forces of modules by damped Gauss–Newton; return the cost.

    Σ_i w_i ‖F_i − Σ_k B_i(shape_k) f_k‖², plus a weak pull towards a round bell of usual width.

    Parameters
    ----------
    grid : Grid
        Of k modules.
    load : Load
    shape, force : (K, 5) and (K, 3) arrays
        Start, and then result; see `bell_share`, and N.
    prior : Prior
    share : (K, k) array
        Filled with the bells.
    """
    count, bells = load.force.shape[0], shape.shape[0]
    size = SIZE * bells
    slope, new_slope = np.empty((bells, count, SHAPE)), np.empty((bells, count, SHAPE))
    new_share, new_shape, new_force = np.empty((bells, count)), np.empty_like(shape), np.empty_like(force)
    H, L, damped = np.empty((size, size)), np.zeros((size, size)), np.empty((size, size))
    g, step = np.empty(size), np.empty(size)
    for k in range(bells):
        bell_share(grid, shape[k], share[k], slope[k])
    cost = _cost(load, shape, force, prior, share)
    damping = 1e-3
    for _ in range(prior.rounds):
        _normal_equations(load, shape, force, prior, share, slope, H, g)
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
                _stepped(shape[k], step[SIZE * k : SIZE * k + SHAPE], grid.pitch, prior.least, new_shape[k])
                for d in range(3):
                    new_force[k, d] = force[k, d] + step[SIZE * k + SHAPE + d]
                bell_share(grid, new_shape[k], new_share[k], new_slope[k])
            new_cost = _cost(load, new_shape, new_force, prior, new_share)
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
def _normal_equations(load, shape, force, prior, share, slope, H, g):
    H[:], g[:] = 0.0, 0.0
    forces, weight = load
    bells, row = shape.shape[0], np.empty(g.shape[0])
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
        wide, other = prior.width * prior.width * square, prior.round * prior.round * square
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
    return 0.5 * (shape[2] + shape[3]) - prior.usual, shape[2] - shape[3]


@njit(cache=True)
def _cost(load, shape, force, prior, share):
    total = _left(load.force, load.weight, force, share)
    for k in range(shape.shape[0]):
        square = force[k, 0] ** 2 + force[k, 1] ** 2 + force[k, 2] ** 2
        mean, aspect = _pulls(shape[k], prior)
        total += square * ((prior.width * mean) ** 2 + prior.round**2 * (aspect**2 + shape[k, 4] ** 2))
    return total


@njit(cache=True)
def _left(forces, weight, force, share):
    """Return the weighted sum of squares (N²) that bells leave of the modules' forces (k, 3)."""
    total = 0.0
    for i in range(forces.shape[0]):
        if weight[i] > 0.0:
            for c in range(3):
                r = forces[i, c]
                for k in range(force.shape[0]):
                    r -= share[k, i] * force[k, c]
                total += weight[i] * r * r
    return total


@njit(cache=True)
def fit_window(f_L, usable, window, grid, shape, force, prior, share):
    """Fit bells to the modules of a window of a patch; return what they leave there as a share of the forces.

    Parameters
    ----------
    f_L : (m, 3) array
        Force of each module of the patch (N).
    usable : (m,) bool array
    window : (4,) tuple of int
        First row of the window and the one behind its last; then the columns.
    grid : Grid
        Of the patch.
    shape, force, prior
        As in `fit_bells`.
    share : (K, m) array
        Filled with the bells, zero outside the window.
    """
    r0, r1, c0, c1 = window
    u, v = grid.u[r0:r1], grid.v[c0:c1]
    inside = np.empty(u.shape[0] * v.shape[0], np.int64)
    for k in range(inside.shape[0]):
        inside[k] = (r0 + k // v.shape[0]) * grid.v.shape[0] + c0 + k % v.shape[0]
    forces, counts = f_L[inside], usable[inside].astype(np.float64)
    size = counts * np.sqrt(np.sum(forces * forces, axis=1))
    largest = 1e-9
    for k in range(size.shape[0]):
        largest = max(largest, size[k])
    weight = counts * ((1.0 + prior.floor) / (prior.floor + size / largest)) ** 2
    part = np.empty((shape.shape[0], inside.shape[0]))
    fit_bells(Grid(u, v, grid.pitch), Load(forces, weight), shape, force, prior, part)
    share[:] = 0.0
    share[:, inside] = part
    return math.sqrt(_left(forces, counts, force, part) / (1e-18 + np.sum(size * size)))


def completed_forces(f_L: Array, usable: NDArray[np.bool_], share: Array, force: Array) -> Array:
    """Return for each bell what usable modules carry of it, and its own where there is none, (K, 3) in N.

    Where bells overlap, a module's force is divided as they are.
    """
    own = share[:, usable]
    part = own * np.linalg.norm(force, axis=1)[:, None]
    part = np.where(own > 1e-3, part / (1e-12 + part.sum(axis=0)), 0.0)
    return part @ f_L[usable] + (1.0 - own.sum(axis=1))[:, None] * force
