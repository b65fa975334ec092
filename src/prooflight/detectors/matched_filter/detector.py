"""The matched-filter detector: it removes the variation of good prints and decides by the residuals.

It also explains its decisions.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.base import (
    BLOCK_PIXELS,
    Area,
    ContextDetector,
    Device,
    Inspection,
    PlannedPage,
    PreparedPage,
    PressContext,
    StoredArrays,
    refuse_without_card,
)
from prooflight.detectors.matched_filter.amounts import FarAmounts
from prooflight.detectors.matched_filter.analysis import Engine, HostImages, ScanAnalysis, analyse
from prooflight.detectors.matched_filter.calibrated import CalibratedDetector, score_of, statistics_vector
from prooflight.detectors.matched_filter.design import PreparedPage as PreparedDesign
from prooflight.detectors.matched_filter.design import mode_sensors, prepare_page, with_arrays, without_arrays
from prooflight.detectors.matched_filter.exchangeability import PressRunTest, of_every_page, summaries
from prooflight.detectors.matched_filter.explaining import (
    PARTS,
    Evidence,
    Explainer,
    Judged,
    measured_inks,
)
from prooflight.detectors.matched_filter.glyphs.reporting import FAMILY, KINDS
from prooflight.detectors.matched_filter.glyphs.scoring import NONE, NOTHING
from prooflight.detectors.matched_filter.statistics.families import (
    all_statistics,
    remaining_statistics,
    screen_statistics,
)
from prooflight.detectors.matched_filter.statistics.local_evidence import LEAST_POWER, MODES
from prooflight.detectors.matched_filter.statistics.marks import NO_FLOOR
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES, Observed, values_of
from prooflight.detectors.matched_filter.variation import page_variation, print_state
from prooflight.detectors.matched_filter.visibility import on_tint, visible_marks
from prooflight.detectors.matched_filter.zones import MatchedFilterPricing, ZonedJudge, careful_statistics
from prooflight.detectors.placing import inside, shift_of, shows_another, unplaced_reason
from prooflight.detectors.verdict import Decision, Verdict
from prooflight.kernels.statistics.boxes import t_of_squares
from prooflight.pages.zones.zone import KINDS as ZONE_KINDS
from prooflight.pages.zones.zone import Kind, PageZones
from prooflight.prediction.predict import cut
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from prooflight.detectors.matched_filter.model import DetectorModel
    from prooflight.detectors.visible_marks import VisibleMarks
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.scan import Scan

STRONGEST: Final = 4
"""Number of families from which kind and place are taken."""
ROWS_AT_ONCE: Final = 64
UNPLACED: Final = "lines were lost, and the rest does not show the position of the page"
BLIND: Final = (
    "camera column {} responds differently from its calibration, on the backing too: calibrate the columns"
)


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
    """Model by which this page is judged."""
    widening: float
    """Factor by which the tolerances of this page are wider than others'."""
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
        return self.decide_and_explain(scan, decided=lambda _verdict: None)

    def decide_and_explain(self, scan: Scan, *, decided: Callable[[Verdict], None]) -> Inspection:
        """See ``DecidesFirst``; where zones decide as well, they need all statistics."""
        detector, prepared = self.detector, self.prepared_page
        evidence = self._evidence(scan)
        judged = self._judged(evidence)
        if judged.decision.misprint and self.judge is None:
            decided(self._verdict(scan, evidence, judged.decision, {"reason": PARTS}, None))
        evidence = self._completed(evidence)
        judged = self._judged(evidence)
        far: FarAmounts | None = None
        if judged.decision.misprint and not (evidence.another or self.model.residual_variance.exact):
            far = FarAmounts.of(prepared, evidence.analysis, detector.calibrated.model.residual_variance)
        explanation = self._explainer.explanation(evidence, judged, far)
        evidence = evidence.settled()
        analysis, registration = evidence.analysis, evidence.analysis.registration
        placement = registration.placement if registration.located else IN_PLACE
        area = inside(prepared.page, detector.press_context.geometry, placement, lines=scan.dn.shape[1])
        return Inspection(
            verdict=self._verdict(scan, evidence, judged.decision, explanation, far),
            placement=placement,
            area=area,
            measured_dn=scan.dn[:, *area],
            block_z=self._pictured(analysis, area),
            expect=lambda: cut(detector.press_context.predict(prepared.page, placement), area),
            stored_arrays=self._stored_arrays(evidence),
            state=partial(print_state, analysis, detector.press_context.sensors, far or dict),
            variation=partial(page_variation, prepared, analysis),
            summary=None
            if evidence.another
            else self._summary(evidence.values, evidence.score, judged.decision),
        )

    @property
    def _explainer(self) -> Explainer:
        return Explainer(
            prepared=self.prepared_page,
            inks=self.inks,
            model=self.model,
            calibrated=self.detector.calibrated,
            sensors=self.detector.press_context.sensors,
            zones=self.zones,
            judge=self.judge,
        )

    def _evidence(self, scan: Scan) -> Evidence:
        """Return what a scan shows, by the statistics of the model's screen; without a screen by all."""
        calibrated, screens = self.detector.calibrated, self._screens
        analysis = analyse(
            self.prepared_page,
            scan.dn,
            lost=scan.lost,
            residual_variance=calibrated.model.residual_variance,
            analysed_modes=SCREEN_MODES if screens else MODES,
            floor_share=self.detector.press_context.floor_share,
            engine=engine_of(self.detector.press_context.device),
            threads=self._threads,
        )
        given = analysis.sums, analysis.marks, analysis.fit, analysis.registration, calibrated.model.scatter
        if screens:
            return self._evidence_of(analysis, screen_statistics(*given, threads=self._threads))
        return self._evidence_of(analysis, all_statistics(*given))

    def _completed(self, evidence: Evidence) -> Evidence:
        """Return the evidence with all statistics, which explain a page that alarms by the screen, or is another."""
        calibrated, model = self.detector.calibrated, self.model
        if not self._screens or (evidence.score <= calibrated.threshold and not evidence.another):
            return evidence
        analysis = evidence.analysis.of_every_mode()
        every = remaining_statistics(
            analysis.sums,
            calibrated.model.scatter,
            evidence.statistics,
            order=model.statistics,
            threads=self._threads,
        )
        return self._evidence_of(analysis, every)

    def _evidence_of(self, analysis: ScanAnalysis, statistics: list[Observed]) -> Evidence:
        features, another = self.prepared_page.page_features, shows_another(analysis.registration)
        values = statistics_vector(self.model, statistics, features)
        return Evidence(
            analysis=analysis,
            statistics=statistics,
            score=score_of(self.model, values, features, another=another),
            strongest=self.model.strongest(statistics, features, most=STRONGEST),
            values=values,
            careful=self._careful(analysis),
            another=another,
            glyphs=NOTHING if another else analysis.glyphs,
            floor=NO_FLOOR if another else analysis.marks.floor,
        )

    @property
    def _screens(self) -> bool:
        """Whether some statistics decide alone, and all are computed only for a page that alarms."""
        return self.model.screen is not None and not self.detector.in_full

    @property
    def _threads(self) -> int:
        return self.detector.press_context.threads or os.cpu_count() or 1

    def _judged(self, evidence: Evidence) -> Judged:
        """Return the decision on a page, by the ranking of its statistics, its zones, its glyphs and the floor."""
        calibrated, others = self.detector.calibrated, (evidence.glyphs.score, evidence.floor.area_mm2)
        if self.judge is None:
            decision, of_ranking = calibrated.decide(evidence.score, *others), evidence.score
        else:
            in_zones = self.judge.decide(calibrated, evidence.score, values_of(evidence.careful))
            decision, of_ranking = calibrated.decided(in_zones, *others), in_zones.score
        return Judged(decision=decision, by_ranking=of_ranking > calibrated.threshold)

    def _verdict(
        self,
        scan: Scan,
        evidence: Evidence,
        decision: Decision,
        explanation: dict[str, Any],
        far: FarAmounts | None,
    ) -> Verdict:
        """Return the verdict of a decision, or that the page was not inspected and why."""
        analysis, registration = evidence.analysis, evidence.analysis.registration
        page, calibrated = self.prepared_page.page, self.detector.calibrated
        unknown_place = scan.lost is not None and not (evidence.another or registration.located)
        if analysis.blind_columns and not decision.misprint:
            columns = ", ".join(map(str, analysis.blind_columns))
            return Verdict.skipped(page.name, BLIND.format(columns), detector=calibrated.name)
        if decision.misprint and unknown_place:
            return Verdict.skipped(page.name, UNPLACED, detector=calibrated.name)
        if registration.unplaced:
            return Verdict.skipped(page.name, unplaced_reason(registration), detector=calibrated.name)
        of_glyphs = explanation.get("kind") in KINDS
        return Verdict.from_decision(
            page.name,
            decision,
            costs=self.detector.press_context.costs,
            shift_mm=shift_of(registration),
            detector=calibrated.name,
            family=FAMILY if of_glyphs else evidence.strongest[0][0] if evidence.strongest else None,
            inks=measured_inks(analysis, self.inks, far),
            widened=round(self.widening, 2),
            **explanation,
        )

    def _stored_arrays(self, evidence: Evidence) -> dict[str, NDArray[Any]]:
        """Return what ``decided_again`` needs."""
        careful: Mapping[str, NDArray[Any]] = {}
        if self.judge is not None:
            careful = self.judge.stored_arrays(values_of(evidence.careful))
        elif evidence.careful:
            careful = {"careful": values_of(evidence.careful)}
        return {
            **careful,
            "wrong_page": np.array(evidence.another),
            "values": evidence.values,
            "page_features": self.prepared_page.page_features,
            "widening": np.array(self.widening),
            "glyphs": np.array(evidence.glyphs.score),
            "floor_mm2": np.array(evidence.floor.area_mm2),
        }

    def _summary(
        self, values: NDArray[np.float32], score: float, decision: Decision
    ) -> NDArray[np.float64] | None:
        """Return what the run's test ranks the page by.

        With labelled pages it is only the score that their threshold is for.
        """
        if self.detector.calibrated.recalibrations:
            return np.array([decision.score]) if np.isfinite(decision.score) else None
        return summary_of(self.model, values, self.prepared_page.page_features, score=score)

    def _careful(self, analysis: ScanAnalysis) -> list[Observed]:
        """Return the statistics of the page's careful areas; empty: it has none."""
        if analysis.careful is None or self.zones is None or "careful" not in self.zones.kinds:
            return []
        return careful_statistics(analysis.sums, self.detector.calibrated.model.scatter, analysis.careful)

    def _pictured(self, analysis: ScanAnalysis, area: Area) -> NDArray[np.float32]:
        """Return by how much blocks are too light (above 0) or too dark, in good prints' deviations."""
        sums, light = analysis.sums, MODES.index("light")
        side = round(sums.tile_mm / self.detector.press_context.geometry.pixel_pitch_mm)
        rows, columns = middle_tiles(sums.tiles.shape[-2:], side, area, block=BLOCK_PIXELS)

        # A box of 1 mm is the tile in the middle of a block, and the one before it, each way.
        t = np.empty((rows.size, columns.size), np.float32)
        scatter = self.detector.calibrated.model.scatter.boxes[light, 0].astype(np.float32)
        of_light = (sums.tiles[part, light] for part in (0, 1, 3))
        t_of_squares(*of_light, rows, columns, scatter, np.float32(LEAST_POWER), t)
        return t[None]


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


def middle_tiles(
    tiles: tuple[int, ...], side: int, area: tuple[slice, slice], *, block: int
) -> list[NDArray[np.intp]]:
    """Return the rows and the columns of tiles, ``side`` pixels wide, in the middles of an area's blocks."""
    places = []
    for extent, count in zip(area, tiles, strict=True):
        middle = extent.start + block * (np.arange((extent.stop - extent.start) // block) + 0.5)
        places.append(np.minimum((middle / side).astype(np.intp), count - 1))
    return places


def engine_of(device: Device) -> Engine:
    """Return what computes the images of a scan; CUDA is loaded when a card is asked for."""
    if device == "cpu":
        return HostImages
    from prooflight.detectors.matched_filter.card.images import card_engine

    return card_engine()
