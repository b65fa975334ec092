"""Pages with displaced ink planes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from prooflight.kernels.planes import compose_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page


def displaced(page: Page, planes: NDArray[np.int64]) -> Page:
    """Return the page with each plane displaced to the right and down by (4, 2) raster pixels; bare beyond."""
    packed = page.packed
    out = np.empty_like(packed)
    compose_rows(packed, planes, out)
    return replace(page, cmyk=out.view(np.uint8).reshape(page.cmyk.shape))
