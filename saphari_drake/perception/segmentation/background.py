"""The static background of a depth camera, learnt from images without a person."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from saphari_drake.errors import StateError
from saphari_drake.perception.segmentation.parameters import SegmentationParameters

Depth = NDArray[np.float32]


def background_depth(frames: Sequence[Depth] | Depth, params: SegmentationParameters | None = None) -> Depth:
    """Learn the static background of each pixel from frames with the robot in several postures and no person.

    It is the median of the farthest readings that agree, at least two and a tenth of all frames. A pixel without a
    reading in half of the frames has its background at +inf: whatever appears there is in front of it.

    Parameters
    ----------
    frames : (k, height, width) float32 array, or sequence of images
        Depth (m); 0, NaN and +inf are no reading.
    """
    params = params or SegmentationParameters()
    stack = np.array(frames, dtype=np.float32)
    if stack.ndim != 3 or len(stack) == 0:
        raise StateError(f"frames: one or more images are needed, got shape {stack.shape}")
    stack[~((stack > 0.0) & np.isfinite(stack))] = np.nan
    count = len(stack)
    missing = np.isnan(stack).sum(axis=0)
    stack = -np.sort(-stack, axis=0)  # farthest first, no reading last
    needed = min(count, max(2, int(np.ceil(0.1 * count))))
    background = np.full(stack.shape[1:], np.inf, dtype=np.float32)
    open_ = missing < 0.5 * count
    for i in range(count):
        if not open_.any():
            break
        top = stack[i][open_]
        agree = stack[i:][:, open_] >= top - 2.0 * params.background_margin * params.scale(top)
        size = agree.sum(axis=0)
        median = np.take_along_axis(stack[i:][:, open_], np.maximum(size - 1, 0)[None] // 2, axis=0)[0]
        rows, cols = np.nonzero(open_)
        done = size >= needed
        background[rows[done], cols[done]] = median[done]
        open_[rows[done], cols[done]] = False
    return background
