"""Patches of a design where ink planes share edges, so that misregister shows as fringes; found ahead of its scans."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.registration.shared_edges import EDGES, PAIRS, shared_edges
from prooflight.registration.landmarks import light_left, raster_windows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.registration.landmarks import Landmarks

PATCH_PIXELS: Final = 8
"""Side of the patches that are rendered: two millimetres at 0.254 mm, a letter, which moves as one."""
MOST_PATCHES: Final = 48
LEAST_PATCHES: Final = 6
"""Least number of patches; fewer could all belong to one misprint."""
LEAST_SHARED: Final = 0.1
"""Least score of a patch to be chosen: ten pixels of an edge where either ink takes a tenth of white."""
REGIONS: Final = (9, 6)
"""Rows and columns of regions of the page, from each of which the best patch for each pair of planes may be
chosen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Overlaps:
    """Patches of a design where planes share edges.

    They are kept as bytes of ink, since their signal depends on the planes' register.
    """

    lines: NDArray[np.int64]
    """First line of each patch with the page at its place, (patches,)."""
    columns: NDArray[np.int64]
    packed: NDArray[np.uint32]
    """Raster under each patch, a uint32 a recipe, cyan lowest, (patches, height + 2 margin, width + 2
    margin)."""
    margin: int
    """Raster pixels around each window, one more than planes may be displaced by."""
    origins: NDArray[np.float64]
    """Start of the first footprint within the margin, x and y, (patches, 2). [raster pixels]"""
    inks: tuple[int, ...]
    """Planes that have edges on the page."""
    has_edges: NDArray[np.bool_]
    """Whether a plane has edges in the patches, (4,)."""
    good_mm: float
    """Greatest displacement of planes on good prints."""
    pixel_mm: float
    """Pitch of the raster."""

    @property
    def reach(self) -> int:
        """Greatest displacement of a plane. [raster pixels]"""
        return self.margin - 1

    def planes_mm(self, steps: tuple[int, ...]) -> NDArray[np.float64]:
        """Return the displacement of the planes to the right and down, (4, 2), from raster pixels as in ``Steps``."""
        return np.array(steps, np.float64).reshape(2, INKS).T * self.pixel_mm


def overlaps_of(page: Page, landmarks: Landmarks, *, good_mm: float, finer: int = 1) -> Overlaps | None:
    """Return the patches of a page, or None where no two planes share enough edges for fringes to be seen.

    good_mm: greatest displacement of planes on good prints; finer: number of steps by which planes are displaced over a
    pixel of the page's raster, for which patches are kept as so many pixels.
    """
    scores = shared_scores(page, landmarks)
    rows, columns = _chosen(scores)
    if rows.size < LEAST_PATCHES:
        return None
    geometry = landmarks.geometry
    side_mm = PATCH_PIXELS * _strides(landmarks) * page.pixel_mm
    x_mm = geometry.centres_x_mm(page.width_mm)
    y_mm = geometry.centres_y_mm(geometry.lines(page.height_mm))
    left, top = np.searchsorted(x_mm, columns * side_mm[0]), np.searchsorted(y_mm, rows * side_mm[1])
    begin, corners, (width, height) = raster_windows(
        np.stack([x_mm[left], y_mm[top]], axis=1),
        PATCH_PIXELS,
        page.pixel_mm,
        np.array(landmarks.ratio),
        landmarks.taps[0],
    )
    separation = round(2 * good_mm / page.pixel_mm)  # two planes of one print, to the raster pixel
    margin = max(math.ceil(separation / 2), 1) + 1
    width, height = width + 2 * margin, height + 2 * margin
    packed = [_cut(page.packed, y - margin, x - margin, height, width) for x, y in corners.tolist()]
    of_planes = np.maximum(*np.moveaxis(scores[..., PAIRS:], 2, 0)) > LEAST_SHARED
    return Overlaps(
        lines=top,
        columns=left,
        packed=np.stack(packed).repeat(finer, axis=1).repeat(finer, axis=2),
        margin=finer * margin,
        origins=finer * (begin - corners),
        inks=tuple(np.flatnonzero(of_planes.any(axis=(0, 1))).tolist()),
        has_edges=of_planes[rows, columns].any(axis=0),
        good_mm=good_mm,
        pixel_mm=page.pixel_mm / finer,
    )


def shared_scores(page: Page, landmarks: Landmarks) -> NDArray[np.float64]:
    """Return the strength of the edges that planes share, (rows, columns, 2, EDGES) of patches; 0 at the border."""
    stride_x, stride_y = _strides(landmarks)
    rows = page.cmyk.shape[0] // (PATCH_PIXELS * stride_y)
    columns = page.cmyk.shape[1] // (PATCH_PIXELS * stride_x)
    scores = np.zeros((rows, columns, 2, EDGES))
    # An ink counts as for the sensor that sees it best.
    light = np.min([light_left(sensor) for sensor in landmarks.sensors], axis=0).astype(np.float32)
    shared_edges(page.packed, PATCH_PIXELS, int(stride_x), int(stride_y), light, scores)
    for border in (scores[:1], scores[-1:], scores[:, :1], scores[:, -1:]):
        border[...] = 0  # a print that is displaced shows the backing there, or a page's edge
    return scores


def _cut(packed: NDArray[np.uint32], top: int, left: int, height: int, width: int) -> NDArray[np.uint32]:
    """Cut a window from the raster; it is bare beyond the raster's border."""
    window = np.zeros((height, width), np.uint32)
    above, aside = max(-top, 0), max(-left, 0)
    within = packed[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)]
    window[above : above + within.shape[0], aside : aside + within.shape[1]] = within
    return window


def _strides(landmarks: Landmarks) -> NDArray[np.int64]:
    return np.array([max(round(per_pixel), 1) for per_pixel in landmarks.ratio])


def _chosen(scores: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of patches: for each pair of planes and edge direction in turn, the best of a region."""
    lists = _best(scores[..., :PAIRS].reshape(*scores.shape[:2], -1))
    chosen: list[tuple[int, int]] = []
    for turn in range(max(len(one) for one in lists)):
        for one in lists:
            if turn < len(one) and one[turn] not in chosen and len(chosen) < MOST_PATCHES:
                chosen.append(one[turn])
    rows, columns = np.array(chosen, np.int64).reshape(-1, 2).T
    return rows, columns


def _best(scores: NDArray[np.float64]) -> list[list[tuple[int, int]]]:
    """Return the patch with the highest score of every region, best first, if high enough, for each kind of edge.

    scores: (rows, columns, kinds).
    """
    best: list[list[tuple[float, int, int]]] = [[] for _ in range(scores.shape[2])]
    for rows in np.array_split(np.arange(scores.shape[0]), REGIONS[0]):
        for columns in np.array_split(np.arange(scores.shape[1]), REGIONS[1]):
            if not rows.size or not columns.size:
                continue
            part = scores[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].reshape(-1, len(best))
            places = part.argmax(axis=0)
            for kind in np.flatnonzero(part[places, np.arange(len(best))] > LEAST_SHARED).tolist():
                row, column = divmod(int(places[kind]), columns.size)
                place = int(rows[0]) + row, int(columns[0]) + column
                best[kind].append((float(part[places[kind], kind]), *place))
    return [[(row, column) for _, row, column in sorted(one, reverse=True)] for one in best]
