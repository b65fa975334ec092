"""The explanation of one page's misprint: kind, places and reason, by whatever evidence decided."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final

from prooflight.detectors.matched_filter.amounts import amount_in
from prooflight.detectors.matched_filter.explaining import (
    distinct_inks,
    floor_explanation,
    measured_inks,
    reason_for,
    regions_of,
    whole_page,
)
from prooflight.detectors.matched_filter.extents import MODES_OF_EXTENT, column_evidence, extended
from prooflight.detectors.matched_filter.glyphs.reporting import glyph_explanation, glyphs_name
from prooflight.detectors.matched_filter.naming import UNKNOWN, kind_of, named, supported
from prooflight.detectors.matched_filter.statistics.statistic import values_of
from prooflight.detectors.matched_filter.streak_place import streak_centre
from prooflight.detectors.placing import WRONG_PAGE_KIND

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.analysis import PreparedPage, ScanAnalysis
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.extents import Extent
    from prooflight.detectors.matched_filter.far_amounts import FarAmounts
    from prooflight.detectors.matched_filter.glyphs.scoring import ScoredPage
    from prooflight.detectors.matched_filter.model import DetectorModel
    from prooflight.detectors.matched_filter.statistics.marks import FloorFinding
    from prooflight.detectors.matched_filter.statistics.statistic import Box, Observed
    from prooflight.detectors.matched_filter.zones import ZonedJudge
    from prooflight.detectors.verdict import Decision, Ink, Region
    from prooflight.pages.zones.zone import PageZones
    from prooflight.prediction.tables import SensorModel
    from prooflight.registration.register import Registration

PARTS: Final = "parts of the page do not look as designed"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """What one scan shows, as far as it decides or explains."""

    analysis: ScanAnalysis
    score: float
    """Score of the ranking."""
    strongest: list[tuple[str, Observed]]
    """The families that speak most for a misprint, and the strongest statistic of each."""
    values: NDArray[np.float32]
    """(statistics,) values in the order of the model."""
    careful: list[Observed]
    """Statistics of the page's careful areas; empty: it has none."""
    another: bool
    """Whether the scan shows another page."""
    glyphs: ScoredPage
    floor: FloorFinding

    def settled(self) -> Evidence:
        """Return the same evidence without the scan's images; see ``ScanAnalysis.settled``."""
        return replace(self, analysis=self.analysis.settled())


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """The decision on a page."""

    decision: Decision
    by_ranking: bool
    """Whether the ranking alone calls the page a misprint."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explainer:
    """What is known of a page by which its misprints are explained."""

    prepared: PreparedPage
    inks: str
    """Letters of CMYK that the page has."""
    model: DetectorModel
    """Model by which this page is judged."""
    calibrated: CalibratedDetector
    sensors: Sequence[SensorModel]
    """Sensors of the press."""
    zones: PageZones | None
    judge: ZonedJudge | None

    def explanation(self, evidence: Evidence, judged: Judged, far: FarAmounts | None) -> dict[str, Any]:
        """Return kind, regions and reason of a misprint; empty: the page is none.

        The ranking explains first, then the floor, and wrong glyphs where they name what the ranking saw.
        far: amounts of planes that lie further off than registration follows; None: they were not looked for.
        """
        analysis, strongest, explanation = evidence.analysis, evidence.strongest, dict[str, Any]()
        if judged.by_ranking:
            explanation = self._of_ranking(evidence, far)
        if evidence.floor.alarms and not explanation:
            explanation = floor_explanation(evidence.floor, analysis.registration)
        wrong = self.calibrated.wrong_glyphs(evidence.glyphs) if judged.decision.misprint else ()
        if wrong and self.prepared.glyphs is not None:
            others, kind = explanation.get("regions", ()), explanation.get("kind", "")
            # The evidence itself decides, not the extent of the defect that it is taken for.
            places = self._places(kind, *_ordered(strongest, kind), analysis) if judged.by_ranking else others
            if not explanation or glyphs_name(self.prepared.glyphs, wrong, places, kind=kind):
                explanation = glyph_explanation(self.prepared.glyphs, wrong, others)
        return explanation

    def _of_ranking(self, evidence: Evidence, far: FarAmounts | None) -> dict[str, Any]:
        """Return kind, places and reason of a misprint; of one with a plane out of register, that."""
        analysis, strongest, another = evidence.analysis, evidence.strongest, evidence.another
        registration = analysis.registration
        if self.judge is not None and not another:
            careful = evidence.careful
            if self.judge.careful_alarms(self.calibrated, values_of(careful)):
                return self._careful_explanation(analysis, self.judge.greatest(careful))
        learned = self.model.kinds_of(evidence.values[None], self.prepared.page_features[None])[0]
        kind, ink = WRONG_PAGE_KIND, ""
        if not another:
            kind = supported(learned or named(strongest), registration, self.inks)
        if far is not None and far.displaced.any():
            kind, ink = "plane-register", far.displaced_ink
        inks = measured_inks(analysis, self.inks, far)
        regions = self._regions(strongest, kind, analysis, inks, ink=ink)
        reason = PARTS
        if another or kind != WRONG_PAGE_KIND:
            speaking = next(
                (statistic for _, statistic in strongest if kind_of(statistic.statistic) == kind), None
            )
            place = regions[0] if regions else None
            distinct = {*distinct_inks(self.sensors), ink}
            reason = reason_for(kind, speaking, place, inks, registration, distinct=distinct, ink=ink)
        return {"kind": kind, "regions": regions, "reason": reason}

    def _careful_explanation(self, analysis: ScanAnalysis, greatest: Observed) -> dict[str, Any]:
        """Return kind, places and reason of a misprint in a careful area.

        greatest: the area's greatest statistic, with its deviation.
        """
        kind, strongest = kind_of(greatest.statistic), [(greatest.statistic.cause, greatest)]
        inks = measured_inks(analysis, self.inks)
        regions = self._regions(strongest, kind, analysis, inks, careful=True)
        place = regions[0] if regions else None
        distinct = distinct_inks(self.sensors)
        reason = reason_for(kind, greatest, place, inks, analysis.registration, distinct=distinct)
        zone = None
        if place is not None and self.zones is not None:
            middle = place.x_mm + place.width_mm / 2, place.y_mm + place.height_mm / 2
            zone = self.zones.at(*middle)
        name = f" '{zone.name}'" if zone is not None and zone.kind == "careful" else ""
        return {"kind": kind, "regions": regions, "reason": f"{reason}, in the careful zone{name}"}

    def _regions(
        self,
        strongest: list[tuple[str, Observed]],
        kind: str,
        analysis: ScanAnalysis,
        inks: dict[str, Ink],
        *,
        careful: bool = False,
        ink: str = "",
    ) -> tuple[Region, ...]:
        """Return places, those of the verdict's kind first; a wrong page is wrong as a whole.

        ink: letter of the ink that is off there; empty: its amount is looked for.

        careful: the values are deviations of a careful area, of which the model does not know what good pages show.
        """
        if kind == WRONG_PAGE_KIND:
            return self._places(kind, strongest, [], analysis)
        places, kinds = _ordered(strongest, kind)
        sums, fit = analysis.sums, analysis.fit
        if kind in MODES_OF_EXTENT and not careful:
            box_of: Callable[[Extent], Box] = attrgetter("box")
            if kind == "streak":
                box_of = partial(self._streak_box, analysis)
            places, kinds = extended(kind, places, sums, fit.gain, box_of=box_of), [kind] * len(places)
        distinct = distinct_inks(self.sensors)

        def measured(statistic: Observed) -> dict[str, Any]:
            features = self.prepared.page_features
            above_good_sd = None if careful else self.model.above_good(statistic, features)
            if ink:
                return {"ink": ink, "above_good_sd": above_good_sd}
            placed = analysis.placed()
            shape = placed.where.inside.shape
            rows, columns = sums.cells_of(statistic.box, shape, (sums.pixel_mm, sums.pixel_mm))
            added = self.prepared.added
            amount = amount_in(kind, rows, columns, placed, added, fit, distinct=distinct, inks=inks)
            return asdict(amount) | {"above_good_sd": above_good_sd}

        return self._places(kind, places, kinds, analysis, measured)

    def _streak_box(self, analysis: ScanAnalysis, streak: Extent) -> Box:
        """Return the place of a streak, about its middle to a fraction of a pixel."""
        sums, where = analysis.sums, analysis.placed().where
        sensors = self.prepared.binned_sensors
        centre = streak_centre(column_evidence(streak, sums), where, sensors, sums.pixel_mm)
        _, top, width, height = streak.box
        x = sums.left_mm + (centre + 0.5) * sums.pixel_mm + _shift_mm(analysis.registration)[0]
        return x - width / 2, top, width, height

    def _places(
        self,
        kind: str,
        places: list[tuple[str, Observed]],
        kinds: list[str],
        analysis: ScanAnalysis,
        measured: Callable[[Observed], dict[str, Any]] = lambda _: {},
    ) -> tuple[Region, ...]:
        """Return the places of statistics on the page; a wrong page is wrong as a whole."""
        page = self.prepared.page
        size_mm = page.width_mm, page.height_mm
        if kind == WRONG_PAGE_KIND:  # no place is more specific than another
            return (whole_page(size_mm, places[0][1], kind),) if places else ()
        shift_mm = _shift_mm(analysis.registration)
        return regions_of(places, kinds, shift_mm=shift_mm, size_mm=size_mm, measured=measured)


def _shift_mm(registration: Registration) -> tuple[float, float]:
    """Return by how much places on a scan are right of and below those on its page."""
    return registration.placement.shift_mm if registration.located else (0.0, 0.0)


def _ordered(
    strongest: list[tuple[str, Observed]], kind: str
) -> tuple[list[tuple[str, Observed]], list[str]]:
    """Return statistics with the kinds that they indicate, those of a kind first; unspecific ones are of it."""
    kinds = [kind if (one := kind_of(statistic.statistic)) == UNKNOWN else one for _, statistic in strongest]
    order = sorted(range(len(kinds)), key=lambda at: kinds[at] != kind)
    return [strongest[at] for at in order], [kinds[at] for at in order]
