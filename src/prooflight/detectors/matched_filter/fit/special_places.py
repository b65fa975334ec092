"""Places of a page that the fit and the statistics treat differently, in binned pixels.

Three kinds: designs that are finer than pixels resolve, edges that do not show in the light, and the owner's zones.

Lines with a period of less than two pixels alias (line pairs, guilloches, test charts): expected light looks flat where
it is not, and a displacement of a tenth of a pixel changes it by a tenth of full contrast. Residuals there show that
alone, so that only glyphs, whose strokes are known, are inspected there.

An edge does not show where one ink ends, others begin, and the light is nearly the same, as in test forms, grey balance
charts and photographs. A plane that is slightly out of register opens a gap there, or overlaps, and shows a line that
no slope of the expected light announces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.matched_filter.fit.modes import Modes, PixelMap, moved
from prooflight.kernels.memory import unset
from prooflight.kernels.residuals.page_features import hidden_slopes
from prooflight.kernels.statistics.fine_structure import find_blurred, greatest_inks
from prooflight.pages.raster import MM_PER_INCH, Page

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
    from prooflight.pages.zones.zone import PageZones
    from prooflight.prediction.tables import SensorModel
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
    fine = _fine_structure(thin.packed, geometry.pixel_pitch_mm * thin.dpi / MM_PER_INCH)
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


def _fine_structure(packed: NDArray[np.uint32], step: float) -> NDArray[np.uint8]:
    """Return where the greatest ink has a structure that pixels blur: (rows, columns) 1 there, else 0.

    Parameters
    ----------
    packed : (rows, columns) raster, see ``Page.packed``.
    step : its pixels in a binned pixel.
    """
    side, pixel = max(round(WINDOW * step), 2), max(round(step), 1)
    ink = np.empty(packed.shape, np.uint8)
    greatest_inks(packed, ink)
    fine = np.zeros(packed.shape, np.uint8)
    left, top, width, height = cv2.boundingRect(ink)
    if width == 0:
        return fine
    # As far from ink, squares have none: a page's margins are not searched.
    inked = slice(max(top - side, 0), top + height + side), slice(max(left - side, 0), left + width + side)
    ink = ink[inked]
    before = side // 2
    after = side - 1 - before
    of_ink, of_seen = (
        np.asarray(cv2.copyMakeBorder(image, before, after, before, after, cv2.BORDER_REFLECT_101), np.uint8)
        for image in (ink, cv2.blur(ink, (pixel, pixel)))
    )
    blurred = np.empty(ink.shape, np.uint8)
    find_blurred(
        of_ink, of_seen, side, np.float32((255 * LEAST_CONTRAST) ** 2), np.float32(NYQUIST**2), blurred
    )
    fine[inked] = blurred
    return fine


PLANE_SD: Final = 0.05
"""Displacement of a plane relative to the others that registration and fit leave. [binned pixels] Assumed: half of
the raster's own pixels, by which planes are placed, less what the fit's linear step takes of it."""
LEAST_SLOPE: Final = 0.03
"""Hidden slope that matters somewhere on a page, as a share of white a pixel: that of a place near an edge."""


def hidden_edges(modes: Modes, sensors: Sequence[SensorModel]) -> NDArray[np.float32] | None:
    """Return the squared slope of edges that do not show in the light of a page.

    Parameters
    ----------
    modes : of the page in its nominal place, in binned pixels.
    sensors : of binned pixels.

    Returns
    -------
    (sensors, lines, pixels) by how much the squared slopes of the planes exceed that of their light
    [DN^2/pixel^2]; None where no place has ``LEAST_SLOPE``.
    """
    if np.count_nonzero(modes.cover.any(axis=(1, 2))) < 2:
        return None
    shape = modes.cover.shape[1:]
    out = unset((len(sensors), *shape))
    seen = False
    for index, sensor in enumerate(sensors):
        most = hidden_slopes(modes.gain[index], modes.cover, 0, shape[0], out[index])
        seen |= most >= (LEAST_SLOPE * sensor.white_dn) ** 2
    return out if seen else None


def with_hidden_edges(
    texture: NDArray[np.float32], hidden: NDArray[np.float32] | None, residual_variance: ResidualVariance
) -> NDArray[np.float32]:
    """Return the variance of halftones at unit contrast with that of planes out of register added.

    Neither shows in the slope of the light, so that the fit and the residuals treat them alike.

    Parameters
    ----------
    texture : (sensors, lines, pixels) ``Modes.texture`` [DN^2].
    hidden : (sensors, lines, pixels) ``hidden_edges`` at the same place [DN^2/pixel^2]; None: there are none.
    residual_variance : by whose ``contrast`` the texture is multiplied.
    """
    if hidden is None or residual_variance.contrast <= 0:
        return texture
    return np.asarray(texture + np.float32(PLANE_SD**2 / residual_variance.contrast) * hidden, np.float32)


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
