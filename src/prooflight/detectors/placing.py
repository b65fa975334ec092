"""Consequences of a page's placement: the part of its scan that is judged, and whether it is another page."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.base import BLOCK_PIXELS, Area

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.registration.register import Registration
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement

WRONG_PAGE_KIND: Final = "wrong-page"
EDGE_PIXELS: Final = 1.0
"""Margin inside the edges of a page that was moved: sheet and print do not move together. [camera pixels]"""


def inside(page: Page, geometry: ScanGeometry, placement: Placement, *, lines: int) -> Area:
    """Return the lines (of ``lines``) and columns whose pixels are all on the page at its placement.

    A margin of ``EDGE_PIXELS`` along the page's edges is left out. If fewer pixels are left than a block has,
    the area is that of the page in its nominal place.
    """
    across_mm = geometry.centres_x_mm(page.width_mm)
    down_mm = geometry.centres_y_mm(lines)
    seen = partial(placement.seen_mm, page_width_mm=page.width_mm, page_height_mm=page.height_mm)
    margin_x, margin_y = EDGE_PIXELS * geometry.pixel_pitch_mm, EDGE_PIXELS * geometry.line_pitch_mm
    on_columns, on_lines = np.ones(across_mm.size, bool), np.ones(down_mm.size, bool)
    for part in (0.0, 0.5, 1.0):
        x_mm, _ = seen(across_mm, np.full_like(across_mm, part * page.height_mm))
        on_columns &= (x_mm >= margin_x) & (x_mm <= page.width_mm - margin_x)
        _, y_mm = seen(np.full_like(down_mm, part * page.width_mm), down_mm)
        on_lines &= (y_mm >= margin_y) & (y_mm <= page.height_mm - margin_y)
    columns, rows = np.flatnonzero(on_columns), np.flatnonzero(on_lines)
    if min(columns.size, rows.size) < BLOCK_PIXELS:
        return geometry.on_page(page.width_mm, page.height_mm)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def shift_of(registration: Registration) -> tuple[float, float] | None:
    """Return the page's position minus the nominal one, x and y [mm]; None: it could not be found."""
    x, y = registration.placement.shift_mm
    return (round(x, 4), round(y, 4)) if registration.located else None


def shows_another(registration: Registration) -> bool:
    """Return whether a scan shows another page, or its own where no good print is."""
    return registration.off_place or registration.foreign


def unplaced_reason(registration: Registration) -> str:
    """Return why a page is not inspected, in words."""
    return f"the position of the page is not known: {registration.reason}"


def place_reason(registration: Registration) -> str:
    """Return why a scan shows another page, or its own where no good print is."""
    if registration.turned:
        return "the page is turned by 180 degrees"
    if registration.foreign:
        return "the scan shows another page: its content is not predicted by this one"
    if not registration.located:
        return f"the scan does not show this page: {registration.reason or 'the content of the scan differs'}"
    x, y = registration.placement.shift_mm
    return f"the page is {x:+.1f}, {y:+.1f} mm and {registration.placement.skew_deg:+.2f} degrees off its position"
