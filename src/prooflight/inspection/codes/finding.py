"""Detection of a page's codes, once for each design, in the lines that the camera must see of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.inspection.codes.light import grey, paper_light
from prooflight.inspection.codes.page_code import PageCode
from prooflight.inspection.codes.profiles import profiles
from prooflight.inspection.codes.symbols import symbols, tried

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import PlannedPage
    from prooflight.inspection.codes.symbols import Symbol
    from prooflight.prediction.tables import SensorModel
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
    symbols_read = symbols(grey(light))
    codes = [_page_code(one, light, planned, geometry) for one in symbols_read]
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
