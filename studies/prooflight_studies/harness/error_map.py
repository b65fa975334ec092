"""The whole error map (paper, equation 2) and the means over its windows, as the paper's own detectors use them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def normalised_error(
    measured_dn: NDArray[np.uint16],
    expected_dn: NDArray[np.float32],
    variance_dn2: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return Z = (measured - expected) / sigma (paper, equation 2).

    All arrays are (..., lines, pixels). The tables guarantee variance_dn2 > 0, so that it is not checked again. Inputs
    are not changed.
    """
    error: NDArray[np.float32] = measured_dn.astype(np.float32) - expected_dn
    error /= np.sqrt(variance_dn2)
    return error


def window_means(z: NDArray[np.float32], *, side: int, overlapping: bool = False) -> NDArray[np.float32]:
    """Return the means of z over side x side windows, times side: N(0, 1) on a good page.

    z is (..., lines, pixels). Separate windows start at the first line and pixel, and the remainder is dropped: (...,
    lines // side, pixels // side). Overlapping windows start at every pixel: (..., lines - side + 1, pixels - side +
    1). Raises ValueError if not a single window fits.
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
    """Return the sums over the windows that lie wholly inside; OpenCV's anchor is the window's first pixel here."""
    whole = np.ascontiguousarray(plane, np.float32)
    sums = cv2.boxFilter(
        whole, -1, (side, side), anchor=(0, 0), normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    return np.asarray(sums[: plane.shape[0] - side + 1, : plane.shape[1] - side + 1], np.float32)
