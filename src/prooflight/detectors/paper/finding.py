"""Placement of a scan's page, and the prediction at that placement: the scan is never moved."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.placing import inside, place_reason, shift_of, shows_another, unplaced_reason
from prooflight.prediction.predict import relit
from prooflight.registration.register import prepare, register
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import Area, PlannedPage, PressContext
    from prooflight.pages.raster import Page
    from prooflight.prediction.predict import Prediction
    from prooflight.prediction.tables import SensorModel
    from prooflight.registration.register import Landmarks, Registration
    from prooflight.scans.placement import Placement

MOVED_SIGMAS: Final = 4.0
"""Minimum displacement that is followed, in its standard deviations: following noise would blur every edge by
it."""
MOVED_PIXELS: Final = 0.02
"""Minimum displacement that is followed: no edge shows less above its noise. [camera pixels]"""


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
