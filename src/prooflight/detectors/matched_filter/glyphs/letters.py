"""The letters of a page: outlines that differ only by their place on the raster's grid are one letter.

A letter's rivals are the page's other letters of similar size. Two outlines are distinguished by their
difference as the camera sees it, after a change of ink as a whole, a shift, and broader or narrower strokes
have been projected out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.kernels.statistics.glyphs import SHARE, Patches

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.pages.sampling import Footprint

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
            free = np.flatnonzero((letter < 0) & letters.like(int(at)))
            letter[free[letters.separation(int(at), free) < ALIKE]] = len(leaders)
            letter[at] = len(leaders)
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
        images = [
            optics.down(np.arange(rows) - MARGIN, rows - 2 * MARGIN)
            @ self.cells[at]
            @ optics.right(np.arange(columns) - MARGIN, columns - 2 * MARGIN).T
            for at, (rows, columns) in zip(self.leader, size, strict=True)
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
