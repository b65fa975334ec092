"""Detection of a printed chart in a scan: its four marks, its orientation, and its page.

A mark is a black square with a white square of a third of its side in the middle; that holds at any size and
turn, so neither resolution nor lead-in need be known. Four of them (three suffice) in the right places make a
chart; the bar next to the first and the page number give its orientation. Then the edges of the marks locate
it to a fraction of a pixel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from prooflight.errors import ScanError

if TYPE_CHECKING:
    from prooflight.commissioning.chart.scan import ChartScan
    from prooflight.inks.chart_layout import Box, Layout

_SEARCH_PIXELS: Final = 1800  # pixels of the longer side in which marks are looked for; a mark has 30 or more
_BLACK: Final = 0.45  # of the paper's light, in the brightest sensor
_MISPLACED: Final = 0.02  # of the chart's diagonal, what a paper's stretch and unequal pitches leave at most
_REACH_MM: Final = 0.9  # either side of a mark's edge; its white square is 2 mm wide
_STEP_MM: Final = 0.02
_ROUNDS: Final = 3
_BITS: Final = 8
_REMEDY: Final = "scan the whole page that `chart make` made, all four marks, flat and not mirrored"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectedChart:
    """Page of a chart in a scan."""

    page: int
    """Number of the page, from 1."""
    to_pixel: NDArray[np.float64]
    """Affine map (2, 3) from (x, y, 1) on the chart [mm] to (column, line) [pixels], whole numbers at pixel centres."""
    residual_px: float
    """Rms distance of the marks' edges from their place by the map."""
    marks: int
    """Number of the four marks that were detected."""

    @property
    def to_chart(self) -> NDArray[np.float64]:
        """Return the inverse map, (2, 3)."""
        return np.asarray(cv2.invertAffineTransform(self.to_pixel), dtype=np.float64)

    @property
    def pitch_mm(self) -> tuple[float, float]:
        """Return the distances between neighbouring columns and between neighbouring lines, on the page. [mm]"""
        back = self.to_chart[:, :2]
        return float(np.hypot(*back[:, 0])), float(np.hypot(*back[:, 1]))

    @property
    def turn_deg(self) -> float:
        """Return the chart's clockwise rotation as seen in the scan, -180..180. [degree]"""
        return float(np.rad2deg(np.arctan2(self.to_pixel[1, 0], self.to_pixel[0, 0])))


def relative_light(scan: ChartScan) -> NDArray[np.float32]:
    """Return the light of the brightest sensor over that of paper, (lines, pixels).

    Black is dark in all sensors, no colour is.
    """
    coarse = scan.dn[:, ::7, ::7].reshape(len(scan.dn), -1)
    paper = np.maximum(np.percentile(coarse, 97, axis=1), 1e-6)
    return (scan.dn / paper[:, None, None].astype(np.float32)).max(axis=0)


def find_chart(scan: ChartScan, layout: Layout) -> DetectedChart:
    """Find a page of a chart of ``layout``; ScanError if there is none, or one of another layout."""
    light = relative_light(scan)
    stretch = (1.0, 1.0) if scan.dpi is None else (1.0, scan.dpi[0] / scan.dpi[1])
    candidates = _squares(light, stretch)
    if len(candidates) < 3:
        what = f"no chart found: {len(candidates)} of its 4 marks"
        raise ScanError(scan.path, what, remedy=_REMEDY)
    places = list(_placements(candidates, layout, stretch))
    if not places:
        what = "no chart found: the marks in it are not where this chart has them"
        raise ScanError(scan.path, what, remedy="give the recipe file of the chart that was scanned")
    most = max(marks for _, marks, _ in places)
    for to_pixel, marks, _ in sorted(places, key=lambda place: place[2]):
        page = _page(light, to_pixel, layout) if marks == most else None
        if page is not None:
            refined, residual = _refined(light, to_pixel, layout)
            return DetectedChart(page=page, to_pixel=refined, residual_px=residual, marks=marks)
    what = "marks of a chart, but no bar and page number next to them"
    raise ScanError(scan.path, what, remedy="give the recipe file of the chart that was scanned")


def _squares(
    light: NDArray[np.float32], stretch: tuple[float, float]
) -> list[tuple[NDArray[np.float64], float]]:
    """Return centre (column, line) and side [columns] of everything that looks like a mark."""
    factor = max(max(light.shape) / _SEARCH_PIXELS, 1.0)
    size = tuple(
        max(round(extent * way / factor), 8) for extent, way in zip(light.shape[::-1], stretch, strict=True)
    )
    small = cv2.resize(light, size, interpolation=cv2.INTER_AREA)
    scale = np.array(light.shape[::-1]) / np.array(size)
    contours, tree = cv2.findContours(
        (small < _BLACK).astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
    )
    marks = []
    for at, contour in enumerate(contours):
        if tree[0, at, 3] >= 0 or tree[0, at, 2] < 0 or len(contour) < 24:
            continue  # a hole itself, or without one, or tiny
        holes = []
        hole = tree[0, at, 2]
        while hole >= 0:
            holes.append(contours[hole])
            hole = tree[0, hole, 0]
        inner = max(holes, key=cv2.contourArea)
        (centre, extent, _), (white, white_extent, _) = (cv2.minAreaRect(c) for c in (contour, inner))
        # A contour runs through the centres of black pixels: one pixel is missing outside, one is too many inside.
        side, hollow = (np.array(extent) + 1).tolist(), (np.array(white_extent) - 1).tolist()
        filled = cv2.contourArea(contour) + cv2.arcLength(contour, True) / 2 + 1
        square = max(side) < 1.2 * min(side) and max(hollow) < 1.5 * min(hollow)
        third = 0.2 < np.mean(hollow) / np.mean(side) < 0.45
        middle = np.hypot(*np.subtract(centre, white)) < 0.12 * np.mean(side)
        if square and third and middle and filled > 0.8 * side[0] * side[1]:
            marks.append(((np.array(centre) + 0.5) * scale - 0.5, float(np.mean(side) * scale[0])))
    return marks


def _placements(
    candidates: list[tuple[NDArray[np.float64], float]], layout: Layout, stretch: tuple[float, float]
) -> Iterator[tuple[NDArray[np.float64], int, float]]:
    """Yield every map that matches three or four marks to candidates: the map, their number, and the distance."""
    boxes = layout.mark_boxes()
    marks = np.array([[x + w / 2, y + h / 2] for x, y, w, h in boxes])
    seen = np.array([centre * stretch for centre, _ in candidates])
    sides = np.array([side for _, side in candidates])
    seen_number, mark_number = seen @ (1, 1j), marks @ (1, 1j)
    done = set()
    for first, second in combinations(range(4), 2):
        for one, other in permutations(range(len(candidates)), 2):
            turn = (seen_number[other] - seen_number[one]) / (mark_number[second] - mark_number[first])
            if abs(sides[one] / (abs(turn) * layout.mark_mm) - 1) > 0.2:
                continue
            wanted = (mark_number - mark_number[first]) * turn + seen_number[one]
            distance = np.abs(wanted[:, None] - seen_number)
            nearest = distance.argmin(axis=1)
            near = distance.min(axis=1) < _MISPLACED * abs(turn) * np.hypot(layout.width_mm, layout.height_mm)
            key = tuple(np.where(near, nearest, -1).tolist())
            if near.sum() < 3 or len(set(nearest[near])) < near.sum() or key in done:
                continue
            done.add(key)
            design = np.column_stack([marks[near], np.ones(near.sum())])
            target = seen[nearest[near]] / stretch
            solution = np.linalg.lstsq(design, target, rcond=None)[0]
            off = np.abs(design @ solution - target).max() + distance.min(axis=1)[near].max()
            yield solution.T, int(near.sum()), float(off)


def _page(light: NDArray[np.float32], to_pixel: NDArray[np.float64], layout: Layout) -> int | None:
    """Return the page number, if bar, start and stop squares are where this map puts them; else None."""
    numbered = layout.code_boxes(2**_BITS - 1)  # all squares but the white one before the last
    bar = layout.black_and_white(1)[2 * len(layout.mark_boxes())][0]
    x, y, side, _ = numbered[-1]
    gap = (round(x - side, 1), y, side, side)
    seen = [_mean_in(light, to_pixel, box) for box in (bar, *numbered[:-1], gap, numbered[-1])]
    if any(np.isnan(seen)):
        return None
    black = [value < _BLACK for value in seen]
    if not (black[0] and black[1] and black[-1] and not black[-2]):
        return None
    return sum(bit << at for at, bit in enumerate(reversed(black[2:-2])))


def _mean_in(light: NDArray[np.float32], to_pixel: NDArray[np.float64], box: Box) -> float:
    """Return the median light in the middle half of a box; NaN off the scan."""
    x, y, width, height = box
    at = np.linspace(0.25, 0.75, 9)
    grid = np.stack(np.meshgrid(x + width * at, y + height * at), axis=-1)
    return float(np.median(_sampled(light, to_pixel, grid)))


def _sampled(
    image: NDArray[np.float32], to_pixel: NDArray[np.float64], points_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return bilinear values at chart points (..., 2) -> (...); NaN off the scan."""
    column, line = np.moveaxis(points_mm @ to_pixel[:, :2].T + to_pixel[:, 2], -1, 0)
    return np.asarray(
        ndimage.map_coordinates(image, [line, column], order=1, mode="constant", cval=np.nan),
        dtype=np.float64,
    )


def mark_edges(layout: Layout) -> Iterator[tuple[int, float, tuple[float, float]]]:
    """Yield the straight edges of the marks. [mm]

    Each is the axis of its normal (0: x, 1: y), its place on that axis, and its extent on the other axis,
    corners left out.
    """
    third = layout.mark_mm / 3
    for x, y, side, _ in layout.mark_boxes():
        for axis, start, across in ((0, x, y), (1, y, x)):
            for place in (start, start + side):
                yield axis, place, (across + third, across + 2 * third)
                yield axis, place, (across + side * 0.1, across + third)
                yield axis, place, (across + 2 * third, across + side * 0.9)
            for place in (start + third, start + 2 * third):
                yield axis, place, (across + third * 1.3, across + third * 1.7)


def edge_profile(
    image: NDArray[np.float32],
    to_pixel: NDArray[np.float64],
    edge: tuple[int, float, tuple[float, float]],
    offsets_mm: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the median along an edge of the image at offsets (n,) across it."""
    axis, place, (low, high) = edge
    along = np.linspace(low, high, 25)
    points = np.empty((along.size, offsets_mm.size, 2))
    points[..., axis] = place + offsets_mm
    points[..., 1 - axis] = along[:, None]
    return np.asarray(np.median(_sampled(image, to_pixel, points), axis=0))


def half_way(offsets_mm: NDArray[np.float64], profile: NDArray[np.float64]) -> float:
    """Return the offset [mm] at which an edge's profile passes the middle between its ends.

    The result is NaN if the profile shows no edge.
    """
    ends = profile[: profile.size // 5].mean(), profile[-(profile.size // 5) :].mean()
    if not np.isfinite(profile).all() or abs(ends[1] - ends[0]) < 0.3:
        return float("nan")
    level = (profile - ends[0]) / (ends[1] - ends[0]) - 0.5
    crossing = np.flatnonzero((level[:-1] < 0) & (level[1:] >= 0))
    if not crossing.size:
        return float("nan")
    at = crossing[np.abs(crossing - level.size / 2).argmin()]
    step_mm = offsets_mm[at + 1] - offsets_mm[at]
    return float(offsets_mm[at] + step_mm * level[at] / (level[at] - level[at + 1]))


def _refined(
    light: NDArray[np.float32], to_pixel: NDArray[np.float64], layout: Layout
) -> tuple[NDArray[np.float64], float]:
    """Refine the map by least squares to the marks' measured edges; return it with its residual. [pixels]"""
    offsets = np.arange(-_REACH_MM, _REACH_MM + _STEP_MM / 2, _STEP_MM)
    edges = list(mark_edges(layout))
    residual = np.inf
    for _ in range(_ROUNDS):
        moved = np.array([half_way(offsets, edge_profile(light, to_pixel, edge, offsets)) for edge in edges])
        correction = np.eye(3)
        left = []
        for axis in (0, 1):
            rows = [at for at, edge in enumerate(edges) if edge[0] == axis and np.isfinite(moved[at])]
            points = np.ones((len(rows), 3))
            points[:, axis] = [edges[at][1] for at in rows]
            points[:, 1 - axis] = [np.mean(edges[at][2]) for at in rows]
            if len(rows) < 6:
                return to_pixel, float("nan")
            fit, inliers = _trimmed_fit(points, moved[rows])
            correction[axis] += fit
            left.append((moved[rows] - points @ fit)[inliers])
        # An edge seen at x + moved(x): the true map takes x where the present one takes x + moved(x).
        to_pixel = to_pixel @ correction
        pixels_a_mm = np.sqrt(abs(np.linalg.det(to_pixel[:, :2])))
        residual = float(np.sqrt(np.mean(np.concatenate(left) ** 2)) * pixels_a_mm)
    return to_pixel, residual


def _trimmed_fit(
    points: NDArray[np.float64], moved: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Fit by least squares without points beyond four robust sigmas, such as a speck on an edge."""
    inliers = np.ones(len(moved), dtype=bool)
    for _ in range(3):
        fit = np.asarray(np.linalg.lstsq(points[inliers], moved[inliers], rcond=None)[0], dtype=np.float64)
        away = np.abs(moved - points @ fit)
        inliers = np.asarray(away <= max(4 * 1.48 * float(np.median(away[inliers])), 1e-3))
    return fit, inliers
