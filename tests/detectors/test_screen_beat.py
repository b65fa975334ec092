"""The beat of a screen against camera pixels, as variance of flat places."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.detectors.matched_filter.fit.beat import beat_contrasts
from prooflight.pages.sampling import Footprint
from prooflight.pages.screen import Screen

LIGHT = ((0.0, 1.0),) * 4
PITCH_MM = 0.1


def _square_pixel() -> Footprint:
    edges = np.clip(np.linspace(-1.0, 2.0, 301), 0, 1)  # a reach of 1.5 pixels
    return Footprint(reach_mm=1.5 * PITCH_MM, across=edges, along=edges)


def test_pixels_of_whole_cells_see_no_beat() -> None:
    """Cells of half a camera pixel at 0 degrees: each pixel sees four whole ones."""
    dpi = 25.4 / (PITCH_MM / 16)
    screen = Screen(kind="am", dpi=dpi, lpi=dpi / 8, angles_deg=(0.0, 0.0, 0.0, 0.0))
    beat = beat_contrasts(screen, LIGHT, _square_pixel(), (PITCH_MM, PITCH_MM))
    assert beat.max() < 1e-3


def test_coarse_dots_are_a_halftone_at_unit_contrast_and_sum_up() -> None:
    """Cells of sixteen camera pixels: each sees ink or paper, of variance a (1 - a), and boxes of them alike."""
    screen = Screen(kind="am", dpi=2540.0, lpi=25.4 / (16 * PITCH_MM), angles_deg=(0.0, 0.0, 0.0, 0.0))
    beat = beat_contrasts(screen, LIGHT, _square_pixel(), (PITCH_MM, PITCH_MM))
    assert beat[3, 2] > 4  # boxes of four pixels that see the same ink
    assert beat[3, 2] == pytest.approx(beat[0, 2])


def test_a_finer_screen_beats_less() -> None:
    beats = [
        beat_contrasts(
            Screen(kind="am", dpi=2540.0, lpi=lpi), LIGHT, _square_pixel(), (PITCH_MM, PITCH_MM)
        ).max()
        for lpi in (85.0, 175.0)
    ]
    assert beats[1] < beats[0]


def test_single_pixels_vary_no_more_than_their_sums() -> None:
    """Boxes of one pixel are among those whose sums are compared; coarse dots are alike over several pixels."""
    screen = Screen(kind="am", dpi=2540.0, lpi=25.4 / (16 * PITCH_MM), angles_deg=(0.0, 0.0, 0.0, 0.0))
    single, summed = (
        beat_contrasts(screen, LIGHT, _square_pixel(), (PITCH_MM, PITCH_MM), correlated=correlated)
        for correlated in (False, True)
    )
    assert (single <= summed).all()
    assert single[3, 2] == pytest.approx(1.0, abs=0.25)  # ink or paper: a (1 - a), but for pixels on borders
