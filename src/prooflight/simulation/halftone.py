"""Plates as a press prints them: device pixels, screened where it screens, together on the raster that is printed.

The simulator knows tints, not dots: where device pixels are taken together by area, the ink amount stands that takes as
much light as they do (``area_averaged``). That raster is finer than the camera's, so that the beat between screen and
camera pixels is the camera's own and not that of a raster (decision 46).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.pages.pdf.area_averages import InkLight, area_averaged
from prooflight.pages.screen import Screen, screened

if TYPE_CHECKING:
    from prooflight.pages.raster import Page

PRINTED_DPI: Final = 600.0
"""Resolution of the raster that is printed, or the device's own where that is lower. Of a screen of 175 lpi the light
of the third harmonic and above folds back, by 0.4 % of white and less before the lens.
"""
BAND_ROWS: Final = 240
"""Rows of the printed raster that are screened at once."""
PATCH: Final = 768
"""Side of the patch on which ``dot_gain_factor`` looks. [device pixels]"""
LARGEST_FACTOR: Final = 10.0


def averaged(plates: NDArray[np.uint8], dpi: float, light: InkLight) -> tuple[NDArray[np.uint8], float]:
    """Take device pixels (rows, columns, 4) together by area; return the raster that is printed, and its resolution."""
    if dpi <= PRINTED_DPI:
        return plates, dpi
    step = dpi / PRINTED_DPI
    rows, columns = (max(int(side / step + 0.001), 1) for side in plates.shape[:2])
    out = np.empty((rows, columns, 4), np.uint8)
    area_averaged(plates, out, light, step=step)
    return out, PRINTED_DPI


@lru_cache(maxsize=2)
def halftoned(page: Page, screen: Screen, light: InkLight) -> Page:
    """Return a page as a press with a screen prints it: its raster enlarged to device pixels, and screened.

    It is screened in bands, at whose borders error diffusion begins anew.
    """
    dpi = min(PRINTED_DPI, screen.dpi)
    step, scale = screen.dpi / dpi, page.dpi / screen.dpi
    rows, columns = (max(round(side * dpi / page.dpi), 1) for side in page.cmyk.shape[:2])
    across = _sources(int(np.ceil(columns * step)), scale, page.cmyk.shape[1])
    out = np.empty((rows, columns, 4), np.uint8)
    for first in range(0, rows, BAND_ROWS):
        band = out[first : first + BAND_ROWS]
        top = int(np.floor(first * step))
        bottom = int(np.ceil((first + len(band)) * step))
        down = _sources(bottom - top, scale, page.cmyk.shape[0], first=top)
        plates = np.ascontiguousarray(page.cmyk[down][:, across])
        screened(plates, screen, tone=light, origin=(top, 0), out=plates)
        if step > 1:
            area_averaged(plates, band, light, step=step, first=first * step - top)
        else:
            band[:] = plates
    return replace(page, cmyk=out, dpi=dpi)


def _sources(count: int, scale: float, extent: int, first: int = 0) -> NDArray[np.int64]:
    """Return the raster pixel under each of ``count`` device pixels."""
    return np.minimum(((first + np.arange(count) + 0.5) * scale).astype(np.int64), extent - 1)


@lru_cache(maxsize=8)
def dot_gain_factor(screen: Screen, light: InkLight) -> float:
    """Return the factor on dot gain by which a screened mid-tint darkens as the same tint printed continuously does.

    Ink grows at the edges of dots alone, and pixels that are solid or bare have none: the mean over the inks of what
    a small dot gain does to both, in light, bounded by ``LARGEST_FACTOR``.
    """
    plates = np.full((PATCH, PATCH, 4), 128, np.uint8)
    printed, _ = averaged(screened(plates, screen, tone=light), screen.dpi, light)
    area, grown, factors = np.linspace(0, 1, 256), 0.004, []
    for ink, curve in enumerate(light):

        def takes(amount: NDArray[np.float64], curve: tuple[float, ...] = curve) -> NDArray[np.float64]:
            return np.interp(amount, np.linspace(0, 1, len(curve)), curve)

        effect = takes(area + 4 * grown * area * (1 - area)) - takes(area)
        share = np.bincount(printed[..., ink].ravel(), minlength=256) / printed[..., ink].size
        factors.append(effect[128] / max(float(share @ effect), effect[128] / LARGEST_FACTOR))
    return float(np.mean(factors))
