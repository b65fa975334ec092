"""All statistics of one scan against one prediction by which a detector of the paper, or a baseline, ranks pages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.paper.bayes import SHARE_SIGMAS
from prooflight.detectors.paper.chi_square import pearson
from prooflight.detectors.paper.evidence import gather, interval_shares
from prooflight_studies.harness.baselines import BASELINES, all_scores
from prooflight_studies.harness.error_map import normalised_error, window_means

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
