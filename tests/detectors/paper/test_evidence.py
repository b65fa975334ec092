"""One pass over a scan against plain NumPy, and what its statistics do on scans that are as predicted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special, stats

from prooflight.detectors.base import BLOCK_PIXELS
from prooflight.detectors.paper.chi_square import pearson, tile_statistics
from prooflight.detectors.paper.evidence import (
    CODE_STEPS,
    INTERVALS,
    TILE_PIXELS,
    Evidence,
    compare,
    gather,
    interval_edges,
    interval_shares,
    join,
    parts,
)
from prooflight.prediction.compact import Scale, compact

TOP = 4095
EXTREME = 1e-4
"""A p-value nearer to 0 or 1 than this fails; 12 of them fail once in 400 sets of seeds, and these are fixed."""


def scan_of(
    expected: np.ndarray, sigma: np.ndarray | float, seed: int, *, top: int = TOP
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured as predicted: Gaussian, rounded and clipped; expected; variance with rounding's 1/12."""
    rng = np.random.default_rng(seed)
    drawn = expected + sigma * rng.standard_normal(expected.shape)
    measured = np.clip(np.floor(drawn + 0.5), 0, top).astype(np.uint16)
    variance = np.broadcast_to(np.float64(sigma) ** 2 + 1 / 12, expected.shape)
    return measured, expected.astype(np.float32), variance.astype(np.float32)


def gathered(
    images: tuple[np.ndarray, np.ndarray, np.ndarray], *, seed: int = 1, threads: int = 1, top: int = TOP
) -> Evidence:
    measured, expected, variance = images
    return gather(
        measured,
        expected,
        variance,
        top_codes_dn=[top] * len(measured),
        seed=seed,
        threads=threads,
        naive=True,
    )


def page_p_value(evidence: Evidence) -> float:
    """Of the first sensor's histogram."""
    return float(stats.chi2.sf(pearson(evidence.histogram, interval_shares())[0], INTERVALS - 1))


def histogram_law(
    measured: np.ndarray, expected: np.ndarray, variance: np.ndarray, top: int
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of the histogram's counts over the random numbers of the integral transform."""
    sigma = np.sqrt(variance.astype(float) - 1 / 12).ravel()
    error = (measured - expected.astype(float)).ravel()
    low = np.where(measured.ravel() == 0, 0, special.ndtr((error - 0.5) / sigma))
    high = np.where(measured.ravel() >= top, 1, special.ndtr((error + 0.5) / sigma))
    edges = np.concatenate([[0], special.ndtr(interval_edges() / CODE_STEPS), [1]])
    overlap = np.minimum(high[:, None], edges[1:]) - np.maximum(low[:, None], edges[:-1])
    share = np.clip(overlap, 0, None) / np.maximum(high - low, 1e-300)[:, None]
    return share.sum(axis=0), (share * (1 - share)).sum(axis=0)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("off", [0.0, 0.7])  # as predicted, and a page that is not
def test_the_histogram_is_the_randomised_integral_transform(seed: int, off: float) -> None:
    rng = np.random.default_rng(seed)
    expected = rng.uniform(0, 400, (1, 150, 200))
    sigma = rng.uniform(1, 30, expected.shape)
    measured, predicted, variance = scan_of(expected, sigma, seed + 10, top=380)
    predicted = predicted + np.float32(off) * sigma.astype(np.float32)
    got = gathered((measured, predicted, variance), top=380, seed=seed).histogram[0]
    mean, spread = histogram_law(measured, predicted, variance, 380)
    assert np.abs((got - mean) / np.sqrt(spread)).max() < 4.5  # of 32 normal deviates; P = 2e-4


@pytest.mark.parametrize("shape", [(1, 64, 80), (2, 67, 85), (1, 300, 40)])
def test_block_z_is_the_mean_over_8_by_8_pixels_times_8(shape: tuple[int, int, int]) -> None:
    rng = np.random.default_rng(5)
    images = scan_of(rng.uniform(20, 3000, shape), rng.uniform(0.6, 30, shape), 5)
    measured, expected, variance = images
    z = (measured.astype(float) - expected) / np.sqrt(variance)  # the paper's equation 2
    rows, columns = shape[1] // 8, shape[2] // 8
    blocks = z[:, : rows * 8, : columns * 8].reshape(shape[0], rows, 8, columns, 8)
    got = gathered(images, threads=3).block_z
    assert got.shape == (shape[0], rows, columns)
    # 64 roundings of z to 128ths, and of the compact prediction's mean to 16ths of a sigma of 0.6 DN at worst
    np.testing.assert_allclose(got, blocks.mean(axis=(2, 4)) * 8, atol=0.12)
    assert np.abs(got - blocks.mean(axis=(2, 4)) * 8).mean() < 0.01


def test_a_deviating_pixel_shows_in_its_own_block_with_its_sign() -> None:
    flat = np.full((1, 40, 48), 100.0)
    images = scan_of(flat, 1e-3, 1)
    images[0][0, 17, 30] += 20  # lighter
    block_z = gathered((images[0], images[1], np.ones_like(images[2]))).block_z[0]
    assert block_z[2, 3] == pytest.approx(20 / 8, rel=1e-3)
    block_z[2, 3] = 0
    assert np.abs(block_z).max() == 0


@pytest.mark.parametrize(("lines", "pixels"), [(64, 64), (150, 200), (255, 127), (30, 500), (7, 5)])
def test_tiles_cut_the_page_into_squares_and_the_last_ones_take_the_rest(lines: int, pixels: int) -> None:
    rng = np.random.default_rng(5)
    images = scan_of(rng.uniform(20, 3000, (2, lines, pixels)), 3.0, 5)
    whole = gathered(images, threads=3)
    rows, columns = max(lines // TILE_PIXELS, 1), max(pixels // TILE_PIXELS, 1)
    assert whole.tile_histogram.shape == (2, rows, columns, INTERVALS)
    down = [*range(0, rows * TILE_PIXELS, TILE_PIXELS), lines]
    right = [*range(0, columns * TILE_PIXELS, TILE_PIXELS), pixels]
    areas = np.outer(np.diff(down), np.diff(right))
    np.testing.assert_array_equal(whole.tile_histogram.sum(axis=-1), [areas, areas])
    np.testing.assert_array_equal(whole.histogram, whole.tile_histogram.sum(axis=(1, 2)))


def test_a_deviation_shows_in_its_own_tile() -> None:
    measured, expected, variance = scan_of(np.full((1, 256, 320), 900.0), 3.0, 8)
    before = gathered((measured, expected, variance)).tile_histogram
    changed = measured.copy()
    changed[0, 70:90, 200:220] += 9
    after = gathered((changed, expected, variance)).tile_histogram
    assert (before[0, 1, 3] != after[0, 1, 3]).any()
    after[0, 1, 3] = before[0, 1, 3]
    np.testing.assert_array_equal(after, before)


@given(
    sensors=st.integers(1, 3),
    lines=st.integers(1, 300),
    pixels=st.integers(1, 60),
    seed=st.integers(0, 2**31),
)
def test_every_pixel_is_counted_once(sensors: int, lines: int, pixels: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (sensors, lines, pixels)
    measured = rng.integers(0, 4096, shape).astype(np.uint16)  # nothing like what was expected
    expected = rng.uniform(0, 4095, shape).astype(np.float32)
    variance = rng.uniform(0.09, 100, shape).astype(np.float32)
    got = gathered((measured, expected, variance), seed=seed, threads=2)
    assert (got.histogram.sum(axis=1) == lines * pixels).all()
    assert (got.naive_histogram.sum(axis=1) == lines * pixels).all()
    assert (got.histogram >= 0).all()
    assert got.histogram.shape == got.naive_histogram.shape == (sensors, INTERVALS)
    assert got.block_z.shape == (sensors, lines // BLOCK_PIXELS, pixels // BLOCK_PIXELS)
    assert np.isfinite(got.block_z).all()


def test_threads_do_not_change_a_bit_and_the_seed_changes_only_the_transform() -> None:
    rng = np.random.default_rng(2)
    images = scan_of(rng.uniform(20, 3000, (2, 500, 90)), 4.0, 2)
    one, four = (gathered(images, seed=7, threads=n) for n in (1, 4))
    other = gathered(images, seed=8)
    for statistic in (name for name in Evidence.__slots__):
        np.testing.assert_array_equal(getattr(one, statistic), getattr(four, statistic))
    assert (one.histogram != other.histogram).any()
    np.testing.assert_array_equal(one.naive_histogram, other.naive_histogram)
    np.testing.assert_array_equal(one.block_z, other.block_z)


def test_sensors_with_the_same_numbers_draw_different_uniforms() -> None:
    images = tuple(np.repeat(image, 2, axis=0) for image in scan_of(np.full((1, 80, 80), 99.3), 0.7, 3))
    got = gathered((images[0], images[1], images[2])).histogram
    assert (got[0] != got[1]).any()


@pytest.mark.parametrize("sigma", [0.6, 8.0])
@pytest.mark.parametrize("seed", range(1, 7))
def test_on_a_page_as_predicted_the_histogram_is_flat(sigma: float, seed: int) -> None:
    expected = np.random.default_rng(seed).uniform(100, 3000, (1, 256, 400))
    got = gathered(scan_of(expected, sigma, seed + 100), seed=seed)
    assert EXTREME < page_p_value(got) < 1 - EXTREME


@pytest.mark.parametrize("level", [0.2, 1.5, 4094.1])
def test_it_is_flat_where_the_converter_clips_as_well(level: float) -> None:
    got = gathered(scan_of(np.full((1, 256, 400), level), 2.0, 17), seed=3)
    assert EXTREME < page_p_value(got) < 1 - EXTREME


@pytest.mark.parametrize("sigma", [0.6, 8.0])
def test_on_flat_paper_the_naive_histogram_rejects_a_good_page(sigma: float) -> None:
    images = scan_of(np.full((1, 256, 400), 2856.3), sigma, 5)
    got = gathered(images)
    assert pearson(got.naive_histogram, interval_shares())[0] > 500  # 15 expected
    assert EXTREME < page_p_value(got) < 1 - EXTREME


@pytest.mark.parametrize("sigma_error", [0.97, 1.03])
def test_an_error_of_3_percent_in_sigma_shows(sigma_error: float) -> None:
    measured, expected, variance = scan_of(
        np.random.default_rng(1).uniform(100, 3000, (1, 256, 400)), 8.0 * sigma_error, 5
    )
    wrong = np.full_like(variance, 64 + 1 / 12)
    assert page_p_value(gathered((measured, expected, wrong))) < 1e-3


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_block_z_is_standard_normal_on_a_page_as_predicted(seed: int) -> None:
    expected = np.random.default_rng(seed).uniform(100, 3000, (1, 800, 800))
    block_z = gathered(scan_of(expected, 3.0, seed)).block_z.ravel()
    assert stats.kstest(block_z, "norm").pvalue > EXTREME
    assert block_z.mean() == pytest.approx(0, abs=4 / np.sqrt(block_z.size))
    assert block_z.var() == pytest.approx(1, abs=4 * np.sqrt(2 / block_z.size))


LEAST_P = 1e-4
CASES = [(sigma, 1000.3) for sigma in (0.5, 0.9, 1.0, 1.3, 2.0, 3.9, 4.1, 8.0, 30.0)] + [
    (1.0, 0.4),
    (2.0, 1.0),
    (8.0, 4093.0),
]


@pytest.mark.parametrize(("sigma", "level"), CASES)
def test_p_values_of_tiles_are_uniform_on_flat_tints_clipped_or_not(sigma: float, level: float) -> None:
    images = scan_of(np.full((1, 1024, 1024), level), sigma, 40)
    got = gather(*images, top_codes_dn=[TOP], seed=41, threads=1)
    p_values = stats.chi2.sf(tile_statistics(got).ravel(), INTERVALS - 1)
    # fixed seeds; each of 12 fails once in a thousand
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    assert p_values.min() > 1e-3 / p_values.size


def test_p_values_of_tiles_are_right_down_to_one_in_ten_thousand() -> None:
    """10,240 tiles with sigma from 1 to 30 DN and white at 8 DN, as pages have it: Poisson limits at 3.7 sigma."""
    rng = np.random.default_rng(50)
    p_values = []
    for seed in range(20):
        sigma = np.repeat(
            np.repeat(np.where(rng.random((64, 64)) < 0.5, 8.0, rng.uniform(1, 30, (64, 64))), 32, 0), 16, 1
        )
        level = 60 + 90 * sigma[None] + rng.uniform(0, 1, (1, 1, 1024))  # each column has its own gain
        got = gather(*scan_of(level[:, :2048], sigma, 60 + seed), top_codes_dn=[TOP], seed=seed, threads=1)
        p_values.append(stats.chi2.sf(tile_statistics(got).ravel(), INTERVALS - 1))
    found = np.concatenate(p_values)
    assert found.size == 10_240
    assert stats.kstest(found, "uniform").pvalue > 1e-3
    for level_ in (1e-1, 1e-2, 1e-3, LEAST_P):
        allowed = level_ * found.size
        assert abs((found < level_).sum() - allowed) < 3.7 * np.sqrt(allowed) + 1


@pytest.mark.parametrize("sigma", [1.2, 8.0])
def test_a_shift_of_a_quarter_of_a_sigma_shows_in_its_tile_alone(sigma: float) -> None:
    measured, expected, variance = scan_of(np.full((1, 256, 256), 900.0), sigma, 8)
    shifted = expected.copy()
    shifted[:, :64, :64] += np.float32(0.25 * sigma)
    p_values = stats.chi2.sf(tile_statistics(gathered((measured, shifted, variance))), INTERVALS - 1)
    assert p_values[0, 0] < 1e-10
    assert p_values.ravel()[1:].min() > EXTREME


def test_parts_join_into_what_the_page_gives_in_one_piece() -> None:
    lines, pixels = 1300, 1700
    assert len(parts(lines, pixels)) > 1
    rng = np.random.default_rng(9)
    images = scan_of(rng.uniform(20, 3000, (2, lines, pixels)), rng.uniform(1, 30, (2, lines, pixels)), 9)
    wholes = []
    for sensor, (measured, expected, variance) in enumerate(zip(*images, strict=True)):
        scale = Scale.of(top_code_dn=TOP, least_variance_dn2=float(variance.min()))
        codes, every = compact(expected, variance, scale), range(lines)
        wholes.append(compare(measured, *codes, scale=scale, sensor=sensor, lines=every, seed=1))
    one, other = gather(*images, top_codes_dn=[TOP, TOP], seed=1), join([[whole] for whole in wholes])
    for statistic in Evidence.__slots__:
        np.testing.assert_array_equal(getattr(one, statistic), getattr(other, statistic))


@given(st.integers(1, 5000), st.integers(1, 20000))
def test_parts_are_whole_rows_of_tiles_one_after_the_other(lines: int, pixels: int) -> None:
    found = parts(lines, pixels)
    assert [line for part in found for line in part] == list(range(lines))
    assert all(
        part.start % TILE_PIXELS == 0 and (len(part) >= TILE_PIXELS or lines < TILE_PIXELS) for part in found
    )


def test_a_cut_out_of_a_scan_counts_as_if_it_were_alone() -> None:
    rng = np.random.default_rng(4)
    images = scan_of(rng.uniform(20, 3000, (2, 200, 300)), 3.0, 4)
    inside = (slice(None), slice(10, 180), slice(31, 290))
    cut = tuple(image[inside] for image in images)
    alone = tuple(np.ascontiguousarray(image) for image in cut)
    for statistic in Evidence.__slots__:
        one, other = (getattr(gathered(of), statistic) for of in (cut, alone))  # type: ignore[arg-type]
        np.testing.assert_array_equal(one, other)
