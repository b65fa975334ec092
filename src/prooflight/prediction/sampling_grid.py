"""Positions of camera pixels on a page that is slightly displaced, in raster pixels, at a few nodes.

Filters take two passes. Simulation filters every raster row across, then those rows along: the first needs the
raster column seen at each raster row and camera column; the second needs the raster row seen at each line and column.
Prediction sums up the rows of each line along, then these sums across, which takes less time: it needs the raster row
seen at each line and raster column, and the raster column seen at each line and camera column. All vary slowly, so
they are tabulated at nodes and interpolated linearly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.prediction.aiming import FilterPass
from prooflight.kernels.prediction.summing import GROUP

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.pages.sampling import Footprint
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement

NODE_PITCH: Final = GROUP
"""Lines, raster rows and columns between nodes; 1.7 mm at the paper's pitch, where warps span 25 mm: prediction sums up
raster columns by such groups."""
MOST_COLUMNS: Final = 256
"""Greatest distance of nodes where places are linear: single precision then holds them to 1e-4 raster
pixels."""
BEND_PIXELS: Final = 0.001
"""Greatest deviation of places from the line between nodes at which nodes between are left out. [camera
pixels]"""
PHASES: Final = 4096
"""Least number of phases of a camera pixel: the nearest is off by at most 1/8192, and weights by 0.01 % of an
edge."""
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nodes:
    """One coordinate of the points seen, in raster pixels from the page's corner (a pixel's centre is at its half)."""

    places: NDArray[np.float64]
    """Coordinates at node rows, and at columns 0, segment, 2 segment, ..., (nodes down, nodes across).
    [raster pixels]"""
    pitch: int
    """Rows (raster rows, or lines) between nodes."""
    segment: int
    """Columns between nodes."""

    def of_groups(self) -> Nodes:
        """Return the same with a node at each group of columns."""
        share = np.arange(0, self.segment, GROUP) / self.segment
        between = self.places[:, :-1, None] + share * np.diff(self.places)[..., None]
        places = np.concatenate([between.reshape(len(self.places), -1), self.places[:, -1:]], axis=1)
        return Nodes(places=places, pitch=self.pitch, segment=GROUP)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SamplingGrid:
    """Coordinates for the two filter passes."""

    across: Nodes
    """Raster columns, at raster rows (lines if along comes first) and camera columns."""
    along: Nodes
    """Raster rows, at lines and camera columns (raster columns if along comes first)."""
    still: bool
    """Whether the point seen at a column is the same in every row, but for the row's own place."""
    stride: int
    """Raster pixels between camera columns if that is a whole number, else 0."""
    phase_bits: int
    """Logarithm of the number of phases of a raster pixel: 2^phase_bits."""

    def passes(self, footprint: Footprint, pixel_mm: float) -> tuple[FilterPass, FilterPass]:
        """Return the passes across and along by which a footprint filters a raster with pixels of that size."""
        step = footprint.steps_in(pixel_mm)
        across, along = (
            FilterPass(
                places=nodes.places,
                pitch=nodes.pitch,
                segment=nodes.segment,
                cumulative=cumulative,
                step=step,
            )
            for nodes, cumulative in ((self.across, footprint.across), (self.along, footprint.along))
        )
        return across, along


def sampling_grid(
    page: Page, geometry: ScanGeometry, placement: Placement, *, along_first: bool = False
) -> SamplingGrid:
    """Return the points of ``page`` that the camera sees where ``placement`` puts it.

    along_first: for a filter that sums up the rows of each line first; a page that is only shifted has none.
    """
    (rows, columns), lines = page.cmyk.shape[:2], geometry.lines(page.height_mm)
    x_mm, y_mm = geometry.centres_x_mm(page.width_mm), geometry.centres_y_mm(lines)
    pixel_mm = page.pixel_mm

    def seen(
        x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return placement.seen_mm(
            np.broadcast_to(x, y.shape), y, page_width_mm=page.width_mm, page_height_mm=page.height_mm
        )

    def column_at(row: NDArray[np.float64], column: NDArray[np.float64]) -> NDArray[np.float64]:
        x = x_mm[0] + column * geometry.pixel_pitch_mm
        page_y = np.broadcast_to((row[:, None] + 0.5) * pixel_mm, (row.size, column.size))
        # Two steps towards the line that sees this row here; each leaves a hundredth of the error, a page's turn.
        y = page_y
        for _ in range(2):
            y = y + page_y - seen(x, y)[1]
        return seen(x, y)[0] / pixel_mm

    def on_lines(line: NDArray[np.float64], column: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.broadcast_to(y_mm[0] + line[:, None] * geometry.line_pitch_mm, (line.size, column.size))

    def row_at(line: NDArray[np.float64], column: NDArray[np.float64]) -> NDArray[np.float64]:
        return seen(x_mm[0] + column * geometry.pixel_pitch_mm, on_lines(line, column))[1] / pixel_mm

    def column_on_line(line: NDArray[np.float64], column: NDArray[np.float64]) -> NDArray[np.float64]:
        return seen(x_mm[0] + column * geometry.pixel_pitch_mm, on_lines(line, column))[0] / pixel_mm

    def row_on_line(line: NDArray[np.float64], column: NDArray[np.float64]) -> NDArray[np.float64]:
        y = on_lines(line, column)
        page_x = np.broadcast_to((column + 0.5) * pixel_mm, y.shape)
        x = page_x
        for _ in range(2):  # as in column_at
            x = x + page_x - seen(x, y)[0]
        return seen(x, y)[1] / pixel_mm

    ratio = geometry.pixel_pitch_mm / pixel_mm
    bend, still = BEND_PIXELS * ratio, placement.is_shift
    if along_first:
        across = _nodes(column_on_line, lines, geometry.pixels, bend=bend, within=True)
        along = _nodes(row_on_line, lines, columns, bend=bend, within=True)
    else:
        across = _nodes(column_at, rows, geometry.pixels, bend=bend, still=still)
        along = _nodes(row_at, lines, geometry.pixels, bend=bend, still=still)
    steps = np.diff(across.places[0]) / across.segment
    even = still and np.abs(steps - round(ratio)).max() < _ROUNDING
    return SamplingGrid(
        across=across,
        along=along,
        still=still,
        stride=round(ratio) if even else 0,
        phase_bits=max(math.ceil(math.log2(PHASES / ratio)), 0),
    )


def _nodes(
    place: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
    rows: int,
    columns: int,
    *,
    bend: float,
    still: bool = False,
    within: bool = False,
) -> Nodes:
    """Return nodes as coarse as the curvature of places allows.

    still: the point seen at a column is the same in every row, but for the row's own place, so one cell down
    is enough. within: places are wanted at columns of the page alone.
    """
    pitch = max(rows, 1) if still else NODE_PITCH
    down = np.arange(-(-rows // pitch) + 1, dtype=np.float64) * pitch

    def at(segment: int) -> NDArray[np.float64]:
        across = np.arange(-(-columns // segment) + 1, dtype=np.float64) * segment
        if not within:
            return place(down, across)
        # The last node is where a line to the page's end leads: a warp may bend beyond.
        places = place(down, np.append(across[:-1], columns))
        places[:, -1] = places[:, -2] + (places[:, -1] - places[:, -2]) * (segment / (columns - across[-2]))
        return places

    places, segment = at(NODE_PITCH), NODE_PITCH
    while segment < min(columns, MOST_COLUMNS) and _straight(places, bend):
        places, segment = at(2 * segment), 2 * segment
    return Nodes(places=places, pitch=pitch, segment=segment)


def _straight(places: NDArray[np.float64], bend: float) -> bool:
    """Return whether every second node lies on the line between its neighbours, to ``bend``, and may be left out."""
    bends = np.diff(places, 2, axis=1)
    return bool(max(bends.max(initial=0.0), -bends.min(initial=0.0)) <= 2 * bend)
