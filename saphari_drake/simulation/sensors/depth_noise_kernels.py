"""The compiled passes that make a depth image noisy: most of them over a row's pixels, many of them at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from saphari_drake.compiled import njit

UNIT = np.float32(1.0 / 65536.0)
NONE = np.float32(np.inf)  # depth where nothing is seen


class Noise(NamedTuple):
    """The noise of a camera, as the kernel takes it."""

    fb: np.float32  # focal length times baseline, pixels · m
    focal: np.float32  # pixels
    step: np.float32  # of the disparity, pixels; 0: none
    own: float  # deviations in disparity of a pixel alone, and of what neighbours have in common, pixels
    common: float
    cell: float  # distance over which it is common, pixels
    edge_step: float  # m
    edge_width: int  # pixels
    missing: float  # shares of the pixels near an edge that have no reading, and that mix both depths
    flying: float
    slope_start: float  # tangents of the angles at which readings start to be lost, and all are
    slope_end: float
    shadow: bool
    near: np.float32  # m
    far: np.float32


@njit(cache=True)
def _seen(depth):
    """Return the depth with +inf where nothing is seen: at 0 and NaN too."""
    z = np.empty_like(depth)
    for r in range(depth.shape[0]):
        for c in range(depth.shape[1]):
            z[r, c] = depth[r, c] if depth[r, c] > 0.0 else NONE
    return z


@njit(cache=True)
def _random_bits(key, row, words):
    """Write 64 random bits for each pixel of a row: the SplitMix64 hash of a key and the pixel's number."""
    for c in range(len(words)):
        word = key + np.uint64(row * len(words) + c + 1) * np.uint64(0x9E3779B97F4A7C15)
        word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        words[c] = word ^ (word >> np.uint64(31))


@njit(cache=True)
def _edges(z, jump, width):
    """Mark the pixels within `width` of a depth step larger than `jump` (m) along a row or a column."""
    rows, cols = z.shape
    edge, step = np.zeros((rows, cols), np.uint8), np.zeros(cols, np.uint8)
    for r in range(rows):
        _mark_steps(z[r, 1:], z[r, :-1], jump, step)
        for k in range(-width, width):
            low, high = max(-k, 0), min(cols - 1 - k, cols)
            if low < high:
                _merge(edge[r, low:high], step[low + k : high + k])
    for r in range(rows - 1):
        _mark_steps(z[r + 1], z[r], jump, step)
        for k in range(max(r - width + 1, 0), min(r + width + 1, rows)):
            _merge(edge[k], step)
    return edge


@njit(cache=True)
def _mark_steps(line, other, jump, step):
    for c in range(len(line)):
        step[c] = abs(line[c] - other[c]) > jump


@njit(cache=True)
def _merge(marks, more):
    for c in range(len(marks)):
        marks[c] |= more[c]


@njit(cache=True)
def _beyond_edge(z, r, c, width, jump):
    """Depth beyond the nearest edge of a pixel (+inf: none is known)."""
    rows, cols = z.shape
    for k in range(1, width + 1):
        for side in range(4):
            rr = r + (k if side == 0 else -k if side == 1 else 0)
            cc = c + (k if side == 2 else -k if side == 3 else 0)
            if 0 <= rr < rows and 0 <= cc < cols and abs(z[rr, cc] - z[r, c]) > jump:
                return z[rr, cc]
    return NONE


@njit(cache=True)
def _weights(x, cell):
    """Return the knot left of x and the weights of it and the next one, which keep the variance between them."""
    knot = int(x / cell)
    f = x / cell - knot
    return knot, (1.0 - f) / np.hypot(1.0 - f, f), f / np.hypot(1.0 - f, f)


@njit(cache=True)
def _steps(line, before, after, steps):
    """Write the larger of the depth steps (m) to the neighbours before and after each pixel."""
    for c in range(len(line)):
        steps[c] = max(abs(before[c] - line[c]), abs(after[c] - line[c]))


@njit(cache=True, error_model="numpy")
def _lose(z, r, edge, words, dx, dy, noise, disparity):
    """Set the disparity to NaN in the pixels of a row that have no reading, and mix it at edges."""
    lit = np.inf  # the column of the projector's image up to which surfaces farther right stand in its light
    for c in range(z.shape[1] - 1, -1, -1):
        depth = z[r, c]
        if depth == NONE:
            disparity[c] = np.nan
            continue
        projected = c - disparity[c]
        if projected < lit:
            lit = projected
        elif noise.shadow and projected > lit + 1.0:
            disparity[c] = np.nan
            continue
        if edge[c]:
            u = np.float32(words[c] >> np.uint64(48)) * UNIT
            if u < noise.missing:
                disparity[c] = np.nan
            elif u < noise.missing + noise.flying:
                other = _beyond_edge(z, r, c, noise.edge_width, noise.edge_step)
                if other < NONE:
                    disparity[c] = noise.fb / (depth + (other - depth) * (u - noise.missing) / noise.flying)
        elif noise.focal * max(dx[c], dy[c]) > noise.slope_start * depth:
            u = np.float32(words[c] >> np.uint64(48)) * UNIT
            over = noise.focal * np.hypot(dx[c], dy[c]) / depth - noise.slope_start
            if u * (noise.slope_end - noise.slope_start) < over:
                disparity[c] = np.nan


@njit(cache=True, error_model="numpy")
def _measure(disparity, words, smooth, noise, out):
    """Write the readings (m) of a row, 0 where there are none: disparities with noise, rounded, as depths."""
    mask, own = np.uint64(0xFFFF), np.float32(2.0 * noise.own)
    steps = np.float32(1.0 / noise.step if noise.step > 0.0 else 0.0)
    for c in range(len(out)):
        # The sum of three uniform numbers is close to normal; its deviation is 1/2.
        word = words[c]
        total = np.int64((word & mask) + ((word >> np.uint64(16)) & mask) + ((word >> np.uint64(32)) & mask))
        measured = disparity[c] + (own * (np.float32(total) * UNIT - np.float32(1.5)) + smooth[c])
        if noise.step > 0.0:
            measured = noise.step * np.rint(measured * steps)
        reading = noise.fb / measured
        out[c] = reading if noise.near <= reading <= noise.far else 0.0


@njit(cache=True, error_model="numpy")
def noisy_image(depth, key, coarse, noise):
    """Return the noisy image, 0 where there is no reading.

    Parameters
    ----------
    depth : (rows, columns) float32 array
    key : uint64
        The random bits of all pixels follow from it.
    coarse : array
        Standard normal numbers at knots `cell` apart, which neighbours have in common.
    noise : Noise
    """
    z = _seen(depth)
    rows, cols = z.shape
    out, edge, words = np.empty_like(z), _edges(z, noise.edge_step, noise.edge_width), np.empty(cols, np.uint64)
    knot, left, right = np.empty(cols, np.int64), np.empty(cols), np.empty(cols)
    for c in range(cols):
        knot[c], left[c], right[c] = _weights(c, noise.cell)
    dx, dy, smooth = np.empty(cols, np.float32), np.empty(cols, np.float32), np.empty(cols, np.float32)
    disparity = np.empty(cols)
    for r in range(rows):
        line, i = z[r], int(r / noise.cell)
        _random_bits(key, r, words)
        for c in range(cols):
            disparity[c] = noise.fb / line[c]
        _steps(line[1:-1], line[:-2], line[2:], dx[1:-1])
        for c in (0, cols - 1):
            dx[c] = max(abs(line[max(c - 1, 0)] - line[c]), abs(line[min(c + 1, cols - 1)] - line[c]))
        _steps(line, z[max(r - 1, 0)], z[min(r + 1, rows - 1)], dy)
        _lose(z, r, edge[r], words, dx, dy, noise, disparity)
        _, above, below = _weights(r, noise.cell)
        knots = noise.common * above * coarse[i] + noise.common * below * coarse[i + 1]
        for c in range(cols):
            smooth[c] = left[c] * knots[knot[c]] + right[c] * knots[knot[c] + 1]
        _measure(disparity, words, smooth, noise, out[r])
    return out
