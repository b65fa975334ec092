"""Places of a design whose structure is finer than binned pixels resolve: line pairs, guilloches, test charts.

Lines with a period of less than two pixels alias: expected light looks flat where it is not, and a displacement of a
tenth of a pixel changes it by a tenth of full contrast. What residuals are there tells of that alone, so that only
glyphs, whose strokes are known, are inspected there.
"""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.pages.raster import MM_PER_INCH

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.scans.geometry import ScanGeometry

WINDOW: Final = 9
"""Side of the squares over which contrast is measured. [binned pixels]"""
LEAST_CONTRAST: Final = 0.35
"""Standard deviation of the raster's ink within such a square from which its structure matters. Assumed: lines as
wide as their gaps have 0.5, and the corner of a solid, of which thinning makes a row of single pixels, up to 0.34."""
NYQUIST: Final = 0.65
"""Share of that contrast that pixels keep of lines with a period of two pixels: sin(x) / x at x = pi / 2 is 0.64."""
REACH: Final = 5
"""Distance about such places within which windows reach into them. [binned pixels]"""


def unresolved_places(page: Page, thin: Page, geometry: ScanGeometry) -> NDArray[np.float32] | None:
    """Return where the design is finer than binned pixels resolve.

    Parameters
    ----------
    page : the design.
    thin : the same, ``thinned`` for binned pixels.
    geometry : of binned pixels.

    Returns
    -------
    (lines, pixels) 1 at such places of a page in its place, else 0; None if there are none.
    """
    ink = np.asarray(reduce(cv2.max, cv2.split(thin.cmyk)), np.uint8)
    step = geometry.pixel_pitch_mm * thin.dpi / MM_PER_INCH
    side = max(round(WINDOW * step), 2)
    seen = np.asarray(cv2.blur(ink, (max(round(step), 1),) * 2), np.uint8)
    contrast, resolved = _variance(ink, side), _variance(seen, side)
    fine = ((contrast >= (255 * LEAST_CONTRAST) ** 2) & (resolved < NYQUIST**2 * contrast)).view(np.uint8)
    if not fine.any():
        return None
    rows, columns = (
        max(round(extent), 1)
        for extent in (page.height_mm / geometry.line_pitch_mm, page.width_mm / geometry.pixel_pitch_mm)
    )
    small = (cv2.resize(fine.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA) > 0).view(
        np.uint8
    )
    small = cv2.dilate(small, np.ones((2 * REACH + 1,) * 2, np.uint8))
    out = np.zeros((geometry.lines(page.height_mm), geometry.pixels), np.float32)
    top = round(geometry.lead_in_mm / geometry.line_pitch_mm)
    left = round(geometry.left_mm(page.width_mm) / geometry.pixel_pitch_mm)
    column, hidden = max(left, 0), max(-left, 0)  # a page that is wider than the field is cut on both sides
    part = small[: len(out) - top, hidden : hidden + out.shape[1] - column]
    out[top : top + len(part), column : column + part.shape[1]] = part
    return out


def _variance(image: NDArray[np.uint8], side: int) -> NDArray[np.float32]:
    """Return the variance of an image within squares about each of its pixels."""
    mean = cv2.boxFilter(image, cv2.CV_32F, (side, side))
    square = cv2.sqrBoxFilter(image, cv2.CV_32F, (side, side))
    return np.asarray(square - mean * mean, np.float32)
