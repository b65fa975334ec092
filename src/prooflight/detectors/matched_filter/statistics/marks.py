"""Marks: how far small windows of the page deviate, each compared only with places of its own class.

A spot on bare paper is compared with bare paper, not with the edges of letters, where good prints scatter far
more. The class of a place depends on the prediction alone: bare paper, flat tint, gradient or photograph,
near an edge, text or hard edge, border of the page. For each class, each window of ``WINDOWS`` and both
signs, the statistic is the greatest T of the page (``kernels.statistics.marks``) in units of the page's own
spread in this class, less the greatest T of as many independent Gaussian windows. A badly placed page
therefore widens its own limits at edges, and nowhere else.

A difference by more than a stated share of paper white, away from edges and over ``FLOOR_AREA_MM2``, is a
misprint whatever was learned, unless it is no more than a benign speck (``FloorFinding``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from prooflight.detectors.cost import FLOOR_AREA_MM2
from prooflight.detectors.matched_filter.statistics.statistic import NOWHERE, Box, Observed, Statistic
from prooflight.kernels.statistics.marks import (
    CLASSES,
    LEAST_T,
    OF_DESIGN,
    ROUGH,
    SIZES,
    WINDOWS,
    beyond_share,
    classes_of,
    spread_traits,
    traits_of,
    window_extremes,
)
from prooflight.pages.parallel import parts_of, shared_out
from prooflight.registration.landmarks import light_left

if TYPE_CHECKING:
    from prooflight.detectors.print_prior import PrintPrior
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry

PLACE_CLASSES: Final = ("bare", "flat", "gradient", "edge", "text", "border")
"""Class names in the order of the kernel's class numbers; ``NAMES`` describes them."""
NAMES: Final = {
    "bare": "bare paper",
    "flat": "flat tint",
    "gradient": "gradient or photograph",
    "edge": "near an edge",
    "text": "text or hard edge",
    "border": "border of the page",
}
SLOPES: Final = (0.006, 0.03, 0.15)
"""Upper limits of the steepest slope within reach of a place, for flat tint, gradient and edge; text is
beyond. [shares of white a pixel] Assumed: a flat tint of a smooth raster has less than 0.6 %, letters of 8 pt
have 15 % and more at 0.25 mm."""
BARE_LIGHT: Final = 0.85
"""Share of white's light from which a place without an edge counts as bare paper: a light tint varies as paper
does. (assumed)"""
BORDER_MM: Final = 1.6
"""Width of the page's border: the extent of a sheet's own edge and of the margin of placement. (assumed)"""
REACH: Final = 2
"""Distance from a window within which an edge counts as near; half the window's side is added. [pixels]"""
REFERENCE_WINDOWS: Final = 1e6
"""Number of windows to which the greatest T is normalised; of fewer windows, the greatest is raised by the
difference that Gaussian theory states relative to ``REFERENCE_T``."""
REFERENCE_T: Final = float(ndtri(1 - 1 / REFERENCE_WINDOWS))
"""Gaussian quantile of the greatest of ``REFERENCE_WINDOWS`` windows."""
LIGHTER, DARKER = 0, 1
"""Signs of a deviation, as indices."""
FLOOR_FLAT: Final = 0.02
"""Steepest slope within ``REACH`` pixels at which the floor applies. [shares of white a pixel] (assumed)"""
FLOOR_SIGMAS: Final = 6.0
"""Standard deviations that the camera's noise alone reaches in one of 10^9 pixels: if these exceed 10 % of
white, the floor is raised to them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Places:
    """Classes of a scan's places."""

    of_windows: NDArray[np.uint8]
    """(sizes, lines, pixels) index in ``PLACE_CLASSES``, or ``NOT_INSPECTED``, for windows of each of
    ``WINDOWS``."""
    flat: NDArray[np.uint8]
    """(lines, pixels) 1 where no edge is within ``REACH`` pixels."""
    areas: NDArray[np.int64]
    """(classes, sizes) number of places of each class and window."""


def classify(
    light: NDArray[np.float32],
    white: NDArray[np.float32],
    inside: NDArray[np.bool_],
    *,
    pixel_mm: float,
    unresolved: NDArray[np.bool_] | None = None,
    hidden: NDArray[np.float32] | None = None,
    edges_in_border: bool = False,
    threads: int = 1,
) -> Places:
    """Return the class of every place of a scan, from its expected light alone.

    Parameters
    ----------
    light : (sensors, lines, pixels) expected light of bare columns [DN].
    white : (sensors, pixels) light of bare paper [DN].
    inside : (lines, pixels) inspected part of the page.
    pixel_mm : pitch of the pixels [mm].
    unresolved : (lines, pixels) places of which windows say nothing (``unresolved_places``); None: there are none.
    hidden : (sensors, lines, pixels) squared slope of edges that do not show in the light (``hidden_edges``)
        [DN^2/pixel^2]; None: there are none.
    edges_in_border : whether places near the design's edges are of the edges' classes in the page's border too.
    threads : number of threads that share the work.
    """
    within, parts = inside.view(np.uint8), parts_of(len(inside), threads)
    edges = np.empty((0, *inside.shape), np.float32) if hidden is None else hidden
    limits = np.array(SLOPES, np.float32), np.float32(BARE_LIGHT), np.float32(FLOOR_FLAT)
    here, near, wider = np.empty((3, *inside.shape), np.uint8)
    shared_out(
        [partial(traits_of, light, white, edges, within, *limits, *part, here) for part in parts],
        threads=threads,
    )
    border = _eroded(within, round(BORDER_MM / pixel_mm), beyond=0)
    of_border = OF_DESIGN if edges_in_border else np.uint8(0)
    classes = np.empty((SIZES, *inside.shape), np.uint8)
    areas = np.zeros((len(parts), SIZES, CLASSES), np.int64)
    reach, flat = 0, within
    for size, window in enumerate(WINDOWS):
        more = REACH + window // 2 - reach
        shared_out([partial(spread_traits, here, more, *part, near) for part in parts], threads=threads)
        inspected = _without(within, unresolved, window // 2)
        fixed = near, of_border, border, inspected
        shared_out(
            [
                partial(classes_of, *fixed, *part, classes[size], areas[n, size])
                for n, part in enumerate(parts)
            ],
            threads=threads,
        )
        if size == 0:
            flat = ((near & ROUGH) == 0).view(np.uint8) & inspected
        reach += more
        here, near = near, wider if size == 0 else here
    return Places(of_windows=classes, flat=flat, areas=areas.sum(axis=0).T)


def _without(
    within: NDArray[np.uint8], unresolved: NDArray[np.bool_] | None, reach: int
) -> NDArray[np.uint8]:
    """Return places of ``within`` that are further from unresolved ones than ``reach``."""
    if unresolved is None:
        return within
    return np.asarray(within & (cv2.dilate(unresolved.view(np.uint8), _square(reach)) == 0).view(np.uint8))


def _square(reach: int) -> NDArray[np.uint8]:
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)


def _eroded(flags: NDArray[np.uint8], reach: int, *, beyond: int) -> NDArray[np.uint8]:
    """Return flags that hold for all places within ``reach``; beyond: value outside the image."""
    return np.asarray(
        cv2.erode(flags, _square(reach), borderType=cv2.BORDER_CONSTANT, borderValue=beyond), np.uint8
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloorFinding:
    """The largest region that differs by more than the floor."""

    area_mm2: float
    """Area of the region; 0: there is none."""
    box: Box = NOWHERE
    darker: bool = True

    @property
    def alarms(self) -> bool:
        """Whether the region makes the page a misprint."""
        return self.area_mm2 >= FLOOR_AREA_MM2


NO_FLOOR: Final = FloorFinding(area_mm2=0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marks:
    """Extremes of small windows of one scan."""

    greatest: NDArray[np.float64]
    """(classes, sizes, 2) greatest T, lighter and darker; ``LEAST_T`` if none is greater."""
    at: NDArray[np.int64]
    """(classes, sizes, 2, 2) first line and pixel of that window."""
    spread: NDArray[np.float64]
    """(classes, sizes) the page's own spread of T, 1 at least."""
    usual: NDArray[np.float64]
    """(classes, sizes) greatest T of as many independent Gaussian windows."""
    floor: FloorFinding
    pixel_mm: float
    left_mm: float
    top_mm: float

    def statistics(self) -> list[Observed]:
        """Return a statistic for each class, size and sign, always in the same order."""
        values = self.greatest / self.spread[..., None] + REFERENCE_T - self.usual[..., None]
        exceeds = self.greatest > LEAST_T
        # Lists, because numbers from arrays cost more than all else here.
        seen = zip(
            values.ravel().tolist(), exceeds.ravel().tolist(), self.at.reshape(-1, 2).tolist(), strict=True
        )
        result = []
        for (place, window, sign), (value, located, (line, pixel)) in zip(
            product(PLACE_CLASSES, WINDOWS, "+-"), seen, strict=True
        ):
            side = window * self.pixel_mm
            left, top = pixel * self.pixel_mm + self.left_mm, line * self.pixel_mm + self.top_mm
            which = Statistic("mark", place, sign=sign, size=window)
            box = (left, top, side, side) if located else NOWHERE
            result.append(Observed(statistic=which, value=value, box=box))
        return result


def measure_marks(
    sensors: Sequence[SensorModel],
    inside: NDArray[np.bool_],
    light: NDArray[np.float32],
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    *,
    geometry: ScanGeometry,
    page_width_mm: float,
    unresolved: NDArray[np.bool_] | None = None,
    hidden: NDArray[np.float32] | None = None,
    edges_in_border: bool = False,
    tolerance: float,
    specks: NDArray[np.float32],
    floor_share: float,
    threads: int = 1,
) -> Marks:
    """Measure the extremes of small windows of a scan's residuals.

    Parameters
    ----------
    sensors : of these pixels.
    inside : (lines, pixels) inspected part of the page.
    light : (sensors, lines, pixels) expected light of bare columns [DN].
    left : (sensors, lines, pixels) residuals without the variation of good prints [DN].
    weight : (sensors, lines, pixels) inverse variance of residuals [1/DN^2].
    geometry : of the pixels.
    page_width_mm : width of the page [mm].
    unresolved, hidden, edges_in_border : see ``classify``.
    tolerance : standard deviation of a change common to all light of a window, as a share of the light.
    specks : (sizes,) see ``speck_shares``.
    floor_share : share of paper white beyond which a flat place counts for the floor; 0: there is no floor.
    threads : number of threads that share the work.
    """
    white = np.stack([one.white_dn * one.column_gain for one in sensors]).astype(np.float32)
    pixel_mm = geometry.pixel_pitch_mm
    places = classify(
        light,
        white,
        inside,
        pixel_mm=pixel_mm,
        unresolved=unresolved,
        hidden=hidden,
        edges_in_border=edges_in_border,
        threads=threads,
    )
    parts = parts_of(left.shape[1], threads)
    most = np.zeros((len(parts), CLASSES, SIZES, 2))
    at = np.zeros((len(parts), CLASSES, SIZES, 2, 2), np.int64)
    beyond = np.zeros((len(parts), CLASSES, SIZES), np.int64)
    fixed = left, weight, light, places.of_windows, np.float32(tolerance**2), specks
    shared_out(
        [partial(window_extremes, *fixed, *part, most[n], at[n], beyond[n]) for n, part in enumerate(parts)],
        threads=threads,
    )
    best = most.argmax(axis=0)
    channels = len(left) + (len(left) > 1)
    windows = places.areas * channels
    left_mm, top_mm = -geometry.left_mm(page_width_mm), -geometry.lead_in_mm
    corner = left_mm, top_mm, geometry.pixel_pitch_mm
    return Marks(
        greatest=np.maximum(np.sqrt(most.max(axis=0)), LEAST_T),
        at=np.take_along_axis(at, best[None, ..., None], axis=0)[0],
        spread=_spread(beyond.sum(axis=0), windows),
        usual=usual_t(windows / np.square(WINDOWS)),
        floor=_floor(left, weight, white, places.flat, floor_share, specks, corner, threads)
        if floor_share
        else NO_FLOOR,
        pixel_mm=geometry.pixel_pitch_mm,
        left_mm=left_mm,
        top_mm=top_mm,
    )


def speck_shares(prior: PrintPrior, sensors: Sequence[SensorModel], pixel_mm: float) -> NDArray[np.float32]:
    """Return the share of its light that the darkest benign speck takes from a window of each size, (sizes,).

    Paper has specks, so that no smaller darkening is evidence of a misprint. A speck of some ink takes more
    light than its share of ink, by dot gain: 12 % of black some 19 %.
    """
    ink = round(255 * prior.speck_share)
    taken = max(1 - light_left(sensor)[:, ink].min() for sensor in sensors)
    areas_mm2 = np.square(np.array(WINDOWS) * pixel_mm)
    return np.asarray(taken * np.minimum(prior.speck_mm2 / areas_mm2, 1), np.float32)


def _spread(beyond: NDArray[np.int64], windows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the scatter of T over a standard Gaussian's, from how often it exceeds ``LEAST_T``."""
    share = (beyond + 1) / (windows + 100)  # regularised as if 1 of 100 more windows had exceeded it
    return np.maximum(float(LEAST_T) / ndtri(1 - np.minimum(share, 0.9) / 2), 1.0)


def usual_t(windows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the greatest T of a number of independent Gaussian windows: the quantile at 1 - 1 / n."""
    return np.asarray(ndtri(1 - 1 / np.maximum(windows, 3.0)))


def least_pixels(pixel_mm: float) -> int:
    """Return the minimum number of pixels of a region for the floor."""
    return int(np.ceil(FLOOR_AREA_MM2 / pixel_mm**2 - 1e-9)) + 1


def _floor(
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    white: NDArray[np.float32],
    flat: NDArray[np.uint8],
    share: float,
    specks: NDArray[np.float32],
    corner: tuple[float, float, float],
    threads: int,
) -> FloorFinding:
    """Return the largest region of flat pixels of one sign that differ by more than ``share`` of white.

    A region that is no darker than benign specks are counts only where it is larger than these.
    """
    left_mm, top_mm, pixel_mm = corner
    least = least_pixels(pixel_mm)
    of_speck = float(specks[-1]) * (WINDOWS[-1] * pixel_mm) ** 2 / max(float(specks[0]), 1e-9)
    larger = max(least, int(np.ceil(of_speck / pixel_mm**2)) + 1)
    flags = np.empty((2, *flat.shape), np.uint8)

    def marked(beyond: float) -> int:
        fixed = left, weight, white, flat, np.float32(beyond), np.float32(FLOOR_SIGMAS)
        parts = parts_of(len(flat), threads)
        return sum(
            shared_out([partial(beyond_share, *fixed, *part, flags) for part in parts], threads=threads)
        )

    def largest(pixels: int, sign: int) -> FloorFinding:
        column, row, columns, rows = cv2.boundingRect(flags[sign])
        if not rows:
            return NO_FLOOR
        # Regions of the whole page take 9 ms.
        marks = flags[sign, row : row + rows, column : column + columns]
        regions = cv2.connectedComponentsWithStats(marks, connectivity=8)[2][1:]
        x, y, width, height, area = (int(value) for value in regions[regions[:, cv2.CC_STAT_AREA].argmax()])
        if area < pixels:
            return NO_FLOOR
        x, y = x + column, y + row
        box = x * pixel_mm + left_mm, y * pixel_mm + top_mm, width * pixel_mm, height * pixel_mm
        return FloorFinding(area_mm2=area * pixel_mm**2, box=box, darker=sign == DARKER)

    if marked(share) < least:
        return NO_FLOOR
    findings = [largest(least, LIGHTER), largest(larger, DARKER)]
    if specks[0] <= share or marked(float(specks[0])) >= least:
        findings.append(largest(least, DARKER))
    return max(findings, key=lambda one: one.area_mm2)
