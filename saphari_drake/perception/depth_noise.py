"""What a structured-light camera such as the first Kinect does to a depth image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from saphari_drake.errors import ParameterError
from saphari_drake.parameters import require_non_negative, require_positive
from saphari_drake.perception.rgbd_camera import CameraParameters

Depth = NDArray[np.float32]


@dataclass
class DepthNoiseParameters:
    """Noise of the first Kinect. All random numbers follow from the seed and the number of the frame."""

    # Whether noise is added at all.
    enabled: bool = True
    # Seed (integer ≥ 0).
    seed: int = 0
    # Distance between infrared camera and projector (m, > 0). Kinect v1; the projector is on the camera's right.
    baseline: float = 0.075
    # Step of the measured disparity (pixels, ≥ 0). Kinect v1: 1/8.
    disparity_step: float = 0.125
    # Standard deviation of a reading, quantisation included (m, ≥ 0), at the depth below. Measured with a Kinect v1.
    sigma: float = 0.004
    # Depth at which sigma holds (m, > 0); it grows with the square of the depth.
    sigma_depth: float = 1.7
    # Share of the noise's variance that neighbouring pixels have in common (0–1). Assumed.
    correlated_share: float = 0.5
    # Distance over which it is common (pixels, ≥ 1). Assumed, of the order of the camera's matching window.
    correlation_length: float = 4.0
    # Depth step between neighbours that counts as an edge (m, > 0). Assumed.
    edge_step: float = 0.04
    # Reach of an edge's effects (pixels, ≥ 0, integer). Assumed.
    edge_width: int = 2
    # Share of the pixels near an edge that have no reading, and that mix both depths (0–1). Assumed.
    edge_missing: float = 0.4
    edge_flying: float = 0.1
    # Whether what the projector does not light has no reading.
    shadow: bool = True
    # Angles between surface normal and ray at which readings start to be lost and all are lost (rad, 0–π/2). Assumed.
    grazing_start: float = 1.22
    grazing_end: float = 1.48

    def __post_init__(self) -> None:
        require_positive(self, "baseline", "sigma_depth", "edge_step")
        require_non_negative(self, "seed", "disparity_step", "sigma", "edge_width")
        for name in ("correlated_share", "edge_missing", "edge_flying"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ParameterError(name, f"must lie in 0–1, got {getattr(self, name)}")
        if self.edge_missing + self.edge_flying > 1.0:
            raise ParameterError("edge_flying", "and edge_missing must not exceed 1 together")
        if not 1.0 <= self.correlation_length < np.inf:
            raise ParameterError("correlation_length", f"must be at least 1 pixel, got {self.correlation_length}")
        if not 0.0 < self.grazing_start < self.grazing_end < np.pi / 2:
            raise ParameterError("grazing_end", "must lie above grazing_start, both between 0 and π/2")


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
def _noise_kernel(z, bits, coarse, fb, focal, step, sigma_d, share, cell, jump, width, lost, flying, s0, s1, shadow,
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


def add_kinect_noise(
    depth: Depth, rng: np.random.Generator, params: DepthNoiseParameters, camera: CameraParameters | None = None
) -> Depth:
    """Return a depth image as a Kinect would measure it; no reading is 0.

    The noise has a constant deviation in disparity f b / z, so that it grows with z²; the disparity is then rounded.

    Parameters
    ----------
    depth : (height, width) float32 array
        Exact depth (m); 0, +inf and NaN are no reading.
    rng : numpy.random.Generator
        Source of all random numbers.
    params : DepthNoiseParameters
    camera : CameraParameters, optional
        Focal length and range; default: the Kinect's.
    """
    camera = camera or CameraParameters()
    if not params.enabled:
        return depth
    z = np.where((depth > 0.0) & (depth < np.inf), depth, np.inf).astype(np.float32)
    rows, cols = z.shape
    cell = params.correlation_length
    bits = rng.integers(0, 2**64, z.shape, dtype=np.uint64)
    coarse = rng.standard_normal((int(rows / cell) + 2, int(cols / cell) + 2))
    fb = camera.focal_x * params.baseline
    variance = (params.sigma * fb / params.sigma_depth**2) ** 2 - params.disparity_step**2 / 12.0
    return _noise_kernel(
        z, bits, coarse, fb, camera.focal_x, params.disparity_step, np.sqrt(max(variance, 0.0)),
        params.correlated_share, cell, params.edge_step, int(params.edge_width), params.edge_missing,
        params.edge_flying, np.tan(params.grazing_start), np.tan(params.grazing_end), params.shadow, camera.near,
        camera.far,
    )  # fmt: skip
