"""What must hold of the weights that raster pixels get in camera pixels, whatever the two pitches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import special

from prooflight.pages.sampling import Taps, taps, transfer

PITCHES_MM = st.floats(0.01, 0.5)
CENTRES_MM = st.lists(st.floats(-8, 30), min_size=1, max_size=12).map(np.array)


def box_and_blur(width_mm: float, sigma_mm: float) -> tuple[float, np.ndarray]:
    """A square aperture blurred by a Gaussian: reach and cumulative spread."""
    reach = width_mm / 2 + 4 * sigma_mm
    x = np.linspace(-reach, reach, 1025)
    if sigma_mm == 0:
        return reach, np.clip(x / width_mm + 0.5, 0, 1)

    def integral(u: np.ndarray) -> np.ndarray:  # of the normal distribution function
        return u * special.ndtr(u) + np.exp(-u * u / 2) / np.sqrt(2 * np.pi)

    half = width_mm / 2
    value = sigma_mm / width_mm * (integral((x + half) / sigma_mm) - integral((x - half) / sigma_mm))
    return reach, (value - value[0]) / (value[-1] - value[0])


def of(
    centres_mm: np.ndarray, raster_mm: float, count: int, *, width_mm: float = 0.1, sigma_mm: float = 0.03
) -> Taps:
    reach, cumulative = box_and_blur(width_mm, sigma_mm)
    return taps(
        cumulative, reach_mm=reach, centres_mm=centres_mm, raster_pixel_mm=raster_mm, raster_pixels=count
    )


def as_matrix(weights: Taps, count: int) -> np.ndarray:
    matrix = np.zeros((weights.first.size, count))
    for row, (first, row_weights) in enumerate(zip(weights.first, weights.weights, strict=True)):
        matrix[row, first : first + row_weights.size] = row_weights
    return matrix


@given(centres=CENTRES_MM, raster_mm=PITCHES_MM, count=st.integers(1, 400))
def test_weights_are_shares_of_light(centres: np.ndarray, raster_mm: float, count: int) -> None:
    weights = of(centres, raster_mm, count)
    assert weights.weights.dtype == np.float32
    assert (weights.weights >= 0).all()
    assert (weights.first >= 0).all()
    assert (weights.first + weights.weights.shape[1] <= count).all()
    assert (weights.weights.sum(axis=1) <= 1 + 1e-5).all()
    reach, _ = box_and_blur(0.1, 0.03)
    inside = (centres >= reach) & (centres <= count * raster_mm - reach)
    np.testing.assert_allclose(weights.weights.sum(axis=1)[inside], 1, atol=1e-5)
    off = (centres <= -reach) | (centres >= count * raster_mm + reach)
    np.testing.assert_allclose(weights.weights.sum(axis=1)[off], 0, atol=1e-6)


@given(centres=CENTRES_MM, raster_mm=PITCHES_MM, count=st.integers(1, 60))
def test_every_weight_is_the_integral_of_the_footprint_over_its_raster_pixel(
    centres: np.ndarray, raster_mm: float, count: int
) -> None:
    reach, cumulative = box_and_blur(0.1, 0.03)
    offsets = np.linspace(-reach, reach, cumulative.size)
    edges = np.arange(count + 1) * raster_mm
    want = np.diff(np.interp(edges - centres[:, None], offsets, cumulative), axis=1)
    np.testing.assert_allclose(as_matrix(of(centres, raster_mm, count), count), want, atol=1e-6)


@given(centres=CENTRES_MM, raster_mm=PITCHES_MM, count=st.integers(1, 60), seed=st.integers(0, 99))
def test_apply_is_the_matrix_product(centres: np.ndarray, raster_mm: float, count: int, seed: int) -> None:
    image = np.random.default_rng(seed).random((count, 3)).astype(np.float32)
    weights = of(centres, raster_mm, count)
    got = weights.apply(image)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, as_matrix(weights, count) @ image, atol=1e-5)


@given(centre=st.floats(0.5, 9.5), ratio=st.integers(1, 8), slope=st.floats(-5, 5), level=st.floats(-5, 5))
def test_straight_ramps_come_out_exactly_where_raster_pixels_fill_the_aperture(
    centre: float, ratio: int, slope: float, level: float
) -> None:
    # a raster pixel holds the ramp's mean; whole raster pixels in the aperture cancel the stairs
    raster_mm = 0.1 / ratio
    count = round(10 / raster_mm)
    ramp = level + slope * (np.arange(count) + 0.5) * raster_mm
    got = of(np.array([centre]), raster_mm, count).apply(ramp.astype(np.float32)[:, None])[0, 0]
    assert got == pytest.approx(level + slope * centre, abs=2e-5 * (abs(level) + 10 * abs(slope)) + 1e-6)


@given(centre=st.floats(1.5, 8.5), raster_mm=st.floats(0.01, 0.5))
def test_at_any_ratio_a_ramp_is_off_by_less_than_half_a_raster_pixel(centre: float, raster_mm: float) -> None:
    count = int(np.ceil(10 / raster_mm))
    ramp = (np.arange(count) + 0.5) * raster_mm
    got = of(np.array([centre]), raster_mm, count).apply(ramp.astype(np.float32)[:, None])[0, 0]
    assert abs(got - centre) <= raster_mm / 2 + 1e-5


@given(centre=st.floats(1, 3), raster_mm=st.floats(0.02, 0.3), steps=st.integers(1, 20))
def test_moving_by_whole_raster_pixels_moves_the_window_and_nothing_else(
    centre: float, raster_mm: float, steps: int
) -> None:
    count = 700
    here = as_matrix(of(np.array([centre]), raster_mm, count), count)[0]
    there = as_matrix(of(np.array([centre + steps * raster_mm]), raster_mm, count), count)[0]
    np.testing.assert_allclose(there[steps:], here[:-steps], atol=1e-5)


@given(raster_mm=st.floats(0.02, 0.4), side=st.sampled_from([0, 1]))
def test_at_the_pages_edge_half_is_backing_and_coverage_rises_inwards(raster_mm: float, side: int) -> None:
    count = 200
    edge = side * count * raster_mm
    inwards = 1 - 2 * side
    centres = edge + inwards * np.linspace(-0.3, 0.3, 13)
    coverage = of(centres, raster_mm, count).weights.sum(axis=1)
    assert (np.diff(coverage) >= -1e-6).all()
    assert coverage[6] == pytest.approx(0.5, abs=1e-5)
    assert coverage[0] == pytest.approx(0, abs=1e-6)
    assert coverage[-1] == pytest.approx(1, abs=1e-5)


@given(raster_mm=PITCHES_MM, page_mm=st.floats(0.02, 0.3))
def test_a_page_smaller_than_one_footprint_keeps_its_share(raster_mm: float, page_mm: float) -> None:
    count = max(int(page_mm / raster_mm), 1)
    assume(count * raster_mm < 2)
    reach, cumulative = box_and_blur(0.1, 0.03)
    weights = of(np.array([count * raster_mm / 2]), raster_mm, count)
    offsets = np.linspace(-reach, reach, cumulative.size)
    half = count * raster_mm / 2
    want = np.interp(half, offsets, cumulative) - np.interp(-half, offsets, cumulative)
    assert weights.weights.sum(axis=1)[0] == pytest.approx(want, abs=1e-5)


@pytest.mark.parametrize("ratio", [0.25, 0.7, 1.0, 2.0, 3.3])
def test_light_is_conserved(ratio: float) -> None:
    """Camera pixels that tile the page share every raster pixel's light out in full."""
    reach, cumulative = box_and_blur(0.1, 0.03)
    centres = np.linspace(-0.95, 20.95, 220)
    count = round(20 / (0.1 / ratio))
    weights = taps(
        cumulative, reach_mm=reach, centres_mm=centres, raster_pixel_mm=20 / count, raster_pixels=count
    )
    seen = as_matrix(weights, count).sum(axis=0) * 0.1 / (20 / count)
    np.testing.assert_allclose(seen, 1, atol=1e-4)  # a raster pixel's light, in its own area


def test_transfer_of_a_box_is_a_sinc() -> None:
    box = np.interp(np.linspace(-2, 2, 401), [-0.5, 0.5], [0.0, 1.0])
    frequency = np.array([0.0, 0.3, 0.9])
    np.testing.assert_allclose(transfer(box, 2.0, frequency), np.sinc(frequency), atol=1e-4)
