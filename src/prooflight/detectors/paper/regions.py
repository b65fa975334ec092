"""Place and kind of a misprint, from the map of block means."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from prooflight.detectors.verdict import Region

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

FLAGGED = 6.0
"""Standard deviations beyond which a block mean is flagged: 1e-4 blocks of a good A4 page, ideal world."""
JOINING_BLOCKS = 7
"""Distance up to which flagged blocks are joined: 6 mm. [blocks]"""
MOST_REGIONS = 12
UNKNOWN = "unknown"
STREAK_WIDTH_MM = 5.0
INKED = 0.01
"""Minimum mean ink fraction at which a block contains an ink."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Findings:
    """Regions, strongest first, and the kind of the whole."""

    regions: tuple[Region, ...]
    kind: str | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BlockGrid:
    """The map of block means of one page and its position on the page."""

    z: NDArray[np.float32]
    """(sensors, rows, columns) block means in their standard deviations; above 0: lighter than expected."""
    tiles: NDArray[np.float64]
    """(tile rows, tile columns) evidence of each tile, for a misprint too faint for any single block."""
    blocks_per_tile: int
    ink: Callable[[], NDArray[np.float32]]
    """Function that returns the planned mean ink fractions, (rows, columns, 4); the kind of most misprints
    does not need it."""
    left_mm: float
    top_mm: float
    width_mm: float
    height_mm: float
    """Size of one block. [mm]"""


def findings(grid: BlockGrid) -> Findings:
    """Group flagged blocks into regions and name the kind of each.

    A misprint too faint for any block is located in the tile with the most evidence, and its kind is unknown.
    """
    strongest = np.take_along_axis(grid.z, np.abs(grid.z).argmax(axis=0)[None], axis=0)[0]
    flagged = np.abs(strongest) > FLAGGED
    if not flagged.any():
        row, column = np.unravel_index(grid.tiles.argmax(), grid.tiles.shape)
        side = grid.blocks_per_tile
        tile = np.zeros_like(flagged)
        last = np.equal((row + 1, column + 1), grid.tiles.shape)  # the last tiles contain the remainder
        inside = tuple(
            slice(at * side, None if ends else (at + 1) * side)
            for at, ends in zip((row, column), last, strict=True)
        )
        tile[inside] = True
        return Findings(regions=(_region(tile, strongest, grid, UNKNOWN),), kind=UNKNOWN)
    whole = _kind(flagged, strongest, grid)
    if whole in ("missing-plane", "wrong-page"):
        # One cause all over the page: one box around it is clearer than a hundred around single words.
        return Findings(regions=(_region(flagged, strongest, grid, whole),), kind=whole)
    kernel = np.ones((JOINING_BLOCKS, JOINING_BLOCKS), np.uint8)
    joined = cv2.morphologyEx(np.pad(flagged.astype(np.uint8), JOINING_BLOCKS), cv2.MORPH_CLOSE, kernel)
    inner = slice(JOINING_BLOCKS, -JOINING_BLOCKS)
    count, labels = cv2.connectedComponents(np.ascontiguousarray(joined[inner, inner]))
    weight = np.bincount(labels.ravel(), weights=(np.abs(strongest) * flagged).ravel(), minlength=count)
    heaviest = 1 + np.argsort(-weight[1:], kind="stable")[:MOST_REGIONS]
    pieces = [flagged & (labels == label) for label in heaviest]
    kinds = [_kind(piece, strongest, grid) for piece in pieces]
    regions = tuple(_region(piece, strongest, grid, kind) for piece, kind in zip(pieces, kinds, strict=True))
    return Findings(regions=regions, kind=kinds[0])


def _region(blocks: NDArray[np.bool_], strongest: NDArray[np.float32], grid: BlockGrid, kind: str) -> Region:
    """Return the box around blocks (rows, columns), of which there is at least one."""
    left, top, columns, rows = cv2.boundingRect(blocks.astype(np.uint8))
    box_mm = (
        grid.left_mm + left * grid.width_mm,
        grid.top_mm + top * grid.height_mm,
        columns * grid.width_mm,
        rows * grid.height_mm,
    )
    return Region.rounded(box_mm, score=float(np.abs(strongest[blocks]).max()), kind=kind)


def _kind(flagged: NDArray[np.bool_], strongest: NDArray[np.float32], grid: BlockGrid) -> str:
    """Name the kind of a set of flagged blocks (rows, columns).

    Narrow and long: a streak. Nothing darker, and lighter only where one ink was planned: that plane is
    missing. Nothing darker otherwise: content is missing. Darker as well as lighter: something else was
    printed.
    """
    _, top, columns, rows = cv2.boundingRect(flagged.astype(np.uint8))
    width_mm, height_mm = columns * grid.width_mm, rows * grid.height_mm
    if width_mm <= STREAK_WIDTH_MM and height_mm > 4 * width_mm:
        return "streak"
    if (strongest[flagged] < 0).sum() > 0.02 * flagged.sum():
        return "wrong-page"
    there = slice(top, top + rows)
    for ink in range(4):
        inked = grid.ink()[there, :, ink] > INKED
        if not inked.any():
            continue
        covered = (flagged[there] & inked).sum() / inked.sum()
        stray = (flagged[there] & ~inked).sum() / flagged.sum()
        if covered > 0.7 and stray < 0.12:
            return "missing-plane"
    return "missing-content"
