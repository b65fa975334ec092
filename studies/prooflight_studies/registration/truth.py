"""True position of a print, from the values drawn to print it; independent of the registration of its scan."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INKS
from prooflight.prediction.predict import predict
from prooflight.simulation.prints import plane_pixels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.registration.register import Registration
    from prooflight.scans.placement import Placement
    from prooflight.simulation.prints import Print

TRUTH_NOTE: Final = (
    "the sheet's simulated placement and, since content moves with the ink planes, the single shift that is closest "
    "to their simulated register: over all pixels, in units of the noise, weighted by the change of the expected "
    "signal when a plane moves (a plane that is not printed changes nothing). It does not depend on the measured "
    "positions; the measured placement and planes, weighted as in the truth, are compared with it"
)
"""Explanation of the truth on the page of results."""


def printed_at(print_: Print, parts: NDArray[np.float64], page: Page) -> Placement:
    """Return the true position of a print of ``page``; parts (2, 4): ``plane_parts`` of what is printed."""
    return _with_planes(print_.placement, plane_pixels(print_, page) * page.pixel_mm, parts)


def reported_at(result: Registration, parts: NDArray[np.float64]) -> Placement:
    """Return the reported position of the same mix of planes: registration's placement and plane displacements."""
    return _with_planes(result.placement, result.planes_mm, parts)


def _with_planes(place: Placement, planes_mm: NDArray[np.floating], parts: NDArray[np.float64]) -> Placement:
    x, y = np.einsum("ap,pa->a", parts, planes_mm)
    return replace(place, shift_mm=(place.shift_mm[0] + float(x), place.shift_mm[1] + float(y)))


def plane_parts(printed: Page, press: Press) -> NDArray[np.float64]:
    """Return the weight of each plane in a page's apparent position, across and along (2, 4).

    The weights sum to 1, or are 0 if nothing is printed. With g_p the change of the expected signal as plane p moves,
    and g their sum, planes that are displaced by d_p are closest to the whole page displaced by sum(d_p <g_p, g>) / <g,
    g>.
    """
    start = predict(printed, sensors=press.sensors, geometry=press.geometry, threads=1)
    parts = np.zeros((2, INKS))
    for axis in range(2):
        slopes = {
            ink: predict(
                _moved(printed, ink, axis), sensors=press.sensors, geometry=press.geometry, threads=1
            ).expected_dn
            - start.expected_dn
            for ink in range(INKS)
            if printed.cmyk[..., ink].any()
        }
        if not slopes:
            continue
        weighted = sum(slopes.values()) / start.variance_dn2
        weights = {ink: float(np.vdot(slope, weighted)) for ink, slope in slopes.items()}
        parts[axis, list(weights)] = np.array(list(weights.values())) / max(sum(weights.values()), 1e-9)
    return parts


def _moved(page: Page, ink: int, axis: int) -> Page:
    """Move one plane a raster pixel to the right (axis 0) or down (1)."""
    cmyk = page.cmyk.copy()
    cmyk[..., ink] = 0
    if axis == 0:
        cmyk[:, 1:, ink] = page.cmyk[:, :-1, ink]
    else:
        cmyk[1:, :, ink] = page.cmyk[:-1, :, ink]
    return replace(page, cmyk=cmyk)
