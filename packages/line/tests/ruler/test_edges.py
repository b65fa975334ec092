"""Edges against closed forms: steps blurred by a Gaussian and seen by pixels one wide."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr

from prooflight.inks.ruler_layout import Bar
from prooflight_line.ruler.places import bar_places
from prooflight_line.ruler.slanted_edge import FREQUENCIES, edge_mtf
from prooflight_line.ruler.still_edges import mtf50_of, still_sharpness

if TYPE_CHECKING:
    from numpy.typing import NDArray


def step(offset: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """A step from 0 to 1 at 0, as a pixel one wide at an offset sees it through a Gaussian."""

    def ramp(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return x * ndtr(x / sigma) + sigma * np.exp(-0.5 * (x / sigma) ** 2) / math.sqrt(2 * math.pi)

    return ramp(offset + 0.5) - ramp(offset - 0.5)


@given(
    middle=st.floats(40.0, 60.0),
    half=st.floats(8.0, 11.0),
    sigma=st.floats(0.05, 1.2),
    upright=st.booleans(),
)
def test_the_middle_of_a_bar_is_found_however_blurred_and_fat(
    middle: float, half: float, sigma: float, upright: bool
) -> None:
    """2 mm at 10 pixels a millimetre, printed 16 to 22 pixels wide; edges by their area are exact."""
    at = np.arange(100.0)
    dark = step(at - (middle - half), sigma) * step(middle + half - at, sigma)
    profile = 3000 - 2800 * dark
    image = np.repeat(profile[None], 100, axis=0)
    bar = Bar(box=(4.0, 1.0, 2.0, 8.0) if upright else (1.0, 4.0, 8.0, 2.0), upright=upright)
    # The bar is known to lie there to a quarter of its width.
    place = (middle - 50) * np.array([0.95, 0.0] if upright else [0.0, 0.95])
    to_pixel = np.array([[10.0, 0.0, place[0]], [0.0, 10.0, place[1]]])
    found = bar_places(image if upright else image.T, to_pixel, [bar])
    assert found.at[0] == pytest.approx(middle, abs=2e-3)
    assert found.width[0] == pytest.approx(2 * half, abs=4e-3)


@given(
    sigma=st.floats(0.25, 1.0),
    degrees=st.floats(3.0, 9.0),
    start=st.floats(-0.5, 0.5),
    rising=st.booleans(),
)
def test_a_slanted_edge_has_the_mtf_of_its_blur(
    sigma: float, degrees: float, start: float, rising: bool
) -> None:
    """sinc(f) exp(-2 pi^2 sigma^2 f^2) along rows; at 5 degrees to 0.1 %, at slopes of few phases to 2 %."""
    rows, columns = np.mgrid[0:80, 0:61].astype(float)
    slope = math.tan(math.radians(degrees))
    offset = columns - 30 - start - slope * (rows - 39.5)
    level = step(offset, sigma)
    found = edge_mtf(100 + 900 * (level if rising else 1 - level))
    assert found is not None
    oblique = math.cos(math.atan(slope))  # a row crosses the edge at a slant, and sees it wider
    assert found.mtf50 * oblique == pytest.approx(mtf50_of(sigma), rel=0.02)
    along_row = FREQUENCIES * oblique
    wanted = np.sinc(along_row) * np.exp(-2 * (math.pi * sigma * along_row) ** 2)
    below = FREQUENCIES <= 0.5
    assert np.abs(found.mtf[below] - wanted[below]).max() < 0.02


@pytest.mark.parametrize("sigma", [0.3, 0.6, 1.0])
def test_at_the_standards_slant_it_is_exact(sigma: float) -> None:
    rows, columns = np.mgrid[0:80, 0:61].astype(float)
    slope = math.tan(math.radians(5.0))
    found = edge_mtf(100 + 900 * step(columns - 30.2 - slope * (rows - 39.5), sigma))
    assert found is not None
    assert found.mtf50 * math.cos(math.radians(5)) == pytest.approx(mtf50_of(sigma), rel=1e-3)


def test_what_is_no_slanted_edge_has_no_mtf() -> None:
    rows, columns = np.mgrid[0:80, 0:61].astype(float)
    upright = 100 + 900 * step(columns - 30, 0.5)
    assert edge_mtf(upright) is None  # it never moves over a pixel
    assert edge_mtf(np.full((80, 61), 500.0)) is None
    assert edge_mtf(np.random.default_rng(1).normal(500, 5, (80, 61))) is None
    bent = 100 + 900 * step(columns - 30 - 0.004 * (rows - 40) ** 2, 0.5)
    assert edge_mtf(bent) is None


@pytest.mark.parametrize("sigma", [0.2, 0.4, 0.8, 1.5])
def test_edges_that_lie_still_have_the_mtf_of_their_blur(sigma: float) -> None:
    """40 edges at places of all fractions of a pixel; noise of 1 % of the step, seed 3."""
    at = np.arange(1000.0)
    profile = np.full(1000, 200.0)
    places = 20.0 + 24.13 * np.arange(40)
    for number, place in enumerate(places):
        profile += (1 if number % 2 == 0 else -1) * 2000 * step(at - place, sigma)
    profile += np.random.default_rng(3).normal(0, 5, 1000)
    found = still_sharpness(profile)
    assert found is not None
    # A blur narrower than a third of a pixel hardly shows: its error is larger, and says so.
    assert found.value == pytest.approx(mtf50_of(sigma), abs=max(4 * found.standard_error, 0.004))
    assert found.standard_error < 0.01


def test_a_profile_without_edges_tells_no_sharpness() -> None:
    assert still_sharpness(np.random.default_rng(1).normal(2000, 5, 1000)) is None


def test_half_of_the_contrast_of_a_sharp_pixel() -> None:
    assert mtf50_of(1e-4) == pytest.approx(0.60335, abs=1e-4)  # sinc(f) = 1/2
    assert mtf50_of(2.0) == pytest.approx(math.sqrt(math.log(2) / 2) / (2 * math.pi), rel=0.02)
