"""Defects printed: in the page's raster, before press and camera, where the price puts them into scans."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from prooflight.commissioning.zones.defects import STREAK_MM

if TYPE_CHECKING:
    from prooflight.commissioning.zones.defects import Area
    from prooflight.pages.raster import Page


def printed_with(
    page: Page, sort: str, strength: float, area: Area, *, rng: np.random.Generator
) -> Page | None:
    """A page with a defect of ``SORTS`` somewhere in an area; None: the area has no pixel on the page."""
    rows, columns = page.cmyk.shape[:2]
    x, y = ((np.arange(count) + 0.5) * page.pixel_mm for count in (columns, rows))
    of_area = area.holds(x, y)
    down, across = np.nonzero(of_area)
    if not down.size:
        return None
    at = int(rng.integers(down.size))
    x0, y0 = x[across[at]], y[down[at]]
    if sort == "density":
        share = of_area * (strength / 100)
    elif sort == "spot":
        share = (np.hypot(x - x0, (y - y0)[:, None]) <= strength / 2).astype(np.float64)
    else:
        share = of_area * (np.abs(x - x0) <= STREAK_MM / 2) * (strength / 100)
    ink = page.cmyk.astype(np.float64)
    if sort == "density" or _dark(ink, share):
        ink *= 1 - share[..., None]
    else:
        ink[..., :3] *= 1 - share[..., None]
        ink[..., 3] += share * (255 - ink[..., 3])
    # Tints keep their mean: a loss of 1 % of a tint is less than a step.
    cmyk = np.floor(ink + rng.random(ink.shape)).clip(0, 255).astype(np.uint8)
    cmyk[share == 0] = page.cmyk[share == 0]
    return replace(page, cmyk=cmyk)


def _dark(ink: np.ndarray, share: np.ndarray) -> bool:
    """Whether the print is darker than half where a defect lies."""
    here = share > 0
    left = 1 - ink[here] / 255
    return bool((left[:, :3].mean(axis=1) * left[:, 3]).mean() < 0.5)
