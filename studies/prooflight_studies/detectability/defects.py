"""Pages with a defect of just the strength that is predicted to be caught at its position."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INK_LETTERS
from prooflight_studies.detectability.closed_form import PATCH_TILES, STREAK_WIDTH

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight_studies.detectability.closed_form import Reach

STREAK_MM: Final = 0.254 * STREAK_WIDTH
BLACK: Final = 3
EDGE_MM: Final = 6.0
"""Least distance of printed defects from the page's edges."""


def spotted(page: Page, of_page: Reach, rng: np.random.Generator) -> Page | None:
    """Add the smallest black spot that is predicted to be caught at its position; None: there is no such place."""
    place = _drawn_tile(page, of_page, of_page.spot_mm, EDGE_MM, rng)
    if place is None:
        return None
    row, column, y_mm, x_mm = place
    centre = np.array([y_mm, x_mm]) / page.pixel_mm
    radius = of_page.spot_mm[row, column] / 2 / page.pixel_mm
    first = np.maximum((centre - radius).astype(int) - 1, 0)
    last = (centre + radius).astype(int) + 2
    window = page.cmyk[first[0] : last[0], first[1] : last[1]]
    down, across = np.ogrid[: window.shape[0], : window.shape[1]]
    far = np.hypot(down + first[0] + 0.5 - centre[0], across + first[1] + 0.5 - centre[1])
    cmyk = page.cmyk.copy()
    # A pixel on the edge is black by as much as is covered, so that the spot's area is what it should be.
    cover = np.clip(radius + 0.5 - far, 0, 1)
    part = cmyk[first[0] : last[0], first[1] : last[1], BLACK]
    part[:] = np.maximum(part, np.rint(255 * cover).astype(np.uint8))
    return replace(page, cmyk=cmyk)


def streaked(page: Page, of_page: Reach, rng: np.random.Generator) -> Page | None:
    """Add the faintest black streak 0.5 mm wide that is predicted to be caught at its position."""
    x = (np.arange(of_page.streak_percent.size) + 0.5) * of_page.pixel_mm + of_page.left_mm
    columns = np.flatnonzero(_inside(x, page.width_mm) & np.isfinite(of_page.streak_percent))
    if not columns.size:
        return None
    column = int(rng.choice(columns))
    left, right = (round((x[column] + side * STREAK_MM / 2) / page.pixel_mm) for side in (-1, 1))
    amount = of_page.streak_percent[column] / 100
    cmyk = page.cmyk.copy()
    part = cmyk[:, left:right, BLACK]
    part[:] = _rounded(part + amount * (255.0 - part), rng)
    return replace(page, cmyk=cmyk)


def patched(page: Page, of_page: Reach, rng: np.random.Generator) -> Page | None:
    """Reduce all inks in a square, by the least loss that is predicted to be caught at its position."""
    side_mm = PATCH_TILES * of_page.tile_mm
    place = _drawn_tile(page, of_page, of_page.patch_percent, EDGE_MM + side_mm / 2, rng)
    if place is None:
        return None
    row, column, *middle_mm = place
    down, across = (
        slice(*(round((at + side * side_mm / 2) / page.pixel_mm) for side in (-1, 1))) for at in middle_mm
    )
    cmyk = page.cmyk.copy()
    cmyk[down, across] = _rounded(cmyk[down, across] * (1 - of_page.patch_percent[row, column] / 100), rng)
    return replace(page, cmyk=cmyk)


def paled(page: Page, of_page: Reach, rng: np.random.Generator) -> Page | None:
    """Reduce one ink, by the least loss that is predicted to be caught."""
    caught = {letter: least for letter, least in of_page.inks_percent.items() if np.isfinite(least)}
    if not caught:
        return None
    letter = str(rng.choice(sorted(caught)))
    ink = INK_LETTERS.index(letter)
    cmyk = page.cmyk.copy()
    cmyk[..., ink] = _rounded(cmyk[..., ink] * (1 - caught[letter] / 100), rng)
    return replace(page, cmyk=cmyk)


DRAWN: Final = {"spot": spotted, "streak": streaked, "patch": patched, "ink": paled}


def _drawn_tile(
    page: Page, of_page: Reach, least: NDArray[np.float64], edge_mm: float, rng: np.random.Generator
) -> tuple[int, int, float, float] | None:
    """Return row and column of a tile where ``least`` is finite, and its middle on the page, y and x. [mm]"""
    y, x = (
        np.arange(count) * of_page.tile_mm + of_page.tile_mm / 2 + first
        for count, first in zip(least.shape, (of_page.top_mm, of_page.left_mm), strict=True)
    )
    inside = _inside(y, page.height_mm, edge_mm)[:, None] & _inside(x, page.width_mm, edge_mm)
    rows, columns = np.nonzero(inside & np.isfinite(least))
    if not rows.size:
        return None
    drawn = int(rng.integers(rows.size))
    row, column = int(rows[drawn]), int(columns[drawn])
    return row, column, float(y[row]), float(x[column])


def _inside(place_mm: NDArray[np.floating], extent_mm: float, edge_mm: float = EDGE_MM) -> NDArray[np.bool_]:
    return np.asarray((place_mm > edge_mm) & (place_mm < extent_mm - edge_mm))


def _rounded(values: NDArray[np.floating], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Round to whole codes, at random, so that the mean is right."""
    return np.clip(np.floor(values + rng.random(values.shape)), 0, 255).astype(np.uint8)
