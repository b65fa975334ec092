"""The compact form against the float form: every error within what its definition allows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.prediction.compact import MOST, MOST_BITS, Scale, compact


def compacted(expected: np.ndarray, variance: np.ndarray, top: int) -> tuple[np.ndarray, np.ndarray, Scale]:
    """Mean, inverse and scale of one sensor's (lines, pixels)."""
    scale = Scale.of(top_code_dn=top, least_variance_dn2=float(variance.min()))
    return *compact(expected.astype(np.float32), variance.astype(np.float32), scale), scale


@given(st.integers(8, 16), st.floats(0.01, 3000), st.integers(0, 2**31))
def test_every_error_is_within_the_definitions(bits: int, least_variance: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    top, shape = 2**bits - 1, (10, 70)
    expected = rng.uniform(0, top, shape).astype(np.float32)
    expected[0, :2] = 0, top
    variance = np.float32(max(least_variance, 1 / 12)) * (1 + rng.exponential(5, shape)).astype(np.float32)
    mean, inverse, scale = compacted(expected, variance, top)
    lsb = 2.0**-scale.mean_bits
    assert np.abs(mean * lsb - expected.astype(float)).max() <= lsb * (1 + 1e-4)
    below = expected.astype(float) / lsb % 1
    sigma = np.sqrt(variance + below * (1 - below) * lsb**2)
    wanted = 2.0**scale.inverse_bits / sigma
    assert (np.abs(inverse - wanted) <= 1 + 4e-7 * wanted)[wanted < MOST].all()
    assert inverse.max() <= MOST


@pytest.mark.parametrize(("bits", "least_sigma"), [(8, 0.3), (10, 0.6), (12, 1.2), (12, 8), (14, 3), (16, 8)])
def test_scales_use_their_words_and_never_overflow_them(bits: int, least_sigma: float) -> None:
    scale = Scale.of(top_code_dn=2**bits - 1, least_variance_dn2=least_sigma**2)
    assert scale.mean_bits == 16 - bits
    assert 2**scale.inverse_bits / least_sigma <= MOST
    fullest = 2 * 2**scale.inverse_bits / least_sigma > MOST - 1
    assert fullest or scale.mean_bits + scale.inverse_bits == MOST_BITS
    assert scale.inverse_bits >= 14


def test_nobody_is_surer_than_rounding() -> None:
    assert Scale.of(top_code_dn=4095, least_variance_dn2=0.0).inverse_bits == 14


@pytest.mark.parametrize("level", [2856.3, 100.03, 7.5])
def test_no_place_of_a_flat_tint_is_off_by_a_rounding(level: float) -> None:
    flat = np.full((400, 400), level)
    mean, inverse, scale = compacted(flat, np.full_like(flat, 64.0), 4095)
    error = mean - np.float32(level).astype(float) * 16
    blocks = error.reshape(50, 8, 50, 8).mean(axis=(1, 3))
    assert np.abs(blocks).max() < 0.25
    assert np.abs(error.mean(axis=0)).max() < 0.02
    assert np.abs(error.mean(axis=1)).max() < 0.02
    relative = inverse / 2.0**scale.inverse_bits * 8 - 1
    assert abs(relative.mean()) < 1e-5  # of 1/256 DN^2 at most in 64: what the mean's rounding adds


@pytest.mark.parametrize("sigma", [1.0, 8.0, 30.0])
def test_added_error_of_z_is_small_against_1(sigma: float) -> None:
    rng = np.random.default_rng(1)
    expected = rng.uniform(100, 3900, (200, 300)).astype(np.float32)
    variance = np.full(expected.shape, sigma**2 + 1 / 12, np.float32)
    mean, inverse, scale = compacted(expected, variance, 4095)
    measured = np.rint(expected + sigma * rng.standard_normal(expected.shape)).clip(0, 4095)
    z = (measured - expected) / np.sqrt(variance)
    fixed = (measured - mean / 16) * inverse / 2.0**scale.inverse_bits
    added = fixed - z
    assert abs(added.mean()) < 3e-4  # the even pattern leaves no mean error
    assert (
        added.std() < 0.029 / sigma + 2e-3
    )  # 1/16 DN rounded up or down at random: rms 1/16/sqrt(6) = 0.026 DN


def test_bands_join_without_a_seam() -> None:
    rng = np.random.default_rng(2)
    expected = rng.uniform(0, 4095, (90, 50)).astype(np.float32)
    variance = rng.uniform(1, 900, (90, 50)).astype(np.float32)
    scale = Scale.of(top_code_dn=4095, least_variance_dn2=1.0)
    whole = compact(expected, variance, scale)
    top = compact(expected[:33], variance[:33], scale)
    rest = compact(expected[33:], variance[33:], scale, first_line=33)
    for code, above, below in zip(whole, top, rest, strict=True):
        np.testing.assert_array_equal(code, np.concatenate([above, below]))
