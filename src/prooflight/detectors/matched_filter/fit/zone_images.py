"""Where zones lie in a scan: what is ignored, and what is careful."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import cv2
import numpy as np

from prooflight.kernels.residuals.moving import move_smooth

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.modes import PixelMap
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import PageZones
    from prooflight.scans.geometry import ScanGeometry

ABOUT_PIXELS: Final = 2
"""Binned pixels about what is ignored that are not judged either, as at the edges of a page: the lens spreads what lies
within, and a plane may lie aside."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ZoneImages:
    """Where on a page in its place zones lie, in binned pixels."""

    images: NDArray[np.float32]
    """(2, lines, pixels) 1 where a pixel is ignored, and where it is of a careful area."""

    @classmethod
    def of(cls, zones: PageZones, page: Page, geometry: ScanGeometry) -> Self:
        """geometry: of binned pixels."""
        across = geometry.centres_x_mm(page.width_mm)
        along = geometry.centres_y_mm(geometry.lines(page.height_mm))
        images = np.zeros((2, along.size, across.size), np.float32)
        about = np.ones((2 * ABOUT_PIXELS + 1,) * 2, np.uint8)
        images[0] = cv2.dilate(zones.holds("ignore", across, along).astype(np.float32), about)
        images[1] = zones.holds("careful", across, along)
        return cls(images=images)

    def moved(self, where: PixelMap) -> NDArray[np.bool_]:
        """The same where the page lies, (2, lines, pixels); careful is what is not ignored."""
        out = np.zeros_like(self.images)
        move_smooth(self.images, np.flatnonzero(self.images.any(axis=(1, 2))), where.across, where.along, out)
        there = out >= 0.5
        there[1] &= ~there[0]
        return there


def ignored_tiles(
    zones: PageZones, page: Page, geometry: ScanGeometry, tile_pixels: int
) -> NDArray[np.bool_]:
    """Which tiles of so many camera pixels a side hold anything that is ignored, (tile rows, tile columns)."""
    across = geometry.centres_x_mm(page.width_mm)
    along = geometry.centres_y_mm(geometry.lines(page.height_mm))
    rows, columns = along.size // tile_pixels, across.size // tile_pixels
    held = zones.holds("ignore", across[: columns * tile_pixels], along[: rows * tile_pixels])
    return np.asarray(held.reshape(rows, tile_pixels, columns, tile_pixels).any(axis=(1, 3)))
