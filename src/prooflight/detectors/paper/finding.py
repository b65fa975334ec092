"""Placement of a scan's page, and the prediction at that placement: the scan is never moved.

Place and kind of a misprint follow from the map of block means.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.placing import inside, place_reason, shift_of, shows_another, unplaced_reason
from prooflight.detectors.verdict import Region
from prooflight.prediction.predict import Prediction, relit
from prooflight.registration.register import Landmarks, Registration, prepare, register
from prooflight.scans.placement import IN_PLACE, Placement

if TYPE_CHECKING:
    from prooflight.detectors.base import Area, PlannedPage, PressContext
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel

MOVED_SIGMAS: Final = 4.0
"""Minimum displacement that is followed, in its standard deviations: following noise would blur every edge by
it."""
MOVED_PIXELS: Final = 0.02
"""Minimum displacement that is followed: no edge shows less above its noise. [camera pixels]"""
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
class PlacedPage:
    """A page at the placement that its scan shows."""

    placement: Placement
    """``IN_PLACE`` unless the scan shows otherwise."""
    prediction: Prediction
    """Prediction of the page at its placement."""
    area: Area
    """Lines and columns that are judged; the scan contains all of them."""
    wrong_page: bool
    """Whether the scan shows another page, or this one where no good print is."""
    reason: str
    """Why it is a wrong page, in words; empty: it is not."""
    unplaced: str
    """Why the page is not inspected, as its place is not known; empty: it is known."""
    shift_mm: tuple[float, float] | None
    """Shift of the page; None: the page could not be found in the scan."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SoughtPage:
    """A page prepared for registration in its scans."""

    page: Page
    nominal: Prediction
    """Prediction of the page in its nominal place, under the light at its preparation."""
    lit: tuple[SensorModel, ...]
    """The sensors under that light."""
    area: Area
    """Lines and columns of a scan that it covers in its nominal place."""
    landmarks: Landmarks

    @classmethod
    def of(cls, planned: PlannedPage) -> SoughtPage:
        """Compute everything that needs no scan."""
        page, nominal = planned.page, planned.expected
        sensors, geometry = planned.press_context.sensors, planned.press_context.geometry
        landmarks = prepare(page, nominal, sensors=sensors, geometry=geometry)
        area = geometry.on_page(page.width_mm, page.height_mm)
        return cls(page=page, nominal=nominal, lit=landmarks.sensors, area=area, landmarks=landmarks)

    def relit(self, press_context: PressContext) -> SoughtPage:
        """Return the page under another light of the press; its landmarks stay."""
        return replace(self, landmarks=replace(self.landmarks, sensors=press_context.sensors))

    def in_place(self, press_context: PressContext) -> Prediction:
        """Return the prediction of the page in its nominal place, under the current light.

        It is computed on demand, because hardly any print is in its nominal place to a fiftieth of a pixel.
        """
        if press_context.sensors is self.lit:
            return self.nominal
        return relit(self.nominal, self.lit, press_context.sensors) or press_context.predict(self.page)


def find(sought: SoughtPage, scan: NDArray[np.uint16], press_context: PressContext) -> PlacedPage:
    """Find a page in ``scan`` (sensors, lines, pixels) [DN] and predict it at its placement.

    scan: as returned by ``inspection.inspector.judged_lines``.
    """
    page = sought.page
    where = register(sought.landmarks, scan, threads=press_context.threads or os.cpu_count() or 1)
    placement = where.placement if where.located and _moved(where, page, press_context) else IN_PLACE
    moved = placement is not IN_PLACE
    prediction = press_context.predict(page, placement) if moved else sought.in_place(press_context)
    another = shows_another(where)
    return PlacedPage(
        placement=placement,
        prediction=prediction,
        area=inside(page, press_context.geometry, placement, lines=scan.shape[1]) if moved else sought.area,
        wrong_page=another,
        reason=place_reason(where) if another else "",
        unplaced=unplaced_reason(where) if where.unplaced else "",
        shift_mm=shift_of(replace(where, placement=placement)),
    )


def _moved(where: Registration, page: Page, press_context: PressContext) -> bool:
    """Return whether the page is displaced by more than the estimate's own uncertainty."""
    reach_mm = np.array([page.height_mm, page.width_mm]) / 2
    turn_mm = np.deg2rad(abs(where.placement.skew_deg)) * reach_mm
    turn_sd_mm = np.deg2rad(where.skew_sd_deg) * reach_mm
    shift_mm, sd_mm = np.abs(where.placement.shift_mm), np.array(where.shift_sd_mm)
    pitch_mm = np.array([press_context.geometry.pixel_pitch_mm, press_context.geometry.line_pitch_mm])
    shifted = (shift_mm > MOVED_SIGMAS * sd_mm) & (shift_mm > MOVED_PIXELS * pitch_mm)
    turned = (turn_mm > MOVED_SIGMAS * turn_sd_mm) & (turn_mm > MOVED_PIXELS * pitch_mm)
    return bool(shifted.any() or turned.any())


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
