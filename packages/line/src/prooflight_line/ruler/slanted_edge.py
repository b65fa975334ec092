"""Sharpness as MTF from slanted edges (ISO 12233, the e-SFR method), with its uncertainty.

Pixels along an edge that is turned a little see it at many places within a pixel: combined they sample it
finely. The derivative is the line-spread function, and the MTF is the modulus of its Fourier transform.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.commissioning.camera.fixed_pattern import Measured
from prooflight.inks.ruler_layout import SQUARE_MM, RulerLayout
from prooflight_line.ruler.places import LEAST_CONTRAST

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from prooflight_line.ruler.places import RulerScale

OVERSAMPLING: Final = 4
"""Number of places within a pixel; as ISO 12233."""
FREQUENCIES: Final = np.linspace(0, 1, 65)
"""Frequencies at which MTFs are given. [cycles/pixel]"""
LEAST_PHASES: Final = 1.2
"""Least shift in pixels of an edge over the rows of a piece, so that it is seen at every phase of a pixel."""
_REACH_MM: Final = 3.0
_HALF_LENGTH: Final = 0.36
"""Half length of an edge that is used, as a share of a square's side: corners are left out."""
MOST_PIECES: Final = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeMtf:
    """MTF of one piece of an edge."""

    mtf: NDArray[np.float64]
    """MTF at ``FREQUENCIES``. [-]"""
    mtf50: float
    """Frequency at which half of the contrast is left. [cycles/pixel]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sharpness:
    """Sharpness at a place, one way."""

    x_mm: float
    """Position of the middle of the edges on the page."""
    mtf50: Measured
    """MTF50 [cycles/pixel] across, or [cycles/line] along.

    The standard error comes from the scatter of pieces of edges.
    """
    mtf: NDArray[np.float64]
    """Mean MTF at ``FREQUENCIES``. [-]"""
    pieces: int


def edge_mtf(patch: NDArray[np.floating]) -> EdgeMtf | None:
    """Measure the MTF across an upright edge in a patch (rows, columns); None: it shows no single slanted edge.

    The edge is a straight line through the middles of the rows' steps. Frequencies are those of the edge's
    normal.
    """
    image = patch.astype(np.float64)
    rows, columns = image.shape
    if rows < 4 or columns < 9:
        return None
    if image[:, : columns // 4].mean() > image[:, -(columns // 4) :].mean():
        image = image[:, ::-1]
    ends = image[:, : columns // 5].mean(), image[:, -(columns // 5) :].mean()
    if ends[1] - ends[0] < LEAST_CONTRAST * abs(ends[1]):
        return None
    level = (image - ends[0]) / (ends[1] - ends[0])
    line = _edge_line(level)
    if line is None or abs(line[0]) * rows < LEAST_PHASES:
        return None
    slope, start = line
    offset = np.arange(columns) - (slope * np.arange(rows)[:, None] + start)
    # As far as every row sees, on both sides.
    reach = float(min(offset.max(axis=1).min(), -offset.min(axis=1).max()))
    return _from_samples(offset.ravel(), level.ravel(), reach, math.cos(math.atan(slope)))


def _edge_line(level: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return slope [columns/row] and place at row 0 of the edge; None: it is not straight."""
    rows, columns = level.shape
    # The area method, as for bars: exact for any blur.
    place = columns - 0.5 - level.sum(axis=1)
    at = np.arange(rows)
    slope, start = np.polyfit(at, place, 1)
    if np.std(place - (slope * at + start)) > 0.5:
        return None
    return float(slope), float(start)


def _from_samples(
    offset: NDArray[np.float64], level: NDArray[np.float64], reach: float, cosine: float
) -> EdgeMtf | None:
    """Compute the MTF from samples of an edge at offsets from it [columns], within reach."""
    bins = int(reach) * OVERSAMPLING
    if bins < 2 * OVERSAMPLING:
        return None
    index = np.floor(offset * OVERSAMPLING + 0.5).astype(np.intp) + bins
    inside = (index >= 0) & (index <= 2 * bins)
    count = np.bincount(index[inside], minlength=2 * bins + 1)
    if (count == 0).mean() > 0.2:
        return None
    total = np.bincount(index[inside], level[inside], minlength=2 * bins + 1)
    # Slopes of few phases fill a bin at one side: its mean place counts.
    where = np.bincount(index[inside], offset[inside] * OVERSAMPLING + bins, minlength=2 * bins + 1)
    filled = count > 0
    spread = np.interp(np.arange(2 * bins + 1), where[filled] / count[filled], total[filled] / count[filled])
    line_spread = np.diff(spread)
    middle = (2 * bins - 1) / 2
    centre = float((np.arange(2 * bins) * line_spread).sum() / max(line_spread.sum(), 1e-9))
    if abs(centre - middle) > bins / 2:
        return None
    # The standard's window is Hamming's, which lowers MTF50 of a blurred edge by 1 to 3 %; this one is flat in its
    # inner half, and falls as Hamming's does outside: noise far from the edge still has little say.
    outside = np.clip(np.abs(np.arange(2 * bins) - centre) / bins - 0.5, 0, 0.5)
    window = 0.54 + 0.46 * np.cos(2 * np.pi * outside)
    windowed = line_spread * window
    step = np.arange(2 * bins) / OVERSAMPLING
    frequency = FREQUENCIES * 1.0
    waves = np.exp(-2j * np.pi * frequency[:, None] * step)
    seen = np.abs(waves @ windowed) / max(abs(float(windowed.sum())), 1e-9)
    # A bin is a box, and so is the difference of neighbours.
    mtf = seen / np.sinc(frequency / OVERSAMPLING) ** 2
    mtf = np.interp(frequency, frequency / cosine, mtf)
    below = np.flatnonzero(mtf < 0.5)
    if not below.size or below[0] == 0:
        return None
    last = int(below[0])
    share = (mtf[last - 1] - 0.5) / (mtf[last - 1] - mtf[last])
    return EdgeMtf(
        mtf=mtf, mtf50=float(frequency[last - 1] + share * (frequency[last] - frequency[last - 1]))
    )


def ruler_sharpness(
    image: NDArray[np.floating], scale: RulerScale
) -> tuple[tuple[Sharpness, ...], tuple[Sharpness, ...]]:
    """Measure sharpness across and along, at each column of turned squares of a ruler page.

    image: (lines, pixels).
    """
    across: dict[float, list[EdgeMtf]] = {}
    along: dict[float, list[EdgeMtf]] = {}
    for square in RulerLayout.largest().squares():
        if square.x_mm > scale.end_mm[0] or square.y_mm > scale.end_mm[1]:
            continue
        for edge in range(4):
            upright = edge % 2 == 1
            ends = square.corners_mm[edge], square.corners_mm[(edge + 1) % 4]
            pieces = across if upright else along
            for patch in _patches(image, scale, ends[0], ends[1], upright=upright):
                measured = edge_mtf(patch)
                if measured is not None:
                    pieces.setdefault(square.x_mm, []).append(measured)
    return _of_places(across), _of_places(along)


def _of_places(by_place: dict[float, list[EdgeMtf]]) -> tuple[Sharpness, ...]:
    return tuple(
        Sharpness(
            x_mm=x,
            mtf50=mean_of([piece.mtf50 for piece in pieces]),
            mtf=np.mean([piece.mtf for piece in pieces], axis=0),
            pieces=len(pieces),
        )
        for x, pieces in sorted(by_place.items())
        if len(pieces) >= 2
    )


def mean_of(values: Sequence[float]) -> Measured:
    """Return the mean and its standard error by the scatter of values."""
    return Measured(
        value=float(np.mean(values)), standard_error=float(np.std(values, ddof=1) / math.sqrt(len(values)))
    )


def _patches(
    image: NDArray[np.floating],
    scale: RulerScale,
    first: NDArray[np.float64],
    last: NDArray[np.float64],
    *,
    upright: bool,
) -> Iterator[NDArray[np.floating]]:
    """Yield pieces of an edge as patches in which it stands upright, each with phases enough."""
    seen = image if upright else image.T
    middle, half = (first + last) / 2, (last - first) * _HALF_LENGTH
    ends = np.array([scale.at(*(middle - half)), scale.at(*(middle + half))])
    if not upright:
        ends = ends[:, ::-1]
    ends = ends[np.argsort(ends[:, 1])]
    rows = ends[1, 1] - ends[0, 1]
    slope = (ends[1, 0] - ends[0, 0]) / rows
    pieces = int(min(max(abs(slope) * rows / LEAST_PHASES, 1), MOST_PIECES))
    reach = round(_REACH_MM * SQUARE_MM / 12 / (scale.pixel_mm if upright else scale.line_mm).value)
    bounds = np.linspace(ends[0, 1], ends[1, 1], pieces + 1)
    for top, bottom in pairwise(bounds.tolist()):
        low, high = math.ceil(top), math.floor(bottom) + 1
        centre = round(ends[0, 0] + slope * ((top + bottom) / 2 - ends[0, 1]))
        if low >= 0 and centre - reach >= 0 and high <= len(seen) and centre + reach < seen.shape[1]:
            yield seen[low:high, centre - reach : centre + reach + 1]
