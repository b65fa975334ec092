"""Pages with displaced ink planes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.planes import compose_by_parts, compose_rows
from prooflight.pages.pdf.area_averages import FLAT, InkLight, light_tables

if TYPE_CHECKING:
    from prooflight.pages.raster import Page

PARTS: Final = 4
"""Number of parts of a raster pixel, either way, by which planes are displaced: an eighth of a pixel, 6.6 um at 480
pixels an inch, is left at most."""


def displaced(page: Page, planes: NDArray[np.int64]) -> Page:
    """Return the page with each plane displaced to the right and down by (4, 2) raster pixels; bare beyond."""
    packed = page.packed
    out = np.empty_like(packed)
    compose_rows(packed, planes, out)
    return replace(page, cmyk=out.view(np.uint8).reshape(page.cmyk.shape))


def displaced_by_parts(page: Page, planes: NDArray[np.int64], light: InkLight) -> Page:
    """Return the page with each plane displaced to the right and down by (4, 2) ``PARTS``-ths of a raster pixel.

    Where a pixel is covered by parts of several, it reflects what they reflect together, as ``area_averaged`` says.
    """
    whole, parts = np.divmod(planes, PARTS)
    packed = page.packed
    out = np.empty_like(packed)
    compose_by_parts(packed, whole, parts, PARTS, FLAT, *light_tables(light), out)
    return replace(page, cmyk=out.view(np.uint8).reshape(page.cmyk.shape))
