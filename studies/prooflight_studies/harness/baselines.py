"""Common ways to compare a scan with the expected signal: differences, structural similarity, a variation model.

All functions take (sensors, lines, pixels) arrays and change none of them. Whether a baseline is raw or registered
depends on the expected signal that it is given: that of a page at its nominal position, or at the position that
registration reports.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import cv2
import numpy as np
from scipy import linalg, optimize

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

BOX_PIXELS: Final = 5
HIGH_PERCENTILE: Final = 99.5
SSIM_SIGMA_PIXELS: Final = 1.5
SSIM_RADIUS_PIXELS: Final = 5
SSIM_K1, SSIM_K2 = 0.01, 0.03
"""Window and constants of Wang, Bovik, Sheikh and Simoncelli 2004, section III-B."""
EDGE_TOLERANCE_PIXELS: Final = 1
LEAST_PIXELS: Final = 4
"""assumed: fewer pixels outside the variation model are a speck or noise; users of such models filter by area."""
LEARNING_PIXELS: Final = 40_000
"""Number of pixels drawn from each good copy and sensor to learn the variation from."""
BASELINES: Final = (
    "difference, 5 x 5",
    "difference, mean",
    "difference, 99.5 %",
    "SSIM, mean",
    "SSIM, worst",
    "variation model",
)
"""Names of the baselines, in the order of ``all_scores``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Absolute difference of measured and expected signals as a share of paper white, for the worst sensor."""

    local: float
    """Greatest mean over 5 x 5 pixels. [-]"""
    mean: float
    high: float
    """99.5th percentile of the differences. [-]"""


def absolute_difference(
    measured_dn: NDArray[np.uint16], expected_dn: NDArray[np.float32], *, white_dn: Sequence[float]
) -> Difference:
    """Return the differences of one scan; white_dn: signal of bare paper of each sensor."""
    by_sensor = []
    for measured, expected, white in zip(measured_dn, expected_dn, white_dn, strict=True):
        share = cv2.absdiff(measured.astype(np.float32), expected) / np.float32(white)
        local = cv2.boxFilter(share, -1, (BOX_PIXELS, BOX_PIXELS)).max()
        rank = int(share.size * HIGH_PERCENTILE / 100)
        by_sensor.append((float(local), float(share.mean()), float(np.partition(share.ravel(), rank)[rank])))
    local, mean, high = np.max(by_sensor, axis=0).tolist()
    return Difference(local=local, mean=mean, high=high)


@dataclass(frozen=True, slots=True, kw_only=True)
class Dissimilarity:
    """One minus structural similarity; the worst sensor's, higher is worse."""

    mean: float
    worst: float
    """Value at the position where the two images are least alike. [-]"""


def dissimilarity(
    measured_dn: NDArray[np.uint16], expected_dn: NDArray[np.float32], *, white_dn: Sequence[float]
) -> Dissimilarity:
    """Return 1 - SSIM over Gaussian windows of 11 x 11 pixels that lie wholly inside; dynamic range: paper white."""
    by_sensor = []
    for measured, expected, white in zip(measured_dn, expected_dn, white_dn, strict=True):
        similar = _similarity(measured.astype(np.float32), expected, white)
        by_sensor.append((1 - float(similar.mean(dtype=np.float64)), 1 - float(similar.min())))
    mean, worst = np.max(by_sensor, axis=0).tolist()
    return Dissimilarity(mean=mean, worst=worst)


def _similarity(a: NDArray[np.float32], b: NDArray[np.float32], white: float) -> NDArray[np.float32]:
    """Return the SSIM map of two images (Wang et al. 2004, equation 13), borders cut off."""
    a, b = (
        a / np.float32(white) - np.float32(0.5),
        b / np.float32(white) - np.float32(0.5),
    )  # float32 needs it small
    mean_a, mean_b = _blurred(a), _blurred(b)
    var_a, var_b = _blurred(a * a) - mean_a**2, _blurred(b * b) - mean_b**2
    covariance = _blurred(a * b) - mean_a * mean_b
    mean_a, mean_b = mean_a + np.float32(0.5), mean_b + np.float32(0.5)
    c1, c2 = np.float32(SSIM_K1**2), np.float32(SSIM_K2**2)
    similar = (2 * mean_a * mean_b + c1) * (2 * covariance + c2)
    similar /= (mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2)
    inside = slice(SSIM_RADIUS_PIXELS, -SSIM_RADIUS_PIXELS)
    return np.asarray(similar[inside, inside], np.float32)


def _blurred(image: NDArray[np.float32]) -> NDArray[np.float32]:
    side = 2 * SSIM_RADIUS_PIXELS + 1
    return np.asarray(cv2.GaussianBlur(image, (side, side), SSIM_SIGMA_PIXELS), np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class VariationModel:
    """Mean +- k sigma with an edge tolerance, as the variation models of machine vision; for pages of a run of one.

    The mean is the expected signal, since there is no golden copy. The variation of good copies is learned from those
    of other pages: variance = sensor noise + (floor x white)^2 + (edge x local range)^2 + (signal x expected)^2. Of a
    pixel only its distance from the range of expected signals within one pixel counts.
    """

    floor: float
    """Standard deviation on uniform areas, as a share of paper white. [-]"""
    edge: float
    """Standard deviation as a share of the range of expected signals over 3 x 3 pixels. [-]"""
    signal: float
    """Standard deviation as a share of the expected signal. [-]"""

    @classmethod
    def learn(cls, moments: Sequence[NDArray[np.float64]]) -> Self:
        """Fit the model to the ``variation_moments`` of good copies by least squares without negative variances."""
        total = np.sum(moments, axis=0)
        gram, right = total[:3, :3], total[:3, 3]
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        upper = linalg.cholesky(gram / np.outer(scale, scale) + 1e-9 * np.eye(3))
        # |U x - U^-T b| is the same least squares as that of all pixels
        target = linalg.solve_triangular(upper, right / scale, trans="T")
        solution = optimize.nnls(upper, target)[0] / scale
        floor, edge, signal = np.sqrt(solution).tolist()
        return cls(floor=floor, edge=edge, signal=signal)

    def score(
        self,
        measured_dn: NDArray[np.uint16],
        expected_dn: NDArray[np.float32],
        variance_dn2: NDArray[np.float32],
        *,
        white_dn: Sequence[float],
    ) -> float:
        """Return the greatest k at which at least 4 pixels of a sensor still lie outside; higher is worse. [-]"""
        worst = 0.0
        for planes, white in zip(
            zip(measured_dn, expected_dn, variance_dn2, strict=True), white_dn, strict=True
        ):
            outside, local_range = _outside(planes[0], planes[1])
            variance = planes[2] + np.float32((self.floor * white) ** 2)
            variance += (
                np.float32(self.edge**2) * local_range**2 + np.float32(self.signal**2) * planes[1] ** 2
            )
            squared = outside**2 / variance
            far = squared[squared > 0]  # most are 0, and partitioning equal values is slow
            if far.size >= LEAST_PIXELS:
                worst = max(worst, float(np.sqrt(np.partition(far, -LEAST_PIXELS)[-LEAST_PIXELS])))
        return worst


def variation_moments(
    measured_dn: NDArray[np.uint16],
    expected_dn: NDArray[np.float32],
    variance_dn2: NDArray[np.float32],
    *,
    white_dn: Sequence[float],
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Return one good copy's contribution to the fit of a ``VariationModel``, (4, 4).

    It has the products of the model's three terms, and theirs with the excess.
    """
    total = np.zeros((4, 4))
    for measured, expected, variance, white in zip(
        measured_dn, expected_dn, variance_dn2, white_dn, strict=True
    ):
        outside, local_range = _outside(measured, expected)
        drawn = rng.integers(expected.size, size=min(LEARNING_PIXELS, expected.size))
        seen, width, noise, far = (
            plane.ravel()[drawn].astype(np.float64) / white
            for plane in (expected, local_range, np.sqrt(variance), outside)
        )
        columns = np.stack([np.ones_like(seen), width**2, seen**2, far**2 - noise**2], axis=1)
        # assumed weights: about the spread that squares have where print is good, so that edges do not decide all
        columns /= (noise**2 + 0.02 * width**2 + (0.015 * seen) ** 2)[:, None]
        total += columns.T @ columns
    return total


def _outside(
    measured_dn: NDArray[np.uint16], expected_dn: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return each pixel's distance from the expected signals within one pixel, and the width of their range. [DN]"""
    kernel = np.ones((2 * EDGE_TOLERANCE_PIXELS + 1,) * 2, np.uint8)
    low, high = cv2.erode(expected_dn, kernel), cv2.dilate(expected_dn, kernel)
    measured = measured_dn.astype(np.float32)
    outside = np.maximum(np.maximum(low - measured, measured - high), 0)
    return np.asarray(outside, np.float32), np.asarray(high - low, np.float32)


def all_scores(
    measured_dn: NDArray[np.uint16],
    expected_dn: NDArray[np.float32],
    variance_dn2: NDArray[np.float32],
    *,
    variation: VariationModel,
    white_dn: Sequence[float],
) -> NDArray[np.float64]:
    """Return every baseline's score of one scan, in the order of ``BASELINES``. (6,)"""
    difference = absolute_difference(measured_dn, expected_dn, white_dn=white_dn)
    unlike = dissimilarity(measured_dn, expected_dn, white_dn=white_dn)
    far = variation.score(measured_dn, expected_dn, variance_dn2, white_dn=white_dn)
    return np.array([difference.local, difference.mean, difference.high, unlike.mean, unlike.worst, far])
