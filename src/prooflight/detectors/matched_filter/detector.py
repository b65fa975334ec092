"""The matched-filter detector on a press: what good prints do taken out of a scan, the rest decided on and
explained.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.base import BLOCK_PIXELS, Inspection, StationDetector
from prooflight.detectors.matched_filter.analysis import analyse, prepare_page
from prooflight.detectors.matched_filter.calibrated import looked_up, score_of
from prooflight.detectors.matched_filter.exchangeability import of_every_page, summaries
from prooflight.detectors.matched_filter.explaining import inks_found, reason_for, regions_of, whole_page
from prooflight.detectors.matched_filter.naming import UNKNOWN, kind_of, named
from prooflight.detectors.matched_filter.print_state import print_state
from prooflight.detectors.matched_filter.run_test import PressRunTest
from prooflight.detectors.matched_filter.statistics.families import all_statistics, screen_statistics
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, t_statistic
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES
from prooflight.detectors.matched_filter.variation import page_variation
from prooflight.detectors.placing import WRONG_PAGE_KIND, inside, shift_of, shows_another
from prooflight.detectors.verdict import Verdict
from prooflight.prediction.predict import cut
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.detectors.base import Area, KeptArrays, PlannedPage, Station
    from prooflight.detectors.matched_filter.analysis import PreparedPage, ScanAnalysis
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
    from prooflight.detectors.matched_filter.model import DetectorModel
    from prooflight.detectors.matched_filter.statistics.statistic import Observed
    from prooflight.detectors.verdict import Decision, Region
    from prooflight.pages.raster import Page
    from prooflight.scans.scan import Scan

PICTURED_TILES: Final = 2
"""Side of the boxes that pictures show, 1 mm. [tiles]"""
STRONGEST: Final = 4
"""Families that are asked for kind and place."""
ROWS_AT_ONCE: Final = 64
PARTS: Final = "parts of the page do not look as designed"


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchedFilterDetector(StationDetector):
    """Copes with presses that drift and jitter; trained on what this press's good prints do."""

    calibrated: CalibratedDetector
    in_full: bool = False
    """Whether every page is looked at for all statistics, so that it can be learned from; verdicts are the same."""

    @property
    def name(self) -> str:
        """See ``Detector``."""
        return self.calibrated.name

    @property
    def promise(self) -> str:
        """See ``Detector``."""
        return str(self.calibrated.promise)

    def prepare(self, planned: PlannedPage) -> MatchedFilterPage:
        """See ``Detector``."""
        station = planned.station
        known = prepare_page(
            planned.page,
            planned.expected,
            sensors=station.sensors,
            geometry=station.geometry,
            fringes=station.fringes,
            prior=self.calibrated.model.prior,
        )
        model = self.calibrated.model
        widening = 1.0 if model.residual_variance.exact else known.colours.widening
        return MatchedFilterPage(
            detector=self,
            known=known,
            inks=present_inks(planned.page),
            model=model.widened(widening),
            widening=widening,
        )

    def decided_again(self, kept: KeptArrays) -> Decision:
        """See ``Detector``."""
        model, another = self.calibrated.model, kept.wrong_page
        with np.errstate(all="ignore"):  # what comes of odd numbers is looked at by whoever asks
            values = kept.array("values", "fiu", (len(model.statistics),))
            page_features = kept.array("portrait", "f", model.centre.shape[1:], finite=True)
            model = model.widened(_widening_of(kept))
            return self.calibrated.decide(score_of(model, values, page_features, another=another))

    def run_test(self, *, seed: int) -> PressRunTest:
        """See ``ChecksRuns``."""
        return PressRunTest.of(self.calibrated, seed=seed)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MatchedFilterPage:
    """A page with its landmarks and the modes in which its print may go wrong."""

    detector: MatchedFilterDetector
    known: PreparedPage
    inks: str
    """Letters of CMYK that the page has."""
    model: DetectorModel
    """By which this page is judged ..."""
    widening: float
    """... so many times as widely as others."""

    def under(self, station: Station) -> MatchedFilterPage:
        """See ``PreparedPage``; next to no work."""
        return replace(self, detector=self.detector.at(station), known=self.known.under(station.sensors))

    def inspect(self, scan: Scan, *, seed: int = 0) -> Inspection:
        """See ``PreparedPage``."""
        station, ours, known = self.detector.station, self.detector.calibrated, self.known
        page, page_features = known.page, known.page_features
        analysis, statistics, decision = self._looked_at(scan)
        strongest = self.model.strongest(statistics, page_features, most=STRONGEST)
        values, another = self.model.laid_out(statistics), shows_another(analysis.found)
        told = self._explained(analysis, strongest, values) if decision.misprint else {}
        verdict = Verdict.from_decision(
            page.name,
            decision,
            costs=station.costs,
            shift_mm=shift_of(analysis.found),
            detector=ours.name,
            family=strongest[0][0] if strongest else None,
            inks=inks_found(analysis, self.inks),
            widened=round(self.widening, 2),
            **told,
        )
        placement = analysis.found.placement if analysis.found.found else IN_PLACE
        area = inside(page, station.geometry, placement, lines=scan.dn.shape[1])
        return Inspection(
            verdict=verdict,
            placement=placement,
            area=area,
            measured_dn=scan.dn[:, *area],
            block_z=self._pictured(analysis, area),
            expect=lambda: cut(station.predict(page, placement), area),
            kept={
                "wrong_page": np.array(another),
                "values": values,
                "portrait": page_features,
                "widening": np.array(self.widening),
            },
            state=partial(print_state, analysis, station.sensors),
            variation=partial(page_variation, known, analysis),
            summary=None if another else summary_of(self.model, values, page_features, score=decision.score),
        )

    def _looked_at(self, scan: Scan) -> tuple[ScanAnalysis, list[Observed], Decision]:
        """What a scan says, and the decision; for all statistics only where the first look is not enough to let a page
        pass, for it costs more than all the rest.
        """
        ours, model = self.detector.calibrated, self.model
        looks_first = model.screen is not None and not self.detector.in_full
        modes = SCREEN_MODES if looks_first else MODES
        analysis = analyse(
            self.known, scan.dn, residual_variance=ours.model.residual_variance, looked_at=modes
        )
        another = shows_another(analysis.found)

        def decided(look: Callable[..., list[Observed]]) -> tuple[list[Observed], Decision]:
            statistics = look(analysis.sums, analysis.fit, analysis.found, ours.model.scatter)
            values = looked_up(model, statistics, self.known.page_features)
            score = score_of(model, values, self.known.page_features, another=another)
            return statistics, ours.decide(score)

        if looks_first and not another:
            statistics, decision = decided(screen_statistics)
            if not np.isnan(decision.score) and not decision.misprint:
                return analysis, statistics, decision
        analysis = analysis.of_every_mode()
        return analysis, *decided(all_statistics)

    def _explained(
        self, analysis: ScanAnalysis, strongest: list[tuple[str, Observed]], values: NDArray[np.float32]
    ) -> dict[str, Any]:
        """Kind, places and reason of a misprint."""
        page, model = self.known.page, self.model
        another = shows_another(analysis.found)
        learned = model.kinds_of(values[None], self.known.page_features[None])[0]
        kind = WRONG_PAGE_KIND if another else learned or named(strongest)
        regions = _regions(strongest, kind, analysis, page)
        speaking = next(
            (statistic for _, statistic in strongest if kind_of(statistic.statistic) == kind), None
        )
        place = regions[0] if regions else None
        inks = inks_found(analysis, self.inks)
        only_parts = kind == WRONG_PAGE_KIND and not another
        reason = PARTS if only_parts else reason_for(kind, speaking, place, inks, analysis.found)
        return {"kind": kind, "regions": regions, "reason": reason}

    def _pictured(self, analysis: ScanAnalysis, area: Area) -> NDArray[np.float32]:
        """Where the print is lighter (above 0) or darker than it should be, in standard deviations of good prints."""
        sums, light = analysis.sums, MODES.index("light")
        push, power, edges = (
            cv2.blur(one, (PICTURED_TILES, PICTURED_TILES), borderType=cv2.BORDER_REPLICATE)
            * PICTURED_TILES**2
            for one in sums.tiles[[0, 1, 3], light]
        )
        t = t_statistic(push, power, edges, self.detector.calibrated.model.scatter.boxes[light, 0])
        side = round(sums.tile_mm / self.detector.station.geometry.pixel_pitch_mm)
        return block_means(t, side, area, block=BLOCK_PIXELS)[None]


def _regions(
    strongest: list[tuple[str, Observed]], kind: str, analysis: ScanAnalysis, page: Page
) -> tuple[Region, ...]:
    """Places, those of the verdict's kind first; a wrong page is wrong as a whole."""
    size_mm = page.width_mm, page.height_mm
    shift_mm = analysis.found.placement.shift_mm if analysis.found.found else (0.0, 0.0)
    if kind == WRONG_PAGE_KIND:  # no place says more than another
        return (whole_page(size_mm, strongest[0][1], kind),) if strongest else ()
    kinds = [kind if (one := kind_of(statistic.statistic)) == UNKNOWN else one for _, statistic in strongest]
    order = sorted(range(len(kinds)), key=lambda i: kinds[i] != kind)
    return regions_of(
        [strongest[i] for i in order], [kinds[i] for i in order], shift_mm=shift_mm, size_mm=size_mm
    )


def _widening_of(kept: KeptArrays) -> float:
    """Kept evidence of before there was any has none."""
    if "widening" not in kept.kept:
        return 1.0
    return max(float(kept.array("widening", "f", (), finite=True)), 1.0)


def summary_of(
    model: DetectorModel,
    values: NDArray[np.floating],
    page_features: NDArray[np.floating],
    *,
    score: float,
) -> NDArray[np.float64] | None:
    """One page's ``summaries``, from its statistics (n,) and their score; None: one of them is no finite number."""
    known = np.isfinite(values[of_every_page(model)]).all()
    if not (known and np.isfinite(page_features).all() and np.isfinite(score)):
        return None
    return summaries(model, model.deviations(values[None], page_features[None]), np.array([score]))[0]


def present_inks(page: Page) -> str:
    """Letters of CMYK that a page has."""
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
    """Values of a scan's tiles of side x side pixels (tile rows, tile columns), at the middles of an area's blocks."""
    places = []
    for extent, tiles in zip(area, values.shape, strict=True):
        count = (extent.stop - extent.start) // block
        middle = extent.start + block * (np.arange(count) + 0.5)
        places.append(np.minimum((middle / side).astype(np.intp), tiles - 1))
    return np.asarray(values[np.ix_(*places)], np.float32)
