"""The matched-filter detector: it removes the variation of good prints and decides by the residuals.

It also explains its decisions.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, replace
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final, Self

import cv2
import numpy as np

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.base import BLOCK_PIXELS, ContextDetector, Inspection, StoredArrays
from prooflight.detectors.devices import refuse_without_card
from prooflight.detectors.matched_filter.amounts import amount_in
from prooflight.detectors.matched_filter.analysis import (
    analyse,
    mode_sensors,
    prepare_page,
    with_arrays,
    without_arrays,
)
from prooflight.detectors.matched_filter.calibrated import score_of, statistics_vector
from prooflight.detectors.matched_filter.exchangeability import PressRunTest, of_every_page, summaries
from prooflight.detectors.matched_filter.explaining import (
    distinct_inks,
    floor_explanation,
    measured_inks,
    reason_for,
    regions_of,
    whole_page,
)
from prooflight.detectors.matched_filter.extents import MODES_OF_EXTENT, column_evidence, extended
from prooflight.detectors.matched_filter.far_amounts import FarAmounts
from prooflight.detectors.matched_filter.glyphs.reporting import FAMILY, KINDS, glyph_explanation, glyphs_name
from prooflight.detectors.matched_filter.glyphs.scoring import NONE, NOTHING
from prooflight.detectors.matched_filter.naming import UNKNOWN, kind_of, named, supported
from prooflight.detectors.matched_filter.scan_images import HostImages
from prooflight.detectors.matched_filter.statistics.families import (
    all_statistics,
    remaining_statistics,
    screen_statistics,
)
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, t_statistic
from prooflight.detectors.matched_filter.statistics.marks import NO_FLOOR
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES, values_of
from prooflight.detectors.matched_filter.streak_place import streak_centre
from prooflight.detectors.matched_filter.variation import page_variation, print_state
from prooflight.detectors.matched_filter.visibility import on_tint, visible_marks
from prooflight.detectors.matched_filter.zones import MatchedFilterPricing, ZonedJudge, careful_statistics
from prooflight.detectors.placing import WRONG_PAGE_KIND, inside, shift_of, shows_another, unplaced_reason
from prooflight.detectors.verdict import Verdict
from prooflight.pages.zones.zone import KINDS as ZONE_KINDS
from prooflight.prediction.predict import cut
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.base import Area, Device, PlannedPage, PreparedPage, PressContext
    from prooflight.detectors.matched_filter.analysis import PreparedPage as PreparedDesign
    from prooflight.detectors.matched_filter.analysis import ScanAnalysis
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.extents import Extent
    from prooflight.detectors.matched_filter.model import DetectorModel
    from prooflight.detectors.matched_filter.scan_images import Engine
    from prooflight.detectors.matched_filter.statistics.statistic import Box, Observed
    from prooflight.detectors.verdict import Decision, Ink, Region
    from prooflight.detectors.visible_marks import VisibleMarks
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zone import Kind, PageZones
    from prooflight.prediction.tables import SensorModel
    from prooflight.registration.register import Registration
    from prooflight.scans.scan import Scan

PICTURED_TILES: Final = 2
"""Side of the boxes that pictures show, 1 mm. [tiles]"""
STRONGEST: Final = 4
"""Number of families from which kind and place are taken."""
ROWS_AT_ONCE: Final = 64
UNPLACED: Final = "lines were lost, and the rest does not tell where the page lies"
BLIND: Final = (
    "camera column {} answers otherwise than it was calibrated, on the backing too: calibrate the columns"
)
PARTS: Final = "parts of the page do not look as designed"


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchedFilterDetector(ContextDetector):
    """Detector for presses that drift and jitter, trained on the variation of this press's good prints."""

    calibrated: CalibratedDetector
    in_full: bool = False
    """Whether all statistics of every page are computed, so that it can be learned from; verdicts are the
    same."""

    @property
    def name(self) -> str:
        """See ``Detector``."""
        return self.calibrated.name

    @property
    def guarantee(self) -> str:
        """See ``Detector``."""
        return str(self.calibrated.guarantee)

    @property
    def false_alarm_rate(self) -> float:
        """See ``Detector``."""
        return self.calibrated.guarantee.rate

    @property
    def zone_kinds(self) -> frozenset[Kind]:
        """See ``Detector``."""
        return frozenset(ZONE_KINDS)

    @property
    def zone_pricing(self) -> MatchedFilterPricing:
        """See ``PricesZones``."""
        return MatchedFilterPricing(calibrated=self.calibrated)

    def at(self, press_context: PressContext) -> Self:
        """See ``Detector``; RequestError: there is no graphics card."""
        if press_context.device == "gpu":
            refuse_without_card()
        return replace(self, press_context=press_context)

    def for_learning(self) -> Self:
        """See ``LearnsPages``."""
        return replace(self, in_full=True)

    def visible_marks(self, planned: PlannedPage) -> VisibleMarks:
        """See ``ShowsVisibleMarks``."""
        page = self.prepare(planned)
        return visible_marks(page.prepared_page, page.model, self.calibrated.threshold, self.press_context)

    def visible_on_tint(self, black: float) -> tuple[float, float]:
        """See ``ShowsVisibleMarks``."""
        return on_tint(self.calibrated, self.press_context, black)

    def stored(self, page: PreparedPage) -> tuple[Any, Mapping[str, Sequence[SensorModel]]]:
        """See ``StoresPages``: without what the press holds."""
        assert isinstance(page, MatchedFilterPage)
        shared = {"camera": page.prepared_page.landmarks.sensors, "binned": page.prepared_page.binned_sensors}
        return (page.prepared_page, page.inks, page.widening), shared

    def shared_sensors(self) -> Mapping[str, Sequence[SensorModel]]:
        """See ``StoresPages``."""
        sensors = self.press_context.sensors
        return {"camera": sensors, "binned": mode_sensors(sensors, self.press_context.geometry)}

    def restored(self, stored: Any) -> MatchedFilterPage:
        """See ``StoresPages``."""
        design, inks, widening = stored
        model = self.calibrated.model.widened(widening)
        return MatchedFilterPage(
            detector=self, prepared_page=design, inks=inks, model=model, widening=widening
        )

    def prepare(self, planned: PlannedPage) -> MatchedFilterPage:
        """See ``Detector``."""
        press_context = planned.press_context
        prepared = prepare_page(
            planned.page,
            planned.expected,
            sensors=press_context.sensors,
            geometry=press_context.geometry,
            fringes=press_context.fringes,
            prior=self.calibrated.model.prior,
            zones=planned.zones,
            glyphs=self.in_full or self.calibrated.glyphs is not None,
            screen=press_context.screen,
            own_light=press_context.own_light,
        )
        model = self.calibrated.model
        widening = 1.0 if model.residual_variance.exact else prepared.colours.widening
        return MatchedFilterPage(
            detector=self,
            prepared_page=prepared,
            inks=present_inks(planned.page),
            model=model.widened(widening),
            widening=widening,
            zones=planned.zones,
            judge=None if planned.zones is None else ZonedJudge.of(planned.zones),
        )

    def decided_again(self, stored: StoredArrays) -> Decision:
        """See ``Detector``."""
        with np.errstate(all="ignore"):  # the caller checks results that are not finite
            score = self.calibrated.score_again(stored)
            glyphs = float(stored.array("glyphs", "f", ())) if "glyphs" in stored.stored_arrays else NONE
            floor_mm2 = (
                float(stored.array("floor_mm2", "f", ())) if "floor_mm2" in stored.stored_arrays else 0.0
            )
            zoned = ZonedJudge.from_stored(stored)
            if zoned is None:
                return self.calibrated.decide(score, glyphs, floor_mm2)
            judge, careful = zoned
            zoned_decision = judge.decide(self.calibrated, score, careful)
            return self.calibrated.decided(zoned_decision, glyphs, floor_mm2)

    def run_test(self, *, seed: int) -> PressRunTest:
        """See ``ChecksRuns``."""
        return PressRunTest.of(self.calibrated, seed=seed)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MatchedFilterPage:
    """A page with its landmarks and the modes in which its print may go wrong."""

    detector: MatchedFilterDetector
    prepared_page: PreparedDesign
    inks: str
    """Letters of CMYK that the page has."""
    model: DetectorModel
    """Model by which this page is judged ..."""
    widening: float
    """... with tolerances that are wider than others' by this factor."""
    zones: PageZones | None = None
    judge: ZonedJudge | None = None
    """Decision rule for pages with zones; None: the page has none, or they are not calibrated."""

    def under(self, press_context: PressContext) -> MatchedFilterPage:
        """See ``PreparedPage``; cheap."""
        return replace(
            self,
            detector=self.detector.at(press_context),
            prepared_page=self.prepared_page.under(press_context.sensors),
        )

    @property
    def leaves_lost_lines_out(self) -> bool:
        """See ``LeavesLostLinesOut``."""
        return True

    @property
    def of_press(self) -> object:
        """See ``PacksArrays``."""
        return self.detector, self.prepared_page.binned_sensors

    def without_arrays(self) -> tuple[MatchedFilterPage, dict[str, NDArray[Any]]]:
        """See ``PacksArrays``; a graphics card keeps the images of its designs, and they are not packed."""
        if self.detector.press_context.device != "cpu":
            return self, {}
        bare, arrays = without_arrays(self.prepared_page)
        return replace(self, prepared_page=bare), arrays

    def with_arrays(self, page: Page, arrays: Mapping[str, NDArray[Any]]) -> MatchedFilterPage:
        """See ``PacksArrays``."""
        return replace(self, prepared_page=with_arrays(self.prepared_page, page, arrays))

    def inspect(self, scan: Scan, *, seed: int = 0) -> Inspection:
        """See ``PreparedPage``."""
        press_context, calibrated, prepared = (
            self.detector.press_context,
            self.detector.calibrated,
            self.prepared_page,
        )
        page, page_features = prepared.page, prepared.page_features
        analysis, statistics, score = self._analysed(scan)
        strongest = self.model.strongest(statistics, page_features, most=STRONGEST)
        values, another = self.model.vector_of(statistics), shows_another(analysis.registration)
        glyphs = NOTHING if another else analysis.glyphs
        floor = NO_FLOOR if another else analysis.marks.floor
        stored: dict[str, NDArray[Any]] = {}
        careful = self._careful(analysis)
        if self.judge is not None:
            stored |= self.judge.stored_arrays(values_of(careful))
            in_zones = self.judge.decide(calibrated, score, values_of(careful))
            decision, by_ranking = (
                calibrated.decided(in_zones, glyphs.score, floor.area_mm2),
                in_zones.score > calibrated.threshold,
            )
        else:
            stored |= {"careful": values_of(careful)} if careful else {}
            decision, by_ranking = (
                calibrated.decide(score, glyphs.score, floor.area_mm2),
                score > calibrated.threshold,
            )
        explanation = self._explained(analysis, strongest, values, careful) if by_ranking else {}
        placed, block_sums, analysis = analysis.placed, analysis.block_sums, analysis.settled()
        far: Callable[[], Mapping[str, float]] = dict
        if decision.misprint and not (another or self.model.residual_variance.exact):
            variance = calibrated.model.residual_variance
            far = FarAmounts.of(prepared, analysis, placed(), block_sums(), variance)
        if floor.alarms and not explanation:
            explanation = floor_explanation(floor, analysis.registration)
        wrong = calibrated.wrong_glyphs(glyphs) if decision.misprint else ()
        if wrong and prepared.glyphs is not None:
            others, kind = explanation.get("regions", ()), explanation.get("kind", "")
            # The evidence itself decides, not the extent of the defect that it is taken for.
            evidence = self._places(kind, *_ordered(strongest, kind), analysis) if by_ranking else others
            if not explanation or glyphs_name(prepared.glyphs, wrong, evidence, kind=kind):
                explanation = glyph_explanation(prepared.glyphs, wrong, others)
        verdict = Verdict.from_decision(
            page.name,
            decision,
            costs=press_context.costs,
            shift_mm=shift_of(analysis.registration),
            detector=calibrated.name,
            family=FAMILY if explanation.get("kind") in KINDS else strongest[0][0] if strongest else None,
            inks=measured_inks(analysis, self.inks),
            widened=round(self.widening, 2),
            **explanation,
        )
        if decision.misprint and scan.lost is not None and not (another or analysis.registration.located):
            verdict = Verdict.skipped(page.name, UNPLACED, detector=calibrated.name)
        elif analysis.registration.unplaced:
            verdict = Verdict.skipped(
                page.name, unplaced_reason(analysis.registration), detector=calibrated.name
            )
        if analysis.blind_columns and not decision.misprint:
            numbers = ", ".join(map(str, analysis.blind_columns))
            verdict = Verdict.skipped(page.name, BLIND.format(numbers), detector=calibrated.name)
        placement = analysis.registration.placement if analysis.registration.located else IN_PLACE
        area = inside(page, press_context.geometry, placement, lines=scan.dn.shape[1])
        return Inspection(
            verdict=verdict,
            placement=placement,
            area=area,
            measured_dn=scan.dn[:, *area],
            block_z=self._pictured(analysis, area),
            expect=lambda: cut(press_context.predict(page, placement), area),
            stored_arrays=stored
            | {
                "wrong_page": np.array(another),
                "values": values,
                "page_features": page_features,
                "widening": np.array(self.widening),
                "glyphs": np.array(glyphs.score),
                "floor_mm2": np.array(floor.area_mm2),
            },
            state=partial(print_state, analysis, press_context.sensors, far),
            variation=partial(page_variation, prepared, analysis),
            summary=None if another else self._summary(values, score, decision),
        )

    def _summary(
        self, values: NDArray[np.float32], score: float, decision: Decision
    ) -> NDArray[np.float64] | None:
        """Return what the run's test ranks the page by.

        With labelled pages it is only the score that their threshold is for.
        """
        if self.detector.calibrated.told:
            return np.array([decision.score]) if np.isfinite(decision.score) else None
        return summary_of(self.model, values, self.prepared_page.page_features, score=score)

    def _analysed(self, scan: Scan) -> tuple[ScanAnalysis, list[Observed], float]:
        """Return the analysis of a scan, its statistics and its score.

        All statistics are computed only for a page that alarms.
        """
        calibrated, model = self.detector.calibrated, self.model
        threads = self.detector.press_context.threads or os.cpu_count() or 1
        screens = model.screen is not None and not self.detector.in_full
        modes = SCREEN_MODES if screens else MODES
        analysis = analyse(
            self.prepared_page,
            scan.dn,
            lost=scan.lost,
            residual_variance=calibrated.model.residual_variance,
            analysed_modes=modes,
            floor_share=self.detector.press_context.floor_share,
            engine=engine_of(self.detector.press_context.device),
            threads=threads,
        )
        another, scatter = shows_another(analysis.registration), calibrated.model.scatter

        def scored(statistics: list[Observed]) -> tuple[list[Observed], float]:
            values = statistics_vector(model, statistics, self.prepared_page.page_features)
            return statistics, score_of(model, values, self.prepared_page.page_features, another=another)

        seen: list[Observed] = []
        if screens and not another:
            seen = screen_statistics(
                analysis.sums, analysis.marks, analysis.fit, analysis.registration, scatter, threads=threads
            )
            statistics, score = scored(seen)
            if score <= calibrated.threshold:
                return analysis, statistics, score
        analysis = analysis.of_every_mode()
        if not seen:
            return analysis, *scored(
                all_statistics(analysis.sums, analysis.marks, analysis.fit, analysis.registration, scatter)
            )
        every = remaining_statistics(analysis.sums, scatter, seen, order=model.statistics, threads=threads)
        return analysis, *scored(every)

    def _careful(self, analysis: ScanAnalysis) -> list[Observed]:
        """Return the statistics of the page's careful areas; empty: it has none."""
        if analysis.careful is None or self.zones is None or "careful" not in self.zones.kinds:
            return []
        return careful_statistics(analysis.sums, self.detector.calibrated.model.scatter, analysis.careful)

    def _explained(
        self,
        analysis: ScanAnalysis,
        strongest: list[tuple[str, Observed]],
        values: NDArray[np.float32],
        careful: list[Observed],
    ) -> dict[str, Any]:
        """Return kind, places and reason of a misprint."""
        model, another = self.model, shows_another(analysis.registration)
        alarmed = self.judge is not None and self.judge.careful_alarms(
            self.detector.calibrated, values_of(careful)
        )
        if self.judge is not None and alarmed and not another:
            return self._careful_explanation(analysis, self.judge.greatest(careful))
        learned = model.kinds_of(values[None], self.prepared_page.page_features[None])[0]
        kind = WRONG_PAGE_KIND if another else supported(learned or named(strongest), analysis.registration)
        inks = measured_inks(analysis, self.inks)
        regions = self._regions(strongest, kind, analysis, inks)
        speaking = next(
            (statistic for _, statistic in strongest if kind_of(statistic.statistic) == kind), None
        )
        place = regions[0] if regions else None
        only_parts = kind == WRONG_PAGE_KIND and not another
        distinct = distinct_inks(self.detector.press_context.sensors)
        reason = reason_for(kind, speaking, place, inks, analysis.registration, distinct=distinct)
        reason = PARTS if only_parts else reason
        return {"kind": kind, "regions": regions, "reason": reason}

    def _careful_explanation(self, analysis: ScanAnalysis, greatest: Observed) -> dict[str, Any]:
        """Return kind, places and reason of a misprint in a careful area.

        greatest: the area's greatest statistic, with its deviation.
        """
        kind, strongest = kind_of(greatest.statistic), [(greatest.statistic.cause, greatest)]
        inks = measured_inks(analysis, self.inks)
        regions = self._regions(strongest, kind, analysis, inks, careful=True)
        place = regions[0] if regions else None
        distinct = distinct_inks(self.detector.press_context.sensors)
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
    ) -> tuple[Region, ...]:
        """Return places, those of the verdict's kind first; a wrong page is wrong as a whole.

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
        distinct = distinct_inks(self.detector.press_context.sensors)

        def measured(statistic: Observed) -> dict[str, Any]:
            placed = analysis.placed()
            shape = placed.where.inside.shape
            rows, columns = sums.cells_of(statistic.box, shape, (sums.pixel_mm, sums.pixel_mm))
            added = self.prepared_page.added
            amount = amount_in(kind, rows, columns, placed, added, fit, distinct=distinct, inks=inks)
            features = self.prepared_page.page_features
            above_good_sd = None if careful else self.model.above_good(statistic, features)
            return asdict(amount) | {"above_good_sd": above_good_sd}

        return self._places(kind, places, kinds, analysis, measured)

    def _streak_box(self, analysis: ScanAnalysis, streak: Extent) -> Box:
        """Return the place of a streak, about its middle to a fraction of a pixel."""
        sums, where = analysis.sums, analysis.placed().where
        sensors = self.prepared_page.binned_sensors
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
        page = self.prepared_page.page
        size_mm = page.width_mm, page.height_mm
        if kind == WRONG_PAGE_KIND:  # no place is more specific than another
            return (whole_page(size_mm, places[0][1], kind),) if places else ()
        shift_mm = _shift_mm(analysis.registration)
        return regions_of(places, kinds, shift_mm=shift_mm, size_mm=size_mm, measured=measured)

    def _pictured(self, analysis: ScanAnalysis, area: Area) -> NDArray[np.float32]:
        """Return by how much blocks are too light (above 0) or too dark, in good prints' deviations."""
        sums, light = analysis.sums, MODES.index("light")
        push, power, edges = (
            cv2.blur(one, (PICTURED_TILES, PICTURED_TILES), borderType=cv2.BORDER_REPLICATE)
            * PICTURED_TILES**2
            for one in sums.tiles[[0, 1, 3], light]
        )
        t = t_statistic(push, power, edges, self.detector.calibrated.model.scatter.boxes[light, 0])
        side = round(sums.tile_mm / self.detector.press_context.geometry.pixel_pitch_mm)
        return block_means(t, side, area, block=BLOCK_PIXELS)[None]


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


def summary_of(
    model: DetectorModel,
    values: NDArray[np.floating],
    page_features: NDArray[np.floating],
    *,
    score: float,
) -> NDArray[np.float64] | None:
    """Return one page's ``summaries``, from its statistics (n,) and their score.

    It is None if one of them is not finite.
    """
    finite = np.isfinite(values[of_every_page(model)]).all()
    if not (finite and np.isfinite(page_features).all() and np.isfinite(score)):
        return None
    return summaries(model, model.deviations(values[None], page_features[None]), np.array([score]))[0]


def present_inks(page: Page) -> str:
    """Return the letters of CMYK that a page has."""
    packed = np.ascontiguousarray(page.cmyk).view(np.uint32)
    any_of = np.uint32(0)
    for first in range(0, len(packed), ROWS_AT_ONCE):
        any_of |= np.bitwise_or.reduce(packed[first : first + ROWS_AT_ONCE], axis=None)
        inks = np.array([any_of]).view(np.uint8)
        if inks.all():
            break
    return "".join(letter for letter, ink in zip(INK_LETTERS, inks, strict=True) if ink)


def block_means(
    values: NDArray[np.floating], side: int, area: tuple[slice, slice], *, block: int
) -> NDArray[np.float32]:
    """Sample tiles (tile rows, tile columns), ``side`` pixels wide, at the middles of an area's blocks."""
    places = []
    for extent, tiles in zip(area, values.shape, strict=True):
        count = (extent.stop - extent.start) // block
        middle = extent.start + block * (np.arange(count) + 0.5)
        places.append(np.minimum((middle / side).astype(np.intp), tiles - 1))
    return np.asarray(values[np.ix_(*places)], np.float32)


def engine_of(device: Device) -> Engine:
    """Return what computes the images of a scan; CUDA is loaded when a card is asked for."""
    if device == "cpu":
        return HostImages
    from prooflight.detectors.matched_filter.card_images import card_engine

    return card_engine()
