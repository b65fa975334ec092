"""Where the page of a scan lies, and what that means for the inspection: the prediction moves, never the scan."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.matched_filter.calibrated import shows_another
from prooflight.detectors.matched_filter.explaining import place_reason
from prooflight.detectors.paper.evidence import BLOCK_PIXELS
from prooflight.prediction.predict import predict, relit
from prooflight.registration.register import prepare, register
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.prediction.predict import Prediction
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press
    from prooflight.registration.register import Landmarks, Registration
    from prooflight.scans.placement import Placement

MOVED_SIGMAS: Final = 4.0
"""A page is moved for no less: to follow an estimate that is only noise would blur every edge by it."""
MOVED_PIXELS: Final = 0.02
"""Nor for less than this, which no edge shows above its noise. [camera pixels]"""
EDGE_PIXELS: Final = 1.0
"""What is left out inside the edges of a page that was moved: sheet and print do not move as one. [camera pixels]"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundPage:
    """A page where its scan shows it."""

    placement: Placement
    """``IN_PLACE`` where the scan does not tell otherwise."""
    prediction: Prediction
    """Of the page as it lies."""
    area: tuple[slice, slice]
    """Lines and columns that are judged; the scan has them all."""
    wrong_page: bool
    """The scan shows another page, or this one where no good print lies."""
    reason: str
    """Why it is a wrong page, in words; empty: it is not."""
    shift_mm: tuple[float, float] | None
    """None: the page could not be found in the scan."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SoughtPage:
    """A page ready to be looked for in its scans."""

    page: Page
    nominal: Prediction
    """Of the page in its place, under the light that it was made ready for."""
    lit: tuple[SensorModel, ...]
    """The sensors under that light."""
    area: tuple[slice, slice]
    """Lines and columns of a scan that it then covers."""
    landmarks: Landmarks

    @classmethod
    def of(cls, page: Page, press: Press, *, threads: int | None = None) -> SoughtPage:
        """Everything that needs no scan. threads: see ``predict``."""
        nominal = predict(page, sensors=press.sensors, geometry=press.geometry, threads=threads)
        landmarks = prepare(page, nominal, sensors=press.sensors, geometry=press.geometry)
        area = press.geometry.on_page(page.width_mm, page.height_mm)
        return cls(page=page, nominal=nominal, lit=landmarks.sensors, area=area, landmarks=landmarks)

    def relit(self, press: Press) -> SoughtPage:
        """The same where only the light of the press has changed: its landmarks stay."""
        return replace(self, landmarks=replace(self.landmarks, sensors=press.sensors))

    def in_place(self, *, threads: int | None = None) -> Prediction:
        """Of the page in its place, under the light as it is now.

        Made when it is asked for: hardly a print lies in its place to a fiftieth of a pixel. threads: see ``predict``.
        """
        now = self.landmarks.sensors
        if now is self.lit:
            return self.nominal
        known = relit(self.nominal, self.lit, now)
        if known is not None:
            return known
        return predict(self.page, sensors=now, geometry=self.landmarks.geometry, threads=threads)


def find_page(page: Page, scan: NDArray[np.uint16], press: Press) -> FoundPage:
    """Look for ``page`` in ``scan`` (sensors, lines, pixels) [DN] and predict it where it lies."""
    return find(SoughtPage.of(page, press), scan, press)


def find(
    sought: SoughtPage, scan: NDArray[np.uint16], press: Press, *, threads: int | None = None
) -> FoundPage:
    """Look for a page in ``scan`` (sensors, lines, pixels) [DN] and predict it where it lies.

    scan: as ``inspector.judged_lines`` leaves it. threads: see ``predict``.
    """
    page = sought.page
    where = register(sought.landmarks, scan, threads=threads or os.cpu_count() or 1)
    placement = where.placement if where.found and _moved(where, page, press) else IN_PLACE
    moved = placement is not IN_PLACE
    prediction = (
        predict(page, sensors=press.sensors, geometry=press.geometry, placement=placement, threads=threads)
        if moved
        else sought.in_place(threads=threads)
    )
    shift_mm = (round(placement.shift_mm[0], 4), round(placement.shift_mm[1], 4)) if where.found else None
    another = shows_another(where)
    return FoundPage(
        placement=placement,
        prediction=prediction,
        area=inside(page, press, placement, lines=scan.shape[1]) if moved else sought.area,
        wrong_page=another,
        reason=place_reason(where) if another else "",
        shift_mm=shift_mm,
    )


def _moved(where: Registration, page: Page, press: Press) -> bool:
    """Whether the page lies off its place by more than the estimate's own doubt."""
    reach_mm = np.array([page.height_mm, page.width_mm]) / 2
    turn_mm = np.deg2rad(abs(where.placement.skew_deg)) * reach_mm
    turn_sd_mm = np.deg2rad(where.skew_sd_deg) * reach_mm
    shift_mm, sd_mm = np.abs(where.placement.shift_mm), np.array(where.shift_sd_mm)
    pitch_mm = np.array([press.geometry.pixel_pitch_mm, press.geometry.line_pitch_mm])
    told = (shift_mm > MOVED_SIGMAS * sd_mm) & (shift_mm > MOVED_PIXELS * pitch_mm)
    turned = (turn_mm > MOVED_SIGMAS * turn_sd_mm) & (turn_mm > MOVED_PIXELS * pitch_mm)
    return bool(told.any() or turned.any())


def inside(page: Page, press: Press, placement: Placement, *, lines: int) -> tuple[slice, slice]:
    """Of so many lines, those whose pixels all lie on the page as it lies, one away from its edges; and columns.

    Where fewer are left than a block has, those of the page in its place.
    """
    geometry = press.geometry
    across_mm = geometry.centres_x_mm(page.width_mm)
    down_mm = geometry.centres_y_mm(lines)
    seen = partial(placement.seen_mm, page_width_mm=page.width_mm, page_height_mm=page.height_mm)
    margin_x, margin_y = EDGE_PIXELS * geometry.pixel_pitch_mm, EDGE_PIXELS * geometry.line_pitch_mm
    on_columns, on_lines = np.ones(across_mm.size, bool), np.ones(down_mm.size, bool)
    for part in (0.0, 0.5, 1.0):
        x_mm, _ = seen(across_mm, np.full_like(across_mm, part * page.height_mm))
        on_columns &= (x_mm >= margin_x) & (x_mm <= page.width_mm - margin_x)
        _, y_mm = seen(np.full_like(down_mm, part * page.width_mm), down_mm)
        on_lines &= (y_mm >= margin_y) & (y_mm <= page.height_mm - margin_y)
    columns, rows = np.flatnonzero(on_columns), np.flatnonzero(on_lines)
    if min(columns.size, rows.size) < BLOCK_PIXELS:
        return geometry.on_page(page.width_mm, page.height_mm)
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
