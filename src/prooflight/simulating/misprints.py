"""Misprints: what goes wrong on a press, with the place where it did.

Each kind changes the printed raster. Amounts and severities are those of ``worlds.toml``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from prooflight.simulating.worlds import amount

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page

INK_NAMES = ("cyan", "magenta", "yellow", "black")
WHOLE_PAGE_SHARE = 0.5
"""assumed: how often a fading ink or a streak covers the whole page rather than a part of its height."""
LEAST_BAND_SHARE = 0.25
"""assumed: the least part of the page's height that a band or streak covers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Misprint:
    """What was done to a page."""

    kind: str
    severity: float
    detail: str
    """In a printer's words, e.g. ``magenta faded to 20 %``."""
    region_mm: tuple[float, float, float, float]
    """x, y, width, height of the place concerned; the whole page where it is global. [mm]"""


Draw = tuple["Page", Misprint]


def missing_plane(page: Page, severity: float, rng: np.random.Generator) -> Draw:
    """One ink faded or gone, over the page or a band of it."""
    ink = int(rng.integers(4))
    left = amount("missing-plane", "ink_left_percent", severity) / 100
    top, bottom = _span(page.cmyk.shape[0], rng)
    cmyk = page.cmyk.copy()
    cmyk[top:bottom, :, ink] = np.round(cmyk[top:bottom, :, ink] * left)
    where = "page" if bottom - top == len(cmyk) else "band"
    detail = f"{INK_NAMES[ink]} faded to {left:.0%} over the {where}"
    region = _region(page, 0, top, page.cmyk.shape[1], bottom)
    return replace(page, cmyk=cmyk), Misprint(
        kind="missing-plane", severity=severity, detail=detail, region_mm=region
    )


def streak(page: Page, severity: float, rng: np.random.Generator) -> Draw:
    """A line along the travel with too much of one ink: a drum that is scratched or not wiped clean.

    Reading of ``ink_percent``: the share of the bare paper under the streak that gets that ink as well.
    """
    share = amount("streak", "ink_percent", severity) / 100
    width_mm = amount("streak", "width_mm", severity)
    rows, columns = page.cmyk.shape[:2]
    width = min(max(round(width_mm / page.pixel_mm), 1), columns)
    left = int(rng.integers(columns - width + 1))
    top, bottom = _span(rows, rng)
    ink = int(rng.integers(4))
    cmyk = page.cmyk.copy()
    place = cmyk[top:bottom, left : left + width, ink].astype(np.float32)
    cmyk[top:bottom, left : left + width, ink] = np.round(place + (255 - place) * share)
    detail = f"streak {width_mm:.2f} mm wide, {share:.0%} more {INK_NAMES[ink]}"
    region = _region(page, left, top, left + width, bottom)
    return replace(page, cmyk=cmyk), Misprint(
        kind="streak", severity=severity, detail=detail, region_mm=region
    )


def missing_content(page: Page, severity: float, rng: np.random.Generator) -> Draw:
    """A block of the page was not printed."""
    size_mm = amount("missing-content", "size_mm", severity)
    rows, columns = page.cmyk.shape[:2]
    height, width = (min(max(round(size_mm / page.pixel_mm), 1), extent) for extent in (rows, columns))
    top, left = int(rng.integers(rows - height + 1)), int(rng.integers(columns - width + 1))
    cmyk = page.cmyk.copy()
    cmyk[top : top + height, left : left + width] = 0
    region = _region(page, left, top, left + width, top + height)
    return replace(page, cmyk=cmyk), Misprint(
        kind="missing-content",
        severity=severity,
        detail=f"a block of {size_mm:.0f} mm missing",
        region_mm=region,
    )


def wrong_page(
    page: Page,
    severity: float,
    rng: np.random.Generator,
    *,
    others: Sequence[int],
    fetch: Callable[[int], Page],
) -> Draw:
    """Another page of the job, a block of another page, or the right page off its place.

    others: numbers of the job's other pages, which ``fetch`` gives; without others the page is off its place.
    """
    whole = _region(page, 0, 0, page.cmyk.shape[1], page.cmyk.shape[0])
    way = int(rng.integers(3)) if others else 2
    if way == 2:
        cmyk, detail = _off_place(page, severity, rng)
        region = whole
    else:
        other = fetch(int(rng.choice(np.asarray(others))))
        foreign = _fitted(other.cmyk, page.cmyk.shape)
        if way == 0:
            cmyk, detail, region = foreign, f"page {other.number} printed instead", whole
        else:
            rows, columns = page.cmyk.shape[:2]
            height, width = rows // 3, columns // 2
            top, left = int(rng.integers(rows - height + 1)), int(rng.integers(columns - width + 1))
            cmyk = page.cmyk.copy()
            cmyk[top : top + height, left : left + width] = foreign[top : top + height, left : left + width]
            detail = f"a block of page {other.number}"
            region = _region(page, left, top, left + width, top + height)
    return replace(page, cmyk=cmyk), Misprint(
        kind="wrong-page", severity=severity, detail=detail, region_mm=region
    )


def _off_place(page: Page, severity: float, rng: np.random.Generator) -> tuple[NDArray[np.uint8], str]:
    """The right page shifted, paper where it came from."""
    distance_mm = amount("wrong-page", "shift_mm", severity)
    angle = float(rng.uniform(0, 2 * np.pi))
    shift = np.array([np.cos(angle), np.sin(angle)]) * (distance_mm / page.pixel_mm)
    matrix = np.array([[1, 0, round(shift[0])], [0, 1, round(shift[1])]], dtype=np.float64)
    size = (page.cmyk.shape[1], page.cmyk.shape[0])
    moved = cv2.warpAffine(page.cmyk, matrix, size, flags=cv2.INTER_NEAREST, borderValue=(0, 0, 0, 0))
    return np.ascontiguousarray(moved, dtype=np.uint8), f"the page lies {distance_mm:.1f} mm off its place"


def _fitted(cmyk: NDArray[np.uint8], shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """``cmyk`` cropped or filled with paper to another page's shape, top-left corners together."""
    fitted = np.zeros(shape, np.uint8)
    rows, columns = min(shape[0], cmyk.shape[0]), min(shape[1], cmyk.shape[1])
    fitted[:rows, :columns] = cmyk[:rows, :columns]
    return fitted


def _span(rows: int, rng: np.random.Generator) -> tuple[int, int]:
    """First and last + 1 row of something that runs along the travel: the whole page or a part of it."""
    if rng.random() < WHOLE_PAGE_SHARE:
        return 0, rows
    length = int(rows * rng.uniform(LEAST_BAND_SHARE, 1.0))
    top = int(rng.integers(rows - length + 1))
    return top, top + length


def _region(page: Page, left: int, top: int, right: int, bottom: int) -> tuple[float, float, float, float]:
    pixels = np.array([left, top, right - left, bottom - top])
    x, y, width, height = (round(float(v), 2) for v in pixels * page.pixel_mm)
    return x, y, width, height
