"""Glyph detection in a page's raster: pieces of one colour, of a letter's size, on one ground colour.

No character recognition is needed: the raster states what is printed. Pieces of one outline have one shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.kernels.memory import unset
from prooflight.kernels.statistics.glyphs import PIECE, RUN, filled_pieces, joined_runs, piece_boxes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page

LEAST_MM: Final = 0.8
"""Minimum height of a glyph: x-heights of 5 pt; dots and commas are smaller."""
MOST_MM: Final = 4.5
"""Maximum height and width: digits of 17 pt. Larger glyphs are covered by the statistics of places of a
millimetre and more."""
LEAST_WIDTH_MM: Final = 0.3
"""Minimum width: a bare stem differs from its neighbours by no more than what a shift of all of them does."""
INKS_MOST: Final = 8
"""Maximum number of colours in which text is searched for, those with most edges."""
LEAST_EDGES: Final = 2
"""Minimum number of edges of a colour, in rows so far apart that each letter is in one."""
FILLED: Final = (0.08, 0.95)
"""Bounds of the share of its box that a glyph's ink covers."""
MOST_RUNS: Final = 2_000_000
"""Maximum number of runs on a page: a dense page of type at 480 dpi has 600,000 (assumed)."""
BAND_ROWS: Final = 64
"""Raster rows that are processed at once, so that they stay in the processor's cache."""
MOST_GLYPHS: Final = 12_000
"""Maximum number of glyphs. assumed: more than on any page of type; more than that is texture."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectedGlyphs:
    """Pieces of ink that are like glyphs, from top to bottom."""

    box: NDArray[np.int64]
    """(n, 4) column, row, width and height in the raster. [raster pixels]"""
    ink: NDArray[np.uint8]
    """(n, 4) CMYK."""
    ground: NDArray[np.uint8]
    """(n, 4) CMYK of the surrounding colour."""
    shape: NDArray[np.int64]
    """(n,) index of the outline in ``masks``."""
    masks: tuple[NDArray[np.bool_], ...]
    """The distinct outlines."""


def find_glyphs(page: Page) -> DetectedGlyphs:
    """Find the glyphs of a page; of more than ``MOST_GLYPHS`` the first from the top."""
    packed = hardened(page.cmyk).view(np.uint32)[..., 0]
    colours = text_colours(packed, every=max(int(LEAST_MM / page.pixel_mm), 1))
    pieces, runs = _pieces(packed, colours)
    like = np.flatnonzero(_like_letters(pieces, packed.shape, page.pixel_mm))
    ground = _grounds(packed, pieces[like], colours)
    like, ground = like[ground >= 0][:MOST_GLYPHS], ground[ground >= 0][:MOST_GLYPHS]
    box = pieces[like, :4]
    sizes = box[:, 2] * box[:, 3]
    wanted = np.full(len(pieces), -1, np.int64)
    wanted[like] = np.cumsum(sizes) - sizes
    flat = np.zeros(int(sizes.sum()), np.uint8)
    filled_pieces(runs, pieces, wanted, flat)
    index_of: dict[tuple[int, bytes], int] = {}
    masks: list[NDArray[np.bool_]] = []
    shape = np.empty(like.size, np.int64)
    for at, (begin, size, width) in enumerate(zip(wanted[like], sizes, box[:, 2], strict=True)):
        mask = flat[begin : begin + size]
        key = int(width), mask.tobytes()
        if key not in index_of:
            index_of[key] = len(masks)
            masks.append(mask.reshape(-1, width).view(np.bool_))
        shape[at] = index_of[key]
    return DetectedGlyphs(
        box=box,
        ink=_unpacked(colours[pieces[like, 5]]),
        ground=_unpacked(ground.astype(np.uint32)),
        shape=shape,
        masks=tuple(masks),
    )


def hardened(cmyk: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Set each ink at edges of a raster (rows, columns, 4) to the nearer of its local maximum and minimum.

    Pages of a PDF have partial ink at edges (``pages.job.FINER``); a raster without any is returned
    unchanged.
    """
    cmyk = np.ascontiguousarray(cmyk)
    rows, about = len(cmyk), np.ones((3, 3), np.uint8)
    out = unset(cmyk.shape[:2]).view(np.uint8).reshape(cmyk.shape)
    for top in range(0, rows, BAND_ROWS):
        bottom, above = min(top + BAND_ROWS, rows), min(top, 1)
        band = cmyk[top - above : bottom + 1]
        inner = slice(above, above + bottom - top)
        most, least = cv2.dilate(band, about)[inner], cv2.erode(band, about)[inner]
        here = band[inner]
        less = cv2.compare(cv2.absdiff(most, here), cv2.absdiff(here, least), cv2.CMP_GT)
        cv2.copyTo(least, less, most)
        out[top:bottom] = most
    return out


def _unpacked(colours: NDArray[np.uint32]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(colours, np.uint32).view(np.uint8).reshape(-1, 4)


def text_colours(packed: NDArray[np.uint32], *, every: int) -> NDArray[np.uint32]:
    """Return the colours with most edges along rows, without bare paper.

    every: step between the rows that are read.
    """
    rows = packed[::every]
    edges = rows[:, 1:] != rows[:, :-1]
    colours, counts = np.unique(rows[:, 1:][edges], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    likely = colours[order][(counts[order] >= LEAST_EDGES) & (colours[order] != 0)]
    return np.asarray(likely[:INKS_MOST], np.uint32)


def _pieces(
    packed: NDArray[np.uint32], colours: NDArray[np.uint32]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return pieces and the runs that they are made of, as in ``kernels.statistics.glyphs``.

    A texture has no pieces.
    """
    runs, parents = np.empty((MOST_RUNS, RUN), np.int64), np.empty(MOST_RUNS, np.int64)
    count = max(joined_runs(np.ascontiguousarray(packed), colours, runs, parents), 0)
    runs, parents = runs[:count], parents[:count]
    pieces = np.empty((count, PIECE), np.int64)
    return pieces[: piece_boxes(runs, parents, pieces)], runs


def _like_letters(pieces: NDArray[np.int64], shape: tuple[int, int], pixel_mm: float) -> NDArray[np.bool_]:
    """Return which pieces are of a letter's size and inside the raster."""
    x, y, width, height, area, _ = pieces.T
    most, least, thin = (size / pixel_mm for size in (MOST_MM, LEAST_MM, LEAST_WIDTH_MM))
    like = (height <= most) & (width <= most) & (height >= least) & (width >= thin)
    filled = area / (width * height)
    like &= (filled >= FILLED[0]) & ((filled <= FILLED[1]) | (width < height / 2))
    inside = (x > 0) & (y > 0) & (x + width < shape[1]) & (y + height < shape[0])
    return np.asarray(like & inside)


def _grounds(
    packed: NDArray[np.uint32], pieces: NDArray[np.int64], colours: NDArray[np.uint32]
) -> NDArray[np.int64]:
    """Return the colour at the corners about each piece, its own excluded, (n,).

    It is -1 where these have several colours.
    """
    x, y, width, height, _, colour = pieces.T
    own = colours[colour].astype(np.int64)
    corners = np.stack(
        [packed[j, i] for j in (y - 1, y + height) for i in (x - 1, x + width)], axis=1
    ).astype(np.int64)
    other = np.where(corners == own[:, None], -1, corners)
    ground = other.max(axis=1, initial=-1)
    same = (other == -1) | (other == ground[:, None])
    return np.where(same.all(axis=1), ground, -1)


def lines_of(box: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the line of text of each glyph, from 1 at the top, (n,); box: ``DetectedGlyphs.box``.

    Glyphs are in one line if the middle of one is within the other's height; lines next to each other count
    as one.
    """
    line = np.zeros(len(box), np.int64)
    middles = box[:, 1] + box[:, 3] / 2
    count, bottom = 0, -np.inf
    for at in np.argsort(middles, kind="stable"):
        if middles[at] > bottom:
            count += 1
            bottom = float(box[at, 1] + box[at, 3])
        line[at] = count
    return line
