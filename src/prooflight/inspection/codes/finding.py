"""Detection of a page's codes, once for each design, in the lines that the camera must see of it; zones about them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.base import PlannedPage
from prooflight.inspection.codes.symbols import (
    Profile,
    Symbol,
    grey,
    paper_light,
    profiles,
    symbols_of_page,
    tried,
)

if TYPE_CHECKING:
    from prooflight.pages.job import Job
    from prooflight.pages.zones.zones_file import ZoneEntry
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press
    from prooflight.scans.geometry import ScanGeometry

QUIET_MM: Final = 3.0
"""Margin about a code that is read with it.

It holds quiet zones of common codes at common sizes, and the displacement of a page that was not located.
"""
HARDER_SHIFTS_PIXELS: Final = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
"""Shifts at which a code must read, wherever its bars fall on the camera's pixels, before scans must show it."""
HARDER_BLUR_PIXELS: Final = 0.6
"""Blur beyond the camera's own with which a code must read too, lest a good print alarms.

assumed: the effect of misregistered planes and of the web's jitter on a bar. The camera's noise, a 500th of
white, has less effect.
"""


def page_codes(
    planned: PlannedPage, sensors: tuple[SensorModel, ...], geometry: ScanGeometry
) -> tuple[PageCode, ...]:
    """Find all codes that can be read from the lines which the camera must see of a page.

    Return them from top to bottom.
    """
    expected = planned.expected
    everywhere = slice(0, expected.expected_dn.shape[2])
    light = paper_light(expected.expected_dn, sensors, everywhere)
    codes = [_page_code(one, light, planned, geometry) for one in symbols_of_page(grey(light))]
    return tuple(sorted(codes, key=lambda code: code.corner))


def _page_code(
    symbol: Symbol,
    light: NDArray[np.float32],
    planned: PlannedPage,
    geometry: ScanGeometry,
) -> PageCode:
    corners = np.array(symbol.corners)
    (left, top), (right, bottom) = corners.min(axis=0), corners.max(axis=0)
    quiet = QUIET_MM / np.array([geometry.line_pitch_mm, geometry.pixel_pitch_mm])
    first = np.maximum(np.floor(np.array([top, left]) - quiet), 0).astype(int)
    last = np.minimum(np.ceil(np.array([bottom, right]) + quiet) + 1, light.shape).astype(int)
    cut = slice(first[0], last[0]), slice(first[1], last[1])
    here = replace(symbol, corners=tuple((float(x - first[1]), float(y - first[0])) for x, y in corners))
    x_mm = (left + 0.5) * geometry.pixel_pitch_mm - geometry.left_mm(planned.page.width_mm)
    y_mm = (top + 0.5) * geometry.line_pitch_mm - geometry.lead_in_mm
    size = (right - left) * geometry.pixel_pitch_mm, (bottom - top) * geometry.line_pitch_mm
    return PageCode(
        symbol=here,
        corner=(int(first[0]), int(first[1])),
        light=light[cut].copy(),
        box_mm=(float(x_mm), float(y_mm), float(size[0]), float(size[1])),
        profiles=profiles(light[cut], here),
        sure=_sure(here, light[cut]),
    )


def _sure(symbol: Symbol, light: NDArray[np.float32]) -> bool:
    """Return whether a code reads in harder pictures than good prints make."""
    blurred = cv2.GaussianBlur(light, (0, 0), HARDER_BLUR_PIXELS)
    size = light.shape[1], light.shape[0]
    for across, along in HARDER_SHIFTS_PIXELS:
        moved = cv2.warpAffine(
            blurred, np.array([[1, 0, across], [0, 1, along]]), size, borderMode=cv2.BORDER_REPLICATE
        )
        if not any(one.text == symbol.text for one in tried(grey(moved), symbol.symbology)):
            return False
    return True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageCode:
    """Code of a page, and its place in the camera's lines."""

    symbol: Symbol
    """Code that was read; its corners are in pixels of ``light``."""
    corner: tuple[int, int]
    """First line and column of ``light`` in the scan of a page in its place."""
    light: NDArray[np.float32]
    """Expected light of the code and its quiet zone (lines, columns), bare paper 1."""
    box_mm: tuple[float, float, float, float]
    """Place x, y, width and height on the page as printed, without quiet zone."""
    profiles: tuple[Profile | None, ...]
    """Scan lines of a bar code as they must be seen (``profiles.profiles``)."""
    sure: bool
    """Whether it reads in harder pictures than good prints make: only then must scans show it."""


def code_zones(job: Job, number: int, press: Press) -> list[ZoneEntry]:
    """Return careful zones about all codes of page ``number`` that the press's camera reads, with their quiet zones.

    Errors as ``Job.page`` and ``ScanGeometry.lay``.
    """
    # Files of zones load what reads pictures, which no inspection needs.
    from prooflight.pages.zones.rules import entry_of

    size_mm = job.page_size_mm(number)
    own = job.page(number)
    page = press.geometry.lay(own)
    entries = []
    for code in page_codes(PlannedPage(page, press.press_context()), press.sensors, press.geometry):
        x, y, width, height = code.box_mm
        if page is not own:  # back from a page that was turned as ``pages.raster.turned`` does
            x, y, width, height = y, own.height_mm - x - width, height, width
        box = x - QUIET_MM, y - QUIET_MM, width + 2 * QUIET_MM, height + 2 * QUIET_MM
        entry = entry_of(f"{code.symbol.symbology} {code.symbol.text}", "careful", box, number, size_mm)
        entries += [] if entry is None else [entry]
    return entries
