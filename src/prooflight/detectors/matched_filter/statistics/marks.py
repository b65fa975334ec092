"""Marks: how far small windows of the page deviate, each compared only with places of its own class.

A spot on bare paper is compared with bare paper, not with the edges of letters, where good prints scatter far more.
The class of a place is known from the prediction alone: bare paper, flat tint, gradient or photograph, near an edge,
text or hard edge, border of the page. For each class, each window of ``WINDOWS`` and both signs, the statistic is the
greatest T of the page (``kernels.statistics.marks``) in units of the page's own spread in this class, less what the
greatest of so many independent Gaussian windows is. So a page that is badly placed widens its own limits at edges and
no others.

What differs by more than a stated share of paper white, away from edges and over ``FLOOR_AREA_MM2``, is a misprint
whatever was learned (``Floor``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from scipy.special import ndtri

from prooflight.detectors.matched_filter.statistics.statistic import NOWHERE, Observed, Statistic
from prooflight.kernels.memory import unset
from prooflight.kernels.statistics.marks import (
    CLASSES,
    LEAST_T,
    SIZES,
    STRIP,
    WINDOWS,
    beyond_share,
    slopes,
    window_extremes,
)
from prooflight.pages.parallel import parts_of, shared_out

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.nuisance import PlacedScan
    from prooflight.detectors.matched_filter.statistics.statistic import Box
    from prooflight.scans.geometry import ScanGeometry

PLACE_CLASSES: Final = ("bare", "flat", "gradient", "edge", "text", "border")
"""In the order of the kernel's class numbers; ``NAMES`` says them in words."""
NAMES: Final = {
    "bare": "bare paper",
    "flat": "flat tint",
    "gradient": "gradient or photograph",
    "edge": "near an edge",
    "text": "text or hard edge",
    "border": "border of the page",
}
NOT_INSPECTED: Final = 255
SLOPES: Final = (0.006, 0.03, 0.15)
"""Upper limits of the steepest slope within reach of a place, of flat tint, gradient and edge; beyond it is text.
[shares of white a pixel] Assumed: a flat tint of a smooth raster has less than 0.6 %, letters of 8 pt have 15 % and
more at 0.25 mm."""
BARE_LIGHT: Final = 0.97
"""Share of white's light from which on a place that is no edge is bare paper. (assumed)"""
BORDER_MM: Final = 1.6
"""How wide the border of the page is: what a sheet's own edge and the margin of placement reach. (assumed)"""
REACH: Final = 2
"""Pixels about a window within which an edge counts as near; half the window's side is added."""
REFERENCE_WINDOWS: Final = 1e6
"""Windows of which the greatest T is stated; of fewer, the greatest is taken to be as much higher as Gaussian theory
says ..."""
REFERENCE_T: Final = float(ndtri(1 - 1 / REFERENCE_WINDOWS))
"""... from this on."""
FLOOR_AREA_MM2: Final = 0.1
"""A difference beyond the floor counts from this area on: a spot of 0.36 mm. A pixel more is asked for, since a
region's outline lies anywhere within its pixels: two of 0.25 mm are what the darkest specks of good paper reach."""
FLOOR_FLAT: Final = 0.02
"""Steepest slope within ``REACH`` pixels at which the floor applies. [shares of white a pixel] (assumed)"""
FLOOR_SIGMAS: Final = 6.0
"""What the camera's noise alone reaches in one of 10^9 pixels: on a camera so noisy that 10 % of white is less than
that, the floor asks for more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Places:
    """Classes of a scan's places."""

    of_windows: NDArray[np.uint8]
    """(sizes, lines, pixels) numbers of ``PLACE_CLASSES``, or ``NOT_INSPECTED``, for windows of each of ``WINDOWS``."""
    flat: NDArray[np.uint8]
    """(lines, pixels) 1 where no edge is within ``REACH`` pixels."""

    def areas(self) -> NDArray[np.int64]:
        """(classes, sizes) how many places there are of each."""
        counts = [np.bincount(one.ravel(), minlength=NOT_INSPECTED + 1)[:CLASSES] for one in self.of_windows]
        return np.stack(counts, axis=1)


def classify(
    light: NDArray[np.float32],
    white: NDArray[np.float32],
    inside: NDArray[np.bool_],
    *,
    pixel_mm: float,
    threads: int = 1,
) -> Places:
    """Return the class of every place of a scan, from its expected light alone.

    Parameters
    ----------
    light : (sensors, lines, pixels) expected light of bare columns [DN].
    white : (sensors, pixels) light of bare paper [DN].
    inside : (lines, pixels) what of the page is inspected.
    pixel_mm : pitch of the pixels [mm].
    threads : that share the work.
    """
    slope = unset(inside.shape)
    shared_out(
        [partial(slopes, light, white, *part, slope) for part in parts_of(len(slope), threads)],
        threads=threads,
    )
    paper = (light > np.float32(BARE_LIGHT) * white[:, None]).all(axis=0).view(np.uint8)
    steps = np.zeros(inside.shape, np.uint8)
    for limit in SLOPES:
        steps += slope >= np.float32(limit)
    within = inside.view(np.uint8)
    border = _eroded(within, round(BORDER_MM / pixel_mm), beyond=0) == 0
    found = np.empty((SIZES, *inside.shape), np.uint8)
    for window, classes in zip(WINDOWS, found, strict=True):
        reach = REACH + window // 2
        np.add(cv2.dilate(steps, _square(reach)), np.uint8(1), out=classes)
        bare = _eroded(np.asarray(paper), reach, beyond=1) > 0
        classes[bare & (classes <= PLACE_CLASSES.index("gradient"))] = PLACE_CLASSES.index("bare")
        classes[border] = PLACE_CLASSES.index("border")
        classes[~inside] = NOT_INSPECTED
    steep = (slope >= np.float32(FLOOR_FLAT)).view(np.uint8)
    return Places(of_windows=found, flat=(cv2.dilate(steep, _square(REACH)) == 0).view(np.uint8) & within)


def _square(reach: int) -> NDArray[np.uint8]:
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)


def _eroded(flags: NDArray[np.uint8], reach: int, *, beyond: int) -> NDArray[np.uint8]:
    """Return flags that hold for all places within ``reach``; beyond: what holds outside the image."""
    return np.asarray(
        cv2.erode(flags, _square(reach), borderType=cv2.BORDER_CONSTANT, borderValue=beyond), np.uint8
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloorFinding:
    """The largest region that differs by more than the floor."""

    area_mm2: float
    """0: there is none."""
    box: Box = NOWHERE
    darker: bool = True

    @property
    def alarms(self) -> bool:
        """Whether it makes a misprint."""
        return self.area_mm2 >= FLOOR_AREA_MM2


NO_FLOOR: Final = FloorFinding(area_mm2=0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marks:
    """What small windows of one scan say."""

    greatest: NDArray[np.float64]
    """(classes, sizes, 2) greatest T, lighter and darker; ``LEAST_T`` where none is greater."""
    at: NDArray[np.int64]
    """(classes, sizes, 2, 2) first line and pixel of that window."""
    spread: NDArray[np.float64]
    """(classes, sizes) the page's own spread of T, 1 at least."""
    usual: NDArray[np.float64]
    """(classes, sizes) greatest of so many independent Gaussian T."""
    floor: FloorFinding
    pixel_mm: float
    left_mm: float
    top_mm: float

    def statistics(self) -> list[Observed]:
        """Return a statistic for each class, size and sign, always in the same order."""
        found = []
        for c, place in enumerate(PLACE_CLASSES):
            for s, window in enumerate(WINDOWS):
                for sign, name in enumerate("+-"):
                    value = self.greatest[c, s, sign] / self.spread[c, s] + REFERENCE_T - self.usual[c, s]
                    line, pixel = self.at[c, s, sign]
                    side = window * self.pixel_mm
                    left, top = pixel * self.pixel_mm + self.left_mm, line * self.pixel_mm + self.top_mm
                    box = (
                        (float(left), float(top), side, side)
                        if self.greatest[c, s, sign] > LEAST_T
                        else NOWHERE
                    )
                    which = Statistic("mark", place, sign=name, size=window)
                    found.append(Observed(statistic=which, value=float(value), box=box))
        return found


def measure_marks(
    scan: PlacedScan,
    light: NDArray[np.float32],
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    *,
    geometry: ScanGeometry,
    page_width_mm: float,
    tolerance: float,
    floor_share: float,
    threads: int = 1,
) -> Marks:
    """Return what small windows of a scan's residuals say.

    Parameters
    ----------
    scan : the scan and where its page lies.
    light : (sensors, lines, pixels) expected light of bare columns [DN].
    left : (sensors, lines, pixels) residuals without what good prints do [DN].
    weight : (sensors, lines, pixels) inverse variance of residuals [1/DN^2].
    geometry : where the pixels lie.
    page_width_mm : width of the page [mm].
    tolerance : standard deviation of what moves all light of a window alike, a share of the light.
    floor_share : share of paper white beyond which a flat place counts for the floor; 0: there is no floor.
    threads : that share the work.
    """
    white = np.stack([one.white_dn * one.column_gain for one in scan.sensors]).astype(np.float32)
    places = classify(light, white, scan.where.inside, pixel_mm=geometry.pixel_pitch_mm, threads=threads)
    lines = left.shape[1]
    parts = [
        (STRIP * first, min(STRIP * last, lines)) for first, last in parts_of(-(-lines // STRIP), threads)
    ]
    most = np.zeros((len(parts), CLASSES, SIZES, 2))
    at = np.zeros((len(parts), CLASSES, SIZES, 2, 2), np.int64)
    beyond = np.zeros((len(parts), CLASSES, SIZES), np.int64)
    fixed = left, weight, light, places.of_windows, np.float32(tolerance**2)
    shared_out(
        [partial(window_extremes, *fixed, *part, most[n], at[n], beyond[n]) for n, part in enumerate(parts)],
        threads=threads,
    )
    best = most.argmax(axis=0)
    channels = len(left) + (len(left) > 1)
    windows = places.areas() * channels
    left_mm, top_mm = -geometry.left_mm(page_width_mm), -geometry.lead_in_mm
    corner = left_mm, top_mm, geometry.pixel_pitch_mm
    return Marks(
        greatest=np.maximum(np.sqrt(most.max(axis=0)), LEAST_T),
        at=np.take_along_axis(at, best[None, ..., None], axis=0)[0],
        spread=_spread(beyond.sum(axis=0), windows),
        usual=usual_t(windows / np.square(WINDOWS)),
        floor=_floor(left, weight, white, places.flat, floor_share, corner, threads)
        if floor_share
        else NO_FLOOR,
        pixel_mm=geometry.pixel_pitch_mm,
        left_mm=left_mm,
        top_mm=top_mm,
    )


def _spread(beyond: NDArray[np.int64], windows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return how many times wider than a standard Gaussian T scatters, from how often it exceeds ``LEAST_T``."""
    share = (beyond + 1) / (windows + 100)  # as if one of a hundred more had exceeded it
    return np.maximum(float(LEAST_T) / ndtri(1 - np.minimum(share, 0.9) / 2), 1.0)


def usual_t(windows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the greatest T that so many independent Gaussian windows have: the quantile at 1 - 1 / n."""
    return np.asarray(ndtri(1 - 1 / np.maximum(windows, 3.0)))


def least_pixels(pixel_mm: float) -> int:
    """Return how many pixels a region must have for the floor."""
    return int(np.ceil(FLOOR_AREA_MM2 / pixel_mm**2 - 1e-9)) + 1


def _floor(
    left: NDArray[np.float32],
    weight: NDArray[np.float32],
    white: NDArray[np.float32],
    flat: NDArray[np.uint8],
    share: float,
    corner: tuple[float, float, float],
    threads: int,
) -> FloorFinding:
    """Return the largest connected region of flat pixels of one sign that differ by more than ``share`` of white."""
    flags = np.empty((2, *flat.shape), np.uint8)
    fixed = left, weight, white, flat, np.float32(share), np.float32(FLOOR_SIGMAS)
    counts = shared_out(
        [partial(beyond_share, *fixed, *part, flags) for part in parts_of(len(flat), threads)],
        threads=threads,
    )
    left_mm, top_mm, pixel_mm = corner
    least = least_pixels(pixel_mm)
    found = NO_FLOOR
    if sum(counts) < least:
        return found
    for darker, one in enumerate(flags):
        _, _, regions, _ = cv2.connectedComponentsWithStats(one, connectivity=8)
        regions = regions[1:]
        if not len(regions):
            continue
        x, y, width, height, area = (int(value) for value in regions[regions[:, cv2.CC_STAT_AREA].argmax()])
        if area >= least and area * pixel_mm**2 > found.area_mm2:
            box = x * pixel_mm + left_mm, y * pixel_mm + top_mm, width * pixel_mm, height * pixel_mm
            found = FloorFinding(area_mm2=area * pixel_mm**2, box=box, darker=bool(darker))
    return found
