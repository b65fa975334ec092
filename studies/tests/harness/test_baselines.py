from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from prooflight_studies.harness.baselines import (
    BASELINES,
    VariationModel,
    absolute_difference,
    all_scores,
    dissimilarity,
    variation_moments,
)

WHITE = (3000.0, 2500.0)
NOISE_ALONE = VariationModel(floor=0.0, edge=0.0, signal=0.0)


def page(seed: int = 1, sensors: int = 2, side: int = 96) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A scan of a page of flat patches, and what was expected: DN, expected, variance."""
    rng = np.random.default_rng(seed)
    patches = rng.uniform(200, 2900, (sensors, side // 16, side // 16))
    expected = np.repeat(np.repeat(patches, 16, 1), 16, 2).astype(np.float32)
    variance = np.full_like(expected, 64.0)
    measured = np.rint(expected + rng.normal(0, 8, expected.shape)).astype(np.uint16)
    return measured, expected, variance


def test_differences_by_hand() -> None:
    expected = np.full((2, 40, 50), 1000, np.float32)
    measured = expected.astype(np.uint16)
    measured[0, 10:15, 20:25] += 300  # 0.1 of white over just one window
    measured[1, 3, 3] = 750  # 0.1 of the other sensor's white, one pixel of 25
    found = absolute_difference(measured, expected, white_dn=WHITE)
    assert found.local == pytest.approx(0.1)
    assert found.mean == pytest.approx(0.1 * 25 / 2000)
    # 25 of 2000 pixels differ, more than half a per cent
    assert found.high == pytest.approx(0.1)
    blank = absolute_difference(expected.astype(np.uint16), expected, white_dn=WHITE)
    assert (blank.local, blank.mean, blank.high) == (0, 0, 0)


def test_structural_similarity_is_scikit_images() -> None:
    metrics = pytest.importorskip("skimage.metrics", reason="needs scikit-image, extra [demo]")
    measured, expected, _ = page()
    found = dissimilarity(measured, expected, white_dn=WHITE)
    means, lows = [], []
    for sensor, white in enumerate(WHITE):
        mean, similar = metrics.structural_similarity(
            measured[sensor].astype(np.float64),
            expected[sensor].astype(np.float64),
            data_range=white,
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
            full=True,
        )
        means.append(1 - mean)
        lows.append(1 - similar[5:-5, 5:-5].min())
    # ours works in float32: 1e-7 of white squared against c2 of 9e-4
    assert found.mean == pytest.approx(max(means), abs=2e-5)
    assert found.worst == pytest.approx(max(lows), abs=2e-4)


def test_what_is_equal_is_similar() -> None:
    _, expected, _ = page()
    same = np.rint(expected).astype(np.uint16)
    assert dissimilarity(same, same.astype(np.float32), white_dn=WHITE).mean == pytest.approx(0, abs=1e-6)


def test_variation_counts_sigmas_of_the_fourth_pixel() -> None:
    expected = np.full((1, 30, 30), 1000, np.float32)
    measured = expected.astype(np.uint16)
    measured[0, [2, 9, 20, 25], [3, 4, 5, 6]] += np.array([80, 70, 60, 40], np.uint16)
    variance = np.full_like(expected, 64.0)
    assert NOISE_ALONE.score(measured, expected, variance, white_dn=WHITE[:1]) == pytest.approx(40 / 8)
    wider = VariationModel(floor=0.0, edge=0.0, signal=0.006)  # 6 DN here: sigma 10 in all
    assert wider.score(measured, expected, variance, white_dn=WHITE[:1]) == pytest.approx(4.0, rel=1e-6)


def test_an_edge_that_moved_by_a_pixel_is_tolerated_and_by_two_is_not() -> None:
    expected = np.full((1, 40, 40), 2800, np.float32)
    expected[:, :, 20:] = 300
    variance = np.full_like(expected, 64.0)
    for pixels, outside in ((0, False), (1, False), (2, True)):
        moved = np.roll(expected, pixels, axis=2)
        moved[:, :, :pixels] = 2800
        score = NOISE_ALONE.score(moved.astype(np.uint16), expected, variance, white_dn=WHITE[:1])
        assert (score > 0) is outside


@pytest.mark.parametrize(("floor", "edge", "signal"), [(0.01, 0.0, 0.0), (0.0, 0.0, 0.02), (0.01, 0.1, 0.01)])
def test_variation_is_learned_back(floor: float, edge: float, signal: float) -> None:
    """Copies scatter by a known model on one side of the tolerance, beyond noise that is as good as none.

    60 pages of 80,000 draws: gains are drawn once a pixel, so a variance is known to about 1 %, a coefficient to less
    than 5 %; those that are 0 come out below a tenth of the others.
    """
    rng = np.random.default_rng(5)
    moments = []
    for copy in range(60):
        _, expected, variance = page(copy, side=192)
        low, high = (
            ranked(expected, size=(1, 3, 3), mode="nearest")
            for ranked in (ndimage.minimum_filter, ndimage.maximum_filter)
        )
        white = np.array(WHITE)[:, None, None]
        sigma = np.sqrt((floor * white) ** 2 + (edge * (high - low)) ** 2 + (signal * expected) ** 2)
        sign = np.where(rng.random(expected.shape) < 0.5, -1, 1)
        far = np.abs(rng.normal(0, 1, expected.shape)) * sigma
        measured = np.where(sign > 0, high + far, np.maximum(low - far, 0))
        measured = np.rint(np.where(low - far < 0, high + far, measured)).astype(np.uint16)
        moments.append(
            variation_moments(measured, expected, np.full_like(variance, 1e-3), white_dn=WHITE, rng=rng)
        )
    found = VariationModel.learn(moments)
    for got, want in zip((found.floor, found.edge, found.signal), (floor, edge, signal), strict=True):
        assert got == pytest.approx(want, rel=0.1, abs=0.003)


def test_every_peer_finds_a_missing_block_and_none_changes_its_inputs() -> None:
    measured, expected, variance = page()
    spoiled = measured.copy()
    spoiled[:, 20:50, 20:50] = 3000
    arrays = (measured, spoiled, expected, variance)
    before = [array.copy() for array in arrays]
    scores = [
        all_scores(scan, expected, variance, variation=NOISE_ALONE, white_dn=WHITE)
        for scan in (measured, spoiled)
    ]
    assert scores[0].shape == (len(BASELINES),)
    assert (scores[1] > 2 * scores[0]).all()
    for array, copy in zip(arrays, before, strict=True):
        np.testing.assert_array_equal(array, copy)


@given(turns=st.integers(0, 3))
def test_baselines_do_not_care_how_the_page_is_turned(turns: int) -> None:
    measured, expected, variance = page(side=48)
    upright = all_scores(measured, expected, variance, variation=NOISE_ALONE, white_dn=WHITE)
    turned = [
        np.ascontiguousarray(np.rot90(array, turns, axes=(1, 2))) for array in (measured, expected, variance)
    ]
    np.testing.assert_allclose(
        all_scores(turned[0], turned[1], turned[2], variation=NOISE_ALONE, white_dn=WHITE),
        upright,
        rtol=1e-5,
        atol=2e-4,  # SSIM in float32: 1e-7 against c2 of 9e-4
    )
