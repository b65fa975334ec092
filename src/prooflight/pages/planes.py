"""A page whose ink planes lie apart."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from prooflight.kernels.planes import compose_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page


def displaced(page: Page, planes: NDArray[np.int64]) -> Page:
    """The page with planes so many raster pixels too far right and too far down, (4, 2); bare beyond."""
    packed = page.packed
    out = np.empty_like(packed)
    compose_rows(packed, planes, out)
    return replace(page, cmyk=out.view(np.uint8).reshape(page.cmyk.shape))
