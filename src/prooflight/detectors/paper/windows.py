"""Window means of the error map, and the three numbers of them on which the paper learns (section 4.2)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

Reading = Literal["signed", "absolute"]
"""What "mean" and "minimum" are of: the window means as they are, or their magnitudes. The paper's text allows both."""
MEDIAN_SIGMAS: Final = 0.6745
"""Half of a Gaussian lies within so many standard deviations."""
SHARE_SIGMAS: Final = 0.675
"""The paper's limit: on a good page half of the errors lie below it. [-]"""
STATISTICS: Final = ("mean", "minimum", "share")


def window_means(z: NDArray[np.float32], *, side: int, overlapping: bool = False) -> NDArray[np.float32]:
    """Means of z over side x side windows, times side: N(0, 1) on a good page.

    z (..., lines, pixels). Separate windows start at the first line and pixel, and what is left over is dropped:
    (..., lines // side, pixels // side). Overlapping ones lie at every pixel: (..., lines - side + 1, pixels - side +
    1). ValueError if not a single window fits.
    """
    lines, pixels = z.shape[-2:]
    if not 1 <= side <= min(lines, pixels):
        message = f"windows of {side} x {side} pixels do not fit {lines} x {pixels}"
        raise ValueError(message)
    if not overlapping:
        rows, columns = lines // side, pixels // side
        cut = z[..., : rows * side, : columns * side]
        blocks = cut.reshape(*z.shape[:-2], rows, side, columns, side)
        return np.asarray(blocks.mean(axis=(-3, -1), dtype=np.float64) * side, np.float32)
    planes = [_box_sums(plane, side) for plane in z.reshape(-1, lines, pixels)]
    return (np.stack(planes) / np.float32(side)).reshape(*z.shape[:-2], *planes[0].shape)


def _box_sums(plane: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Sums over the windows that lie wholly inside; OpenCV's anchor is the window's first pixel here."""
    whole = np.ascontiguousarray(plane, np.float32)
    sums = cv2.boxFilter(
        whole, -1, (side, side), anchor=(0, 0), normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    return np.asarray(sums[: plane.shape[0] - side + 1, : plane.shape[1] - side + 1], np.float32)


def window_unit(means: NDArray[np.float32]) -> NDArray[np.float64]:
    """How wide window means (..., rows, columns) really scatter: their median magnitude over a Gaussian's. (...)

    1 where sigma is right; a sigma that is wrong by a factor shows as its inverse.
    """
    return np.asarray(np.median(np.abs(means), axis=(-2, -1)) / MEDIAN_SIGMAS, np.float64)


def window_statistics(
    means: NDArray[np.float32], *, reading: Reading = "signed", unit: float | NDArray[np.float64] = 1.0
) -> NDArray[np.float64]:
    """Mean, minimum and share below 0.675 of window means (..., rows, columns). (..., 3)

    The share is of magnitudes in either reading: signed errors below 0.675 would be three quarters of a good page, not
    the half that the number stands for. unit: what counts as one standard deviation, (...) or one for all; the paper's
    is 1. With a unit learned from good pages (``window_unit``) all three are unmoved by a sigma wrong by any one factor
    (paper, equation 4); with 1, the share is not.
    """
    scaled = means / np.asarray(unit, np.float64)[..., None, None]
    magnitude = np.abs(scaled)
    counted = scaled if reading == "signed" else magnitude
    place = (-2, -1)
    return np.stack(
        [counted.mean(axis=place), counted.min(axis=place), (magnitude < SHARE_SIGMAS).mean(axis=place)],
        axis=-1,
    )
