"""Where camera pixels look on a page that lies a little off its place, in raster pixels, at a few nodes.

Prediction filters in two passes: every raster row across, then those rows along. The first needs, for a raster row
and a camera column, the raster column that is seen where the two meet; the second, for a line and a column, the raster
row. Both vary slowly, so they are tabulated at nodes and are linear between.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.acquiring.geometry import ScanGeometry
    from prooflight.acquiring.placement import Placement
    from prooflight.pages.raster import Page

NODE_PITCH: Final = 16
"""Lines, raster rows and at most columns from node to node; 1.7 mm at the paper's pitch, where warps span 25 mm."""
DRIFT_PIXELS: Final = 0.01
"""How far weights may drift along half a segment. An edge's second derivative is at most the lens's line spread at its
peak, about 5 a pixel and pixel: weights taken as linear err by 5 x 0.01^2 / 2 of an edge at a segment's ends, 0.025 %.
[camera pixels]"""
ROUGH_DRIFT_PIXELS: Final = 0.04
"""The same of a page that is warped, which registration knows to 0.07 pixels, in segments shorter than ``NODE_PITCH``:
those of 4 columns take five times as long. Weights err by 0.4 % of an edge at a segment's ends. [camera pixels]"""
_ROUNDING: Final = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nodes:
    """One coordinate of what is seen, in raster pixels from the page's corner (a pixel's centre lies at its half)."""

    places: NDArray[np.float64]
    """(nodes down, nodes across): at node rows, and at columns 0, segment, 2 segment, ... [raster pixels]"""
    pitch: int
    """Rows (raster rows, or lines) from node to node."""
    segment: int
    """Columns from node to node."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """The two coordinates that the two passes need."""

    across: Nodes
    """Raster columns, at raster rows and camera columns."""
    along: Nodes
    """Raster rows, at lines and camera columns."""
    stride: int
    """Whole raster pixels from one camera column to the next; what is left over drifts."""


def course(page: Page, geometry: ScanGeometry, placement: Placement) -> Course:
    """What the camera sees of ``page`` where ``placement`` puts it."""
    rows, lines = page.cmyk.shape[0], geometry.lines(page.height_mm)
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

    def row_at(line: NDArray[np.float64], column: NDArray[np.float64]) -> NDArray[np.float64]:
        x = x_mm[0] + column * geometry.pixel_pitch_mm
        y = np.broadcast_to(y_mm[0] + line[:, None] * geometry.line_pitch_mm, (line.size, column.size))
        return seen(x, y)[1] / pixel_mm

    ratio = geometry.pixel_pitch_mm / pixel_mm
    stride = max(round(ratio), 1)
    allowed = DRIFT_PIXELS * ratio
    still = placement.is_shift
    most = allowed if placement.warp is None else ROUGH_DRIFT_PIXELS * ratio
    return Course(
        across=_nodes(
            column_at, rows, geometry.pixels, stride=stride, allowed=allowed, most=most, still=still
        ),
        along=_nodes(row_at, lines, geometry.pixels, stride=0, allowed=allowed, most=most, still=still),
        stride=stride,
    )


def _nodes(
    place: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
    rows: int,
    columns: int,
    *,
    stride: int,
    allowed: float,
    most: float,
    still: bool,
) -> Nodes:
    """Nodes as coarse as the drift allows; the whole line in one segment where nothing drifts.

    most: drift along half a segment from which one shorter than ``NODE_PITCH`` is needed.

    still: what is seen at a column is the same, but for the row's own place, in every row; one cell down then does.
    """
    pitch = max(rows, 1) if still else NODE_PITCH
    down = np.arange(-(-rows // pitch) + 1, dtype=np.float64) * pitch

    def at(segment: int) -> NDArray[np.float64]:
        return place(down, np.arange(-(-columns // segment) + 1, dtype=np.float64) * segment)

    if still:
        places = at(columns)
        if np.abs(np.diff(places, axis=1) - stride * columns).max() < _ROUNDING * columns:
            return Nodes(places=places, pitch=pitch, segment=columns)
    places, segment = at(NODE_PITCH), NODE_PITCH
    drift = float(np.abs(np.diff(places, axis=1) / segment - stride).max())
    wide = 0.7 * allowed  # both passes may err at one place
    while not still and segment < columns and drift * segment <= wide and _straight(places, allowed):
        places, segment = at(2 * segment), 2 * segment
    while segment > 1 and drift * segment / 2 > most:
        segment //= 2
    return Nodes(places=at(segment) if segment < NODE_PITCH else places, pitch=pitch, segment=segment)


def _straight(places: NDArray[np.float64], allowed: float) -> bool:
    """Whether every second node may be left out: it lies on the line between its neighbours, to a tenth of allowed."""
    bends = np.abs(np.diff(places, 2, axis=1)) / 2
    return bool(bends.max(initial=0.0) <= allowed / 10)
