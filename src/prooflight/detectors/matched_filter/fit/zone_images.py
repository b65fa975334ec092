"""Images of the zones at a scan's placement: ignored areas and careful areas."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import cv2
import numpy as np

from prooflight.detectors.matched_filter.fit.modes import moved

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.modes import PixelMap
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import PageZones
    from prooflight.scans.geometry import ScanGeometry

ABOUT_PIXELS: Final = 2
"""Margin about ignored areas that is not judged either, as at the edges of a page: the lens spreads what is
within, and a plane may be displaced. [binned pixels]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ZoneImages:
    """Images of the zones of a page in its nominal place, in binned pixels."""

    images: NDArray[np.float32]
    """(2, lines, pixels) 1 in ignored areas, and 1 in careful areas."""

    @classmethod
    def of(cls, zones: PageZones, page: Page, geometry: ScanGeometry) -> Self:
        """Draw the zones of a page; geometry: of binned pixels."""
        across = geometry.centres_x_mm(page.width_mm)
        along = geometry.centres_y_mm(geometry.lines(page.height_mm))
        images = np.zeros((2, along.size, across.size), np.float32)
        about = np.ones((2 * ABOUT_PIXELS + 1,) * 2, np.uint8)
        images[0] = cv2.dilate(zones.holds("ignore", across, along).astype(np.float32), about)
        images[1] = zones.holds("careful", across, along)
        return cls(images=images)

    def moved(self, where: PixelMap) -> NDArray[np.bool_]:
        """Return the masks at a placement, (2, lines, pixels); careful areas exclude ignored ones."""
        there = moved(self.images, where) >= 0.5
        there[1] &= ~there[0]
        return there


def ignored_tiles(
    zones: PageZones, page: Page, geometry: ScanGeometry, tile_pixels: int
) -> NDArray[np.bool_]:
    """Return which tiles, ``tile_pixels`` camera pixels a side, contain an ignored area: (rows, columns)."""
    across = geometry.centres_x_mm(page.width_mm)
    along = geometry.centres_y_mm(geometry.lines(page.height_mm))
    rows, columns = along.size // tile_pixels, across.size // tile_pixels
    ignored = zones.holds("ignore", across[: columns * tile_pixels], along[: rows * tile_pixels])
    return np.asarray(ignored.reshape(rows, tile_pixels, columns, tile_pixels).any(axis=(1, 3)))
