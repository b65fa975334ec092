"""Planes far out of register are found with their share, by correlations that equal the sums they stand for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from prooflight.detectors.matched_filter.statistics.local_evidence import DOUBT, plane_shifts

LINES, PIXELS = 90, 70
PIXEL_MM = 0.25


def drawn(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Planes of four inks on two sensors, white at the margins, and weights."""
    rng = np.random.default_rng(seed)
    blobs = ndimage.gaussian_filter(rng.standard_normal((4, LINES, PIXELS)), (0, 3, 3)) > 0.05
    blobs[:, :12], blobs[:, -12:], blobs[:, :, :12], blobs[:, :, -12:] = False, False, False, False
    strength = rng.uniform(50, 150, (2, 4))[:, :, None, None]
    return (strength * blobs).astype(np.float32), rng.uniform(0.05, 0.2, (2, LINES, PIXELS)).astype(
        np.float32
    )


def test_a_plane_printed_elsewhere_is_found_and_the_others_are_not() -> None:
    gain, weight = drawn(1)
    moved = np.roll(gain[:, 1], (4, -2), (1, 2))  # 1.1 mm
    noise = np.random.default_rng(2).standard_normal(weight.shape) / np.sqrt(weight)
    found = plane_shifts((moved - gain[:, 1] + noise).astype(np.float32), weight, gain, pixel_mm=PIXEL_MM)
    sure, share = found[:, :2].T
    assert found[1, 2:] == pytest.approx([-0.5, 1.0])  # right, down
    assert sure.argmax() == share.argmax() == 1
    assert share[1] == pytest.approx(1, abs=0.02)
    assert sure[1] == pytest.approx(1 / DOUBT, rel=0.05)  # as sure as one can be
    still = plane_shifts(noise.astype(np.float32), weight, gain, pixel_mm=PIXEL_MM)
    # the greatest of 200 lags of unit variance, correlated: below 4 but once in a hundred
    assert (still[:, 0] < 4).all()
    assert (still[:, 1] < 0.02).all()


def test_correlations_are_the_sums_they_stand_for() -> None:
    gain, weight = drawn(3)
    left = np.random.default_rng(4).normal(0, 3, weight.shape).astype(np.float32)
    pixel_mm = 0.5  # a pixel is a cell
    best = np.zeros((4, 2))
    for ink in range(4):
        for dy in range(-4, 5):
            for dx in range(-4, 5):
                if not 0.2 <= 0.5 * np.hypot(dy, dx) <= 2:
                    continue
                change = np.roll(gain[:, ink], (dy, dx), (1, 2)) - gain[:, ink]
                push, power = (weight * left * change).sum(), (weight * change**2).sum()
                best[ink, 0] = max(best[ink, 0], push / np.sqrt(power + (DOUBT * power) ** 2 + 1))
                best[ink, 1] = max(best[ink, 1], push / (power + 1 / DOUBT**2))
    # single precision of sums of 10^4 terms
    np.testing.assert_allclose(
        plane_shifts(left, weight, gain, pixel_mm=pixel_mm)[:, :2], best, rtol=2e-3, atol=2e-3
    )
