"""The glyphs of a page, and its letters: glyphs that differ only by their place on the raster's grid.

Glyphs are pieces of one colour, of a letter's size, on one ground colour. No character recognition is needed: the
raster states what is printed. Pieces of one outline have one shape.

A letter's rivals are the page's other letters of similar size. Two outlines are distinguished by their difference as
the camera sees it, after a change of ink as a whole, a shift, and broader or narrower strokes have been projected out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.kernels.memory import unset
from prooflight.kernels.statistics.glyphs import SHARE, Patches
from prooflight.kernels.statistics.pieces import (
    PIECE,
    RUN,
    filled_pieces,
    harden_rows,
    joined_runs,
    piece_boxes,
)

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.pages.sampling import Footprint

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
    packed = page.packed
    colours = text_colours(hardened(packed, every=max(int(LEAST_MM / page.pixel_mm), 1)))
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


def hardened(packed: NDArray[np.uint32], *, every: int = 1) -> NDArray[np.uint32]:
    """Set each ink at edges of a raster (rows, columns) to the nearer of its local maximum and minimum.

    Pages of a PDF have partial ink at edges (``pages.job.FINER``); a raster without any is returned
    unchanged. every: step between the rows that are returned.
    """
    out = unset((-(-len(packed) // every), packed.shape[1])).view(np.uint32)
    harden_rows(packed, every, out)
    return out


def _hardened_at(
    packed: NDArray[np.uint32], rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> NDArray[np.uint32]:
    """Return the recipes of some pixels (n,) as ``hardened`` does."""
    about = np.arange(-1, 2)
    near_rows = (rows[:, None] + about).clip(0, packed.shape[0] - 1)
    near_columns = (columns[:, None] + about).clip(0, packed.shape[1] - 1)
    near = packed[near_rows[:, :, None], near_columns[:, None, :]]
    return hardened(near.reshape(-1, 3))[1::3, 1]  # the middle of each sees its own surroundings alone


def _unpacked(colours: NDArray[np.uint32]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(colours, np.uint32).view(np.uint8).reshape(-1, 4)


def text_colours(rows: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Return the colours with most edges along rows (rows, columns) of a raster, without bare paper."""
    edges = rows[:, 1:] != rows[:, :-1]
    colours, counts = np.unique(rows[:, 1:][edges], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    likely = colours[order][(counts[order] >= LEAST_EDGES) & (colours[order] != 0)]
    return np.asarray(likely[:INKS_MOST], np.uint32)


def _pieces(
    packed: NDArray[np.uint32], colours: NDArray[np.uint32]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return pieces and the runs that they are made of, as in ``kernels.statistics.pieces``.

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
    rows = np.stack([y - 1, y - 1, y + height, y + height])
    columns = np.stack([x - 1, x + width] * 2)
    corners = _hardened_at(packed, rows.ravel(), columns.ravel()).reshape(4, -1).T.astype(np.int64)
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


RIVALS: Final = 24
"""Maximum number of letters that a glyph is tested against."""
MARGIN: Final = 5
"""Margin about a letter's box in its patch: two and a half pixels, one of which is for slopes. [cells]"""
ALIKE: Final = 0.05
"""Share of a letter's own power up to which two outlines are one letter."""
COVERED: Final = 0.8
"""Share of a letter's distinguishing power from which a rival represents another: if that one were printed,
the rival would score almost as high as it would itself."""
LIKE_HEIGHT: Final = 0.2
LIKE_WIDTH: Final = 0.7
"""Shares of its height by which a letter's rivals may be higher and wider."""
MOST_LETTERS: Final = 400
"""Maximum number of letters: a page with more is no page of type, and its rarest pieces are omitted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """Optics of the camera for outlines in cells of half a pixel."""

    footprint: Footprint
    cell_mm: tuple[float, float]
    """Size of a cell, across and along."""

    @classmethod
    def of(cls, footprint: Footprint, pitch_mm: tuple[float, float]) -> Optics:
        """Return the optics of pixels of a pitch across and along."""
        across, along = (pitch / SHARE for pitch in pitch_mm)
        return cls(footprint=footprint, cell_mm=(across, along))

    def down(self, places: NDArray[np.floating], cells: int) -> NDArray[np.float32]:
        """Return the weights (pixels, cells) of rows of cells.

        places: of pixels [cells from the first's middle].
        """
        return self._shares(self.footprint.along, self.cell_mm[1], places, cells)

    def right(self, places: NDArray[np.floating], cells: int) -> NDArray[np.float32]:
        """Return the weights of columns, likewise."""
        return self._shares(self.footprint.across, self.cell_mm[0], places, cells)

    def _shares(
        self, cumulative: NDArray[np.float64], cell_mm: float, places: NDArray[np.floating], cells: int
    ) -> NDArray[np.float32]:
        reach_mm = self.footprint.reach_mm
        edges = (np.arange(cells + 1) - 0.5 - np.asarray(places)[:, None]) * cell_mm
        offsets = np.linspace(-reach_mm, reach_mm, cumulative.size)
        return np.diff(np.interp(edges, offsets, cumulative, left=0.0, right=1.0), axis=1).astype(np.float32)


def in_cells(mask: NDArray[np.bool_], raster_pixels: Sequence[float]) -> NDArray[np.float32]:
    """Return the share of each cell that an outline covers; raster_pixels: a cell, across and along."""
    across, along = raster_pixels
    down, right = _covering(mask.shape[0], along), _covering(mask.shape[1], across)
    return np.asarray(down @ mask.astype(np.float32) @ right.T)


@lru_cache(maxsize=256)
def _covering(count: int, raster_pixels: float) -> NDArray[np.float32]:
    """Return the share of each cell that each raster pixel covers, (cells, count).

    The first of both begin together.
    """
    cells = int(np.ceil(count / raster_pixels - 1e-9))
    begin, edges = np.arange(cells)[:, None] * raster_pixels, np.arange(count)[None]
    shared = np.minimum(begin + raster_pixels, edges + 1) - np.maximum(begin, edges)
    return (shared.clip(min=0) / raster_pixels).astype(np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Letters:
    """The distinct outlines of a page, and their assignment to letters."""

    cells: tuple[NDArray[np.float32], ...]
    """Share of each cell that each outline covers."""
    centroid: NDArray[np.float64]
    """(outlines, 2) centroid, to the right of and below the outline's corner. [cells]"""
    size: NDArray[np.int64]
    """(outlines, 2) rows and columns. [cells]"""
    seen: NDArray[np.float32]
    """(outlines, n) images as the camera sees them, with centroids aligned to whole cells."""
    anyway: NDArray[np.float32]
    """(outlines, 4, n) effect of a shift and of the breadth of strokes, each across and along."""
    leader: NDArray[np.int64]
    """(letters,) index of the outline that represents each letter."""
    letter: NDArray[np.int64]
    """(outlines,) index of each outline's letter; -1: none."""
    rival_cache: dict[int, NDArray[np.int64]] = field(default_factory=dict)
    """Cache of ``rivals``: sheets of a design need the same ones."""

    @classmethod
    def of(cls, cells: Sequence[NDArray[np.float32]], often: NDArray[np.int64], optics: Optics) -> Letters:
        """Group outlines, the most frequent of which represent letters; often: how often each occurs."""
        size = np.array([one.shape for one in cells], np.int64).reshape(-1, 2)
        centroid = np.array([_centroid(one) for one in cells]).reshape(-1, 2)
        seen, anyway = _as_seen(cells, size, centroid, optics)
        letter = np.full(len(cells), -1, np.int64)
        letters = cls(
            cells=tuple(cells),
            centroid=centroid,
            size=size,
            seen=seen,
            anyway=anyway,
            leader=np.zeros(0, np.int64),
            letter=letter,
        )
        leaders: list[int] = []
        for at in np.argsort(-often, kind="stable"):
            if letter[at] >= 0:
                continue
            if len(leaders) == MOST_LETTERS:
                break
            letter[at] = len(leaders)
            free = np.flatnonzero((letter < 0) & letters.like(int(at)))
            if free.size:
                letter[free[letters.separation(int(at), free) < ALIKE]] = len(leaders)
            leaders.append(int(at))
        object.__setattr__(letters, "leader", np.array(leaders, np.int64))
        return letters

    def like(self, at: int) -> NDArray[np.bool_]:
        """Return which outlines are of a size similar to outline ``at``, (outlines,)."""
        height, width = self.size.T
        near = np.abs(height - height[at]) <= max(LIKE_HEIGHT * height[at], 1)
        return near & (np.abs(width - width[at]) <= max(LIKE_WIDTH * height[at], 1))

    def separation(self, at: int, others: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the power of others' difference to an outline, over its own.

        ``anyway`` and ink are projected out.
        """
        basis = np.stack([self.seen[at], *self.anyway[at]]).astype(np.float64)
        own = basis @ basis.T + 1e-9 * np.eye(len(basis))
        difference = self.seen[others] - self.seen[at]
        onto = difference @ basis.T
        left = (difference**2).sum(axis=1) - (onto * np.linalg.solve(own, onto.T).T).sum(axis=1)
        return np.asarray(np.maximum(left, 0) / own[0, 0])

    def rivals(self, at: int) -> NDArray[np.int64]:
        """Return outlines of letters that outline ``at`` might be mistaken for, the most similar first.

        An outline that an earlier one represents is omitted (``COVERED``).
        """
        if at not in self.rival_cache:
            self.rival_cache[at] = self._rivals(at)
        return self.rival_cache[at]

    def _rivals(self, at: int) -> NDArray[np.int64]:
        can = self.leader[self.like(at)[self.leader]]
        distance = self.separation(at, can)
        can, distance = can[distance >= ALIKE], distance[distance >= ALIKE]
        power = float((self.seen[at].astype(np.float64) ** 2).sum())
        open_ = np.ones(can.size, bool)
        rivals: list[int] = []
        while open_.any() and len(rivals) < RIVALS:
            nearest = int(np.flatnonzero(open_)[distance[open_].argmin()])
            rivals.append(int(can[nearest]))
            between = ((self.seen[can] - self.seen[can[nearest]]) ** 2).sum(axis=1) / power
            open_ &= distance - between < COVERED * distance
            open_[nearest] = False
        return np.array(rivals, np.int64)

    def patches(self, optics: Optics) -> Patches:
        """Return the patch of each letter, with ``MARGIN`` about it."""
        size = self.size[self.leader] + 2 * MARGIN
        lengths = size.prod(axis=1)
        downs = {
            rows: optics.down(np.arange(rows) - MARGIN, rows - 2 * MARGIN)
            for rows in set(size[:, 0].tolist())
        }
        rights = {
            wide: optics.right(np.arange(wide) - MARGIN, wide - 2 * MARGIN)
            for wide in set(size[:, 1].tolist())
        }
        images = [
            downs[rows] @ self.cells[at] @ rights[columns].T
            for at, (rows, columns) in zip(self.leader, size.tolist(), strict=True)
        ]
        flat = [image.ravel() for image in images] or [np.zeros(0, np.float32)]
        return Patches(own=np.concatenate(flat), size=size, first=np.cumsum(lengths) - lengths)


def _as_seen(
    cells: Sequence[NDArray[np.float32]],
    size: NDArray[np.int64],
    centroid: NDArray[np.float64],
    optics: Optics,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return ``Letters.seen`` and ``Letters.anyway``, at a spacing of one pixel."""
    before = np.rint(centroid[:, ::-1]).astype(int)
    reach = np.maximum(before, size - before).max(axis=0, initial=1)
    canvas = np.zeros((len(cells), *(2 * reach)), np.float32)
    for image, one, middle in zip(canvas, cells, reach - before, strict=True):
        image[middle[0] : middle[0] + one.shape[0], middle[1] : middle[1] + one.shape[1]] = one
    along = optics.down(np.arange(-2 * SHARE, 2 * reach[0] + 2 * SHARE, SHARE), int(2 * reach[0]))
    across = optics.right(np.arange(-2 * SHARE, 2 * reach[1] + 2 * SHARE, SHARE), int(2 * reach[1]))
    seen = np.matmul(np.matmul(along, canvas), across.T)
    wide = np.pad(seen, ((0, 0), (1, 1), (1, 1)))
    up, down, left, right = wide[:, :-2, 1:-1], wide[:, 2:, 1:-1], wide[:, 1:-1, :-2], wide[:, 1:-1, 2:]
    anyway = np.stack([right - left, down - up, left + right - 2 * seen, up + down - 2 * seen], axis=1)
    pixels = seen.shape[1] * seen.shape[2]
    return seen.reshape(len(cells), pixels), anyway.reshape(len(cells), 4, pixels)


def _centroid(cells: NDArray[np.float32]) -> tuple[float, float]:
    """Return the centroid, to the right of and below the corner."""
    whole = cells.sum()
    return (
        float(cells.sum(axis=0) @ (np.arange(cells.shape[1]) + 0.5) / whole),
        float(cells.sum(axis=1) @ (np.arange(cells.shape[0]) + 0.5) / whole),
    )
