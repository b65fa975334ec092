"""The beat of a screen against camera pixels, as variance of flat places."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from prooflight.detectors.matched_filter.fit.beat import RowBeats, beat_contrasts, row_beats
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


def _row_beats(cover: np.ndarray, screen: Screen) -> RowBeats | None:
    """The beat along rows of four lines, in waves of 2 to 40 mm."""
    sensor: Any = SimpleNamespace(footprint=_square_pixel())
    return row_beats(cover, screen, LIGHT, [sensor], line_mm=PITCH_MM, tile_lines=4, periods_mm=(2.0, 40.0))


def _tinted(area: float) -> np.ndarray:
    cover = np.zeros((4, 40, 40), np.float32)
    cover[3] = area
    return cover


def test_lines_of_a_screen_beat_with_rows_as_a_square_wave_does() -> None:
    """Lines of 0.36 mm against rows of 0.4 mm: a wave of 3.6 mm, of 4 / pi of the mean light times sinc(0.4 / 0.36)."""
    lines = {"kind": "am", "dpi": 2540.0, "lpi": 2540.0 / 36, "dot": "line"}
    across = _row_beats(_tinted(0.5), Screen(**lines, angles_deg=(0.0, 0.0, 0.0, 0.0)))  # type: ignore[arg-type]
    along = _row_beats(_tinted(0.5), Screen(**lines, angles_deg=(90.0, 90.0, 90.0, 90.0)))  # type: ignore[arg-type]
    assert across is not None
    assert along is not None
    wave, sd = across.at(_tinted(0.5))
    assert wave.max() == wave.min() == pytest.approx(4 / np.pi * abs(np.sinc(0.4 / 0.36)), rel=0.03)
    assert sd.max() >= wave.max() / np.sqrt(2) * 0.98  # harmonics add to it
    assert max(one.max() for one in along.at(_tinted(0.5))) < 1e-6
    for area in (0.0, 1.0):  # bare paper and solids, beside the tint
        assert not any(one.any() for one in across.at(_tinted(area)))


def test_scattered_dots_and_pages_without_tints_have_no_beat_along_rows() -> None:
    am = Screen(kind="am", dpi=1200.0, lpi=175.0)
    assert _row_beats(_tinted(1.0), am) is None
    assert _row_beats(_tinted(0.5), Screen(kind="error-diffusion", dpi=1200.0)) is None
