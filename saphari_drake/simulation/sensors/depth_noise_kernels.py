"""The compiled pass that makes a depth image noisy."""

from __future__ import annotations

import numpy as np

from saphari_drake.compiled import njit


@njit(cache=True)
def _edges(z, jump, width):
    """Mark the pixels within `width` of a depth step larger than `jump` (m) along a row or a column."""
    rows, cols = z.shape
    step = np.zeros((rows, cols), np.uint8)
    for r in range(rows):
        for c in range(cols - 1):
            if abs(z[r, c + 1] - z[r, c]) > jump:
                for k in range(max(c - width + 1, 0), min(c + width + 1, cols)):
                    step[r, k] = 1
    for r in range(rows - 1):
        for c in range(cols):
            if abs(z[r + 1, c] - z[r, c]) > jump:
                for k in range(max(r - width + 1, 0), min(r + width + 1, rows)):
                    step[k, c] = 1
    return step


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
    return np.float32(np.inf)


@njit(cache=True, error_model="numpy")
def noisy_image(z, bits, coarse, fb, focal, step, sigma_d, share, cell, jump, width, lost, flying, s0, s1, shadow,
                  near, far):  # fmt: skip
    """Return the noisy image; z has +inf where nothing is seen, `bits` 64 random bits a pixel, sigma_d is in pixels."""
    rows, cols = z.shape
    out = np.zeros((rows, cols), np.float32)
    edge = _edges(z, jump, width)
    unit = np.float32(1.0 / 65536.0)
    own, common = np.float32(2.0 * sigma_d * np.sqrt(1.0 - share)), sigma_d * np.sqrt(share)
    fb, step, steps = np.float32(fb), np.float32(step), np.float32(1.0 / step if step > 0.0 else 0.0)
    near, far, focal = np.float32(near), np.float32(far), np.float32(focal)
    knot, weight = np.empty(cols, np.int64), np.empty((2, cols))
    for c in range(cols):
        knot[c] = int(c / cell)
        f = c / cell - knot[c]
        weight[0, c], weight[1, c] = (1.0 - f) / np.hypot(1.0 - f, f), f / np.hypot(1.0 - f, f)
    smooth = np.empty(cols, np.float32)
    for r in range(rows):
        i = int(r / cell)
        f = r / cell - i
        g0, g1 = common * (1.0 - f) / np.hypot(1.0 - f, f), common * f / np.hypot(1.0 - f, f)
        line = g0 * coarse[i] + g1 * coarse[i + 1]
        for c in range(cols):
            smooth[c] = weight[0, c] * line[knot[c]] + weight[1, c] * line[knot[c] + 1]
        above, below = max(r - 1, 0), min(r + 1, rows - 1)
        lit = np.float32(np.inf)
        for c in range(cols - 1, -1, -1):
            depth = z[r, c]
            if depth == np.inf:
                continue
            disparity = fb / depth
            projected = np.float32(c) - disparity
            if projected < lit:
                lit = projected
            elif shadow and projected > lit + np.float32(1.0):
                continue
            word = bits[r, c]
            u = np.float32(word >> np.uint64(48)) * unit
            if edge[r, c]:
                if u < lost:
                    continue
                if u < lost + flying:
                    other = _beyond_edge(z, r, c, width, jump)
                    if other < np.inf:
                        disparity = fb / (depth + (other - depth) * (u - lost) / flying)
            else:
                dx = max(abs(z[r, max(c - 1, 0)] - depth), abs(z[r, min(c + 1, cols - 1)] - depth))
                dy = max(abs(z[above, c] - depth), abs(z[below, c] - depth))
                slope = focal * max(dx, dy)
                if slope > s0 * depth:
                    slope = focal * np.hypot(dx, dy) / depth
                    if u * (s1 - s0) < slope - s0:
                        continue
            # The sum of three uniform numbers is close to normal; its deviation is 1/2.
            mask = np.uint64(0xFFFF)
            total = (word & mask) + ((word >> np.uint64(16)) & mask) + ((word >> np.uint64(32)) & mask)
            disparity += own * (np.float32(total) * unit - np.float32(1.5)) + smooth[c]
            if step > 0.0:
                disparity = step * np.rint(disparity * steps)
            reading = fb / disparity
            if reading >= near and reading <= far:
                out[r, c] = reading
    return out
