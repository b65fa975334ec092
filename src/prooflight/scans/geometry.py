"""Geometry of camera pixels on the page.

(0, 0) is the page's top-left corner as printed; x across the web, y along the travel. A scan's first line
lies above the page's top edge by the lead-in, the page is centred in the field, and beyond it the camera sees
the backing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from prooflight.errors import JobError
from prooflight.files.fields import NO_OTHER_FIELDS, Lead, Pitch
from prooflight.pages.raster import MM_PER_INCH, Page, turned

LEAST_MM: Final = 5.0
LEAST_PIXELS: Final = 32
"""Least size of pages that are inspected, either way: registration needs a tile of so many pixels to find
them, and within margins of 5 mm the detector has nothing left to test."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanGeometry:
    """Pitch and extent of the camera's pixels on the page."""

    __pydantic_config__: ClassVar = NO_OTHER_FIELDS

    pixels: Annotated[int, Field(strict=True, ge=1, le=65536)]
    """Pixels in a line."""
    pixel_pitch_mm: Pitch
    line_pitch_mm: Pitch
    lead_in_mm: Lead
    """Backing above the page in every scan. [mm]"""
    lead_out_mm: Lead
    """Backing below the page in every scan. [mm]"""

    @property
    def field_mm(self) -> float:
        """Width of paper that a line covers. [mm]"""
        return self.pixels * self.pixel_pitch_mm

    def raster_dpi(self, supersampling: float) -> float:
        """Return the resolution of a raster with ``supersampling`` pixels across one camera pixel. [pixels/inch]"""
        return MM_PER_INCH * supersampling / self.pixel_pitch_mm

    def lines(self, page_height_mm: float) -> int:
        """Return the number of lines in the scan of a page."""
        return int(np.ceil((self.lead_in_mm + page_height_mm + self.lead_out_mm) / self.line_pitch_mm))

    def left_mm(self, page_width_mm: float) -> float:
        """Return the distance from the field's left end to the page's left edge. [mm]"""
        return (self.field_mm - page_width_mm) / 2

    def centres_x_mm(self, page_width_mm: float, *, shift_mm: float = 0.0) -> NDArray[np.float64]:
        """Return each column's centre on a page, (pixels,); shift_mm: displacement of the page to the right. [mm]"""
        return (
            (np.arange(self.pixels, dtype=np.float64) + 0.5) * self.pixel_pitch_mm
            - self.left_mm(page_width_mm)
            - shift_mm
        )

    def centres_y_mm(self, lines: int, *, shift_mm: float = 0.0) -> NDArray[np.float64]:
        """Return each line's centre on a page, (lines,); shift_mm: displacement of the page downwards. [mm]"""
        return (np.arange(lines, dtype=np.float64) + 0.5) * self.line_pitch_mm - self.lead_in_mm - shift_mm

    def on_page(self, page_width_mm: float, page_height_mm: float) -> tuple[slice, slice]:
        """Return lines and columns of a scan whose whole pixel is on a page at its nominal place."""
        x = self.centres_x_mm(page_width_mm)
        y = self.centres_y_mm(self.lines(page_height_mm))
        half_x, half_y = self.pixel_pitch_mm / 2, self.line_pitch_mm / 2
        columns = np.flatnonzero((x >= half_x) & (x <= page_width_mm - half_x))
        lines = np.flatnonzero((y >= half_y) & (y <= page_height_mm - half_y))
        return slice(int(lines[0]), int(lines[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)

    def sees(self, width_mm: float) -> bool:
        """Return whether a page so wide lies within the field, to a pixel."""
        return width_mm <= self.field_mm + self.pixel_pitch_mm

    @property
    def least_mm(self) -> float:
        """Least width and height of a page that is inspected. [mm]"""
        return max(LEAST_MM, LEAST_PIXELS * max(self.pixel_pitch_mm, self.line_pitch_mm))

    def lay(self, page: Page) -> Page:
        """Return the page as it enters the press, turned by 90 degrees if only that fits.

        JobError: it fits neither way, or is too small to be inspected.
        """
        if min(page.width_mm, page.height_mm) < self.least_mm:
            what = f"is {page.width_mm:.2f} x {page.height_mm:.2f} mm"
            remedy = f"this press judges pages from {self.least_mm:.1f} x {self.least_mm:.1f} mm on"
            raise JobError(f"page {page.number}", what, remedy=remedy)
        if self.sees(page.width_mm):
            return page
        if self.sees(page.height_mm):
            return turned(page)
        what = f"is {page.width_mm:.1f} x {page.height_mm:.1f} mm"
        remedy = f"this press sees {self.field_mm:.1f} mm across; build a press with more pixels"
        raise JobError(f"page {page.number}", what, remedy=remedy)
