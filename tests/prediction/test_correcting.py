"""The lens correction's loops against plain SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from prooflight.kernels.prediction.lens_correction import FAR_BLOCK, FARTHER_BLOCK
from prooflight.pages.lens_correction import LensCorrection
from prooflight.prediction import lens_correction as correct
from prooflight.prediction.lens_correction import correct_light

SINGLE_PRECISION = 2e-6
"""Of the light: a hundred additions in single precision."""


def symmetric(rng: np.random.Generator, reach: int) -> np.ndarray:
    quadrant = rng.normal(0, 0.1, (reach + 1, reach + 1))
    half = np.concatenate([quadrant[:0:-1], quadrant])
    return np.concatenate([half[:, :0:-1], half], axis=1).astype(np.float32)


def any_correction(seed: int) -> LensCorrection:
    rng = np.random.default_rng(seed)
    return LensCorrection(near=symmetric(rng, 3), far=symmetric(rng, 2), farther=symmetric(rng, 3))


def means(image: np.ndarray, block: int) -> np.ndarray:
    padded = np.pad(image, [(0, -extent % block) for extent in image.shape])
    return padded.reshape(padded.shape[0] // block, block, -1, block).mean(axis=(1, 3))


def spread(blocks: np.ndarray, block: int, shape: tuple[int, ...]) -> np.ndarray:
    places = [(np.arange(extent) + 0.5) / block - 0.5 for extent in shape]
    return ndimage.map_coordinates(blocks, np.meshgrid(*places, indexing="ij"), order=1, mode="nearest")


def reference(light: np.ndarray, correction: LensCorrection) -> np.ndarray:
    near, far, farther = (
        part.astype(np.float64) for part in (correction.near, correction.far, correction.farther)
    )
    blocks = means(light, FAR_BLOCK)
    large = means(blocks, FARTHER_BLOCK // FAR_BLOCK)
    tail = ndimage.convolve(blocks, far, mode="constant")
    tail += spread(
        ndimage.convolve(large, farther, mode="constant"), FARTHER_BLOCK // FAR_BLOCK, blocks.shape
    )
    return ndimage.convolve(light, near, mode="constant") + spread(tail, FAR_BLOCK, light.shape)


@given(lines=st.integers(1, 70), pixels=st.integers(1, 70), seed=st.integers(0, 10**6))
def test_on_any_scan_as_scipy_does_it(lines: int, pixels: int, seed: int) -> None:
    light = np.random.default_rng(seed).uniform(-200, 3000, (lines, pixels)).astype(np.float32)
    want = reference(light.astype(np.float64), any_correction(seed))
    correct_light(light, any_correction(seed))
    np.testing.assert_allclose(light, want, atol=3000 * SINGLE_PRECISION)


@pytest.mark.parametrize("lines", [15, 16, 17, 32, 35])
def test_bands_and_threads_meet_without_a_seam(monkeypatch: pytest.MonkeyPatch, lines: int) -> None:
    light = np.random.default_rng(1).uniform(0, 3000, (lines, 50)).astype(np.float32)
    whole = light.copy()
    correct_light(whole, any_correction(3))
    monkeypatch.setattr(correct, "LINES_PER_BAND", 16)
    correct_light(light, any_correction(3), threads=3)
    np.testing.assert_array_equal(light, whole)


def test_no_correction_changes_nothing() -> None:
    light = np.random.default_rng(2).normal(size=(9, 9)).astype(np.float32)
    kept = light.copy()
    correct_light(light, LensCorrection.none())
    np.testing.assert_array_equal(light, kept)
    assert LensCorrection.none().is_identity
    assert not any_correction(1).is_identity
