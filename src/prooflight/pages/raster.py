"""A page to be printed: its CMYK raster, resolution and identity."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from prooflight.pages.warnings import PageWarning

MM_PER_INCH = 25.4
POINTS_PER_INCH = 72
SHOWN_PX = 360


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Page:
    """One page of a job as the press receives it.

    (0, 0) is the page's top-left corner as printed; x runs across the web (columns), y along the travel
    (rows).
    """

    cmyk: NDArray[np.uint8]
    """CMYK values (rows, columns, 4), 0 = no ink, 255 = full ink; C-contiguous."""
    dpi: float
    """Raster resolution, the same in x and y. [pixels/inch]"""
    name: str
    """File-name stem that this page's scans and verdicts carry, e.g. ``p0007``."""
    number: int
    """Number of the page in the job, from 1."""
    edge_sd_mm: float = 0.0
    """Displacement of printed edges from those of the raster, because the press rips the page itself;
    standard deviation. [mm]"""
    warnings: tuple[PageWarning, ...] = ()
    """Deviations of the print, certain or possible, from its file; a side of a sheet has those of its pages."""

    def __post_init__(self) -> None:
        if (
            self.cmyk.dtype != np.uint8
            or self.cmyk.ndim != 3
            or self.cmyk.shape[2] != 4
            or not self.cmyk.size
        ):
            message = f"cmyk must be uint8 (rows, columns, 4), got {self.cmyk.dtype} {self.cmyk.shape}"
            raise ValueError(message)
        if not self.dpi > 0:
            message = f"dpi must be above 0, got {self.dpi}"
            raise ValueError(message)

    @property
    def pixel_mm(self) -> float:
        """Side of one raster pixel on paper. [mm]"""
        return MM_PER_INCH / self.dpi

    @property
    def packed(self) -> NDArray[np.uint32]:
        """Recipes (rows, columns), one 32-bit word each with cyan in the lowest byte."""
        return np.asarray(np.ascontiguousarray(self.cmyk).view(np.uint32)[:, :, 0])

    @property
    def width_mm(self) -> float:
        """Extent across the web. [mm]"""
        return self.cmyk.shape[1] * self.pixel_mm

    @property
    def height_mm(self) -> float:
        """Extent along the travel. [mm]"""
        return self.cmyk.shape[0] * self.pixel_mm

    def _repr_png_(self) -> bytes:
        """Return the picture for notebooks: at most ``SHOWN_PX`` a side, never enlarged, in generic colours.

        Each ink removes its share of red, green or blue, and black of all, as screens show CMYK without a
        profile.
        """
        import cv2  # imported late, as Pillow is: only this needs them
        from PIL import Image

        rows, columns = self.cmyk.shape[:2]
        scale = min(SHOWN_PX / max(rows, columns), 1.0)
        size = max(round(columns * scale), 1), max(round(rows * scale), 1)
        left = 1 - cv2.resize(self.cmyk, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
        file = io.BytesIO()
        Image.fromarray(np.rint(255 * left[..., :3] * left[..., 3:]).astype(np.uint8)).save(file, "PNG")
        return file.getvalue()


def turned(page: Page) -> Page:
    """Return the page turned by 90 degrees clockwise, as seen: its left edge becomes the top edge, at row 0.

    This is for pages wider than the camera's field that fit the other way round. Name and number stay.
    """
    return replace(page, cmyk=np.ascontiguousarray(np.rot90(page.cmyk, k=-1)))
