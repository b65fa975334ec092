"""All statistics of one scan against one prediction by which a detector of the paper, or a baseline, ranks pages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.detectors.paper.bayes import SHARE_SIGMAS
from prooflight.detectors.paper.chi_square import pearson
from prooflight.detectors.paper.evidence import gather, interval_shares
from prooflight_studies.harness.baselines import BASELINES, all_scores

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.prediction.predict import Prediction
    from prooflight_studies.harness.baselines import VariationModel
    from prooflight_studies.harness.result_cache import Rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """Windows into which an error map is divided."""

    side: int
    overlapping: bool = False

    def __str__(self) -> str:
        return f"{self.side} x {self.side}" + (", overlapping" if self.overlapping else "")


WINDOWS: Final = (
    Windows(side=4),
    Windows(side=8),
    Windows(side=16),
    Windows(side=32),
    Windows(side=8, overlapping=True),
)
UNITS: Final = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Units of the share's limit, which is 0.675 of these; the paper uses 1. Good prints that scatter more need another."""
MEAN, MINIMUM, MEAN_OF_MAGNITUDES, LEAST_MAGNITUDE, FIRST_SHARE = range(5)
"""Indices of the statistics of one set of windows; the shares follow, one for each unit."""


def window_numbers(z: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return all readings of the paper's three statistics of z (sensors, lines, pixels): (sensors, cuts, numbers).

    ``detectors.paper.bayes.window_statistics`` defines them; here all are computed in one pass.
    """
    numbers = np.empty((len(z), len(WINDOWS), FIRST_SHARE + len(UNITS)), np.float32)
    for cut, windows in enumerate(WINDOWS):
        means = window_means(z, side=windows.side, overlapping=windows.overlapping)
        numbers_of(means, [SHARE_SIGMAS * unit for unit in UNITS], out=numbers[:, cut])
    return numbers


def numbers_of(
    means: NDArray[np.float32], limits: Sequence[float | NDArray[np.float64]], *, out: NDArray[np.floating]
) -> None:
    """Write the statistics of window means (sensors, rows, columns) into out (sensors, numbers).

    limits: of the shares.
    """
    place, magnitude = (-2, -1), np.abs(means)
    out[:, MEAN], out[:, MINIMUM] = means.mean(place, np.float64), means.min(place)
    out[:, MEAN_OF_MAGNITUDES] = magnitude.mean(place, np.float64)
    out[:, LEAST_MAGNITUDE] = magnitude.min(place)
    for step, limit in enumerate(limits):
        out[:, FIRST_SHARE + step] = (magnitude < limit).mean(place)


def measure(
    measured_dn: NDArray[np.uint16],
    seen: Prediction,
    *,
    top_codes_dn: Sequence[int],
    white_dn: Sequence[float],
    variation: VariationModel | None,
    seed: int,
) -> Rows:
    """Return the row of one scan; arrays cover the page's area. With no variation model, the baselines are NaN."""
    evidence = gather(
        measured_dn,
        seen.expected_dn,
        seen.variance_dn2,
        top_codes_dn=top_codes_dn,
        seed=seed,
        threads=1,
        naive=True,
    )
    shares = interval_shares()
    z = normalised_error(measured_dn, seen.expected_dn, seen.variance_dn2)
    row = {
        "windows": window_numbers(z),
        "chi_square": pearson(evidence.histogram, shares),
        "chi_square_naive": pearson(evidence.naive_histogram, shares),
        "chi_square_tile": pearson(evidence.tile_histogram, shares).max(axis=(1, 2)),
    }
    if variation is None:
        return row | {"peers": np.full(len(BASELINES), np.nan)}
    arrays = (measured_dn, seen.expected_dn, seen.variance_dn2)
    return row | {"peers": all_scores(*arrays, variation=variation, white_dn=white_dn)}


# --- the error map (paper, equation 2) and the means over its windows ---


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
