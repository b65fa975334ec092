"""Correction of light filtered by short separable footprints for the rest of the lens's point spread function."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from prooflight.kernels.prediction.lens_correction import (
    BLOCK,
    NEAR_REACH,
    add_blocks,
    block_means,
    convolve,
    correct_lines,
)
from prooflight.pages.parallel import shared_out

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.lens_correction import LensCorrection

LINES_PER_BAND = 256


def correct_light(light: NDArray[np.float32], correction: LensCorrection, *, threads: int = 1) -> None:
    """Correct light (lines, pixels) in place; it is relative to the backing's level, so that it is 0 beyond the scan.

    Working memory is a sixteenth of the light's.
    """
    if correction.is_identity:
        return
    far = far_light(light, correction)
    weights = np.ascontiguousarray(correction.near[NEAR_REACH:, NEAR_REACH:])
    starts = range(0, len(light), LINES_PER_BAND)
    padded = [(_lines(light, start - NEAR_REACH), _lines(light, start + LINES_PER_BAND)) for start in starts]
    tasks = [
        partial(
            correct_lines,
            light,
            above,
            below,
            weights,
            far,
            start,
            min(start + LINES_PER_BAND, len(light)),
        )
        for start, (above, below) in zip(starts, padded, strict=True)
    ]
    shared_out(tasks, threads=threads)


def far_light(light: NDArray[np.float32], correction: LensCorrection) -> NDArray[np.float32]:
    """Return the light that reaches each block from other blocks; light (lines, pixels) is not changed."""
    blocks = _means(light)
    large = _means(blocks)
    far, farther = np.empty_like(blocks), np.empty_like(large)
    convolve(blocks, correction.far, far)
    convolve(large, correction.farther, farther)
    add_blocks(farther, far)
    return far


def _means(image: NDArray[np.float32]) -> NDArray[np.float32]:
    means = np.empty([-(-extent // BLOCK) for extent in image.shape], np.float32)
    block_means(image, means)
    return means


def _lines(light: NDArray[np.float32], first: int) -> NDArray[np.float32]:
    """Copy ``NEAR_REACH`` lines from ``first`` on, 0 beyond the scan, which no block may enter from above."""
    lines = np.zeros((NEAR_REACH, light.shape[1]), np.float32)
    there = light[max(first, 0) : max(first + NEAR_REACH, 0)]
    lines[: len(there)] = there
    return lines
