"""The matched-filter detector on a press: what good prints do taken out of a scan, the rest weighed and explained."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.base import BLOCK_PIXELS, Inspection, PreparedOnly, StationDetector, expecting
from prooflight.detectors.matched_filter.analysis import look, prepare_page
from prooflight.detectors.matched_filter.calibrated import page_score, score_of
from prooflight.detectors.matched_filter.explaining import inks_found, reason_for, regions_of, whole_page
from prooflight.detectors.matched_filter.naming import UNKNOWN, kind_of, named
from prooflight.detectors.matched_filter.print_state import print_state
from prooflight.detectors.matched_filter.statistics.families import all_said
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, statistic
from prooflight.detectors.matched_filter.statistics.statistic import stated
from prooflight.detectors.placing import WRONG_PAGE_KIND, inside, shift_of, shows_another
from prooflight.detectors.verdict import Verdict
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import Area, KeptArrays, PlannedPage
    from prooflight.detectors.matched_filter.analysis import Looked, PreparedPage
    from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
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

    model: CalibratedDetector

    @property
    def name(self) -> str:
        """See ``Detector``."""
        return self.model.name

    @property
    def promise(self) -> str:
        """See ``Detector``."""
        return str(self.model.promise)

    def prepare(self, planned: PlannedPage) -> MatchedFilterPage:
        """See ``Detector``."""
        station = planned.station
        known = prepare_page(
            planned.page,
            planned.expected,
            sensors=station.sensors,
            geometry=station.geometry,
            fringes=station.fringes,
            tolerance=self.model.tolerance.prior,
        )
        return MatchedFilterPage(detector=self, known=known, inks=present_inks(planned.page))

    def decided_again(self, kept: KeptArrays) -> Decision:
        """See ``Detector``."""
        tolerance, another = self.model.tolerance, kept.wrong_page
        with np.errstate(all="ignore"):  # what comes of odd numbers is looked at by whoever asks
            values = kept.array("values", "fiu", (len(tolerance.statistics),))
            portrait = kept.array("portrait", "f", tolerance.centre.shape[1:], finite=True)
            return self.model.judge(score_of(tolerance, values, portrait, another=another))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MatchedFilterPage(PreparedOnly):
    """A page with its landmarks and the modes in which its print may go wrong."""

    detector: MatchedFilterDetector
    known: PreparedPage
    inks: str
    """Letters of CMYK that the page has."""

    def inspect(self, scan: Scan, *, seed: int = 0) -> Inspection:
        """See ``PreparedPage``."""
        station, ours, known = self.detector.station, self.detector.model, self.known
        page, portrait = known.page, known.portrait
        looked = look(
            known,
            scan.dn,
            sensors=station.sensors,
            geometry=station.geometry,
            tolerance=ours.tolerance.prior,
            spread=ours.tolerance.spread,
        )
        said = all_said(looked.sums, looked.fit, looked.found, ours.tolerance.scatter)
        decision = ours.judge(page_score(ours.tolerance, said, portrait, looked.found))
        strongest = ours.tolerance.strongest(said, portrait, most=STRONGEST)
        values, another = stated(said), shows_another(looked.found)
        told = self._explained(looked, strongest, values) if decision.misprint else {}
        verdict = Verdict.judged(
            page.name,
            decision,
            costs=station.costs,
            shift_mm=shift_of(looked.found),
            detector=ours.name,
            family=strongest[0][0] if strongest else None,
            inks=inks_found(looked, self.inks),
            **told,
        )
        placement = looked.found.placement if looked.found.found else IN_PLACE
        area = inside(page, station.geometry, placement, lines=scan.dn.shape[1])
        return Inspection(
            verdict=verdict,
            placement=placement,
            area=area,
            measured_dn=scan.dn[(slice(None), *area)],
            block_z=self._pictured(looked, area),
            expect=expecting(page, station, placement, area),
            kept={"wrong_page": np.array(another), "values": values, "portrait": portrait},
            state=partial(print_state, looked, station.sensors),
        )

    def _explained(
        self, looked: Looked, strongest: list[tuple[str, Observed]], values: NDArray[np.float32]
    ) -> dict[str, Any]:
        """Kind, places and reason of a misprint."""
        page, tolerance = self.known.page, self.detector.model.tolerance
        another = shows_another(looked.found)
        learned = tolerance.kinds_of(values[None], self.known.portrait[None])[0]
        kind = WRONG_PAGE_KIND if another else learned or _kind(strongest)
        regions = _regions(strongest, kind, looked, page)
        speaking = next((said for _, said in strongest if kind_of(said.statistic) == kind), None)
        place = regions[0] if regions else None
        inks = inks_found(looked, self.inks)
        only_parts = kind == WRONG_PAGE_KIND and not another
        reason = PARTS if only_parts else reason_for(kind, speaking, place, inks, looked.found)
        return {"kind": kind, "regions": regions, "reason": reason}

    def _pictured(self, looked: Looked, area: Area) -> NDArray[np.float32]:
        """Where the print is lighter (above 0) or darker than it should be, in standard deviations of good prints."""
        sums, light = looked.sums, MODES.index("light")
        push, power, edges = (
            cv2.blur(one, (PICTURED_TILES, PICTURED_TILES), borderType=cv2.BORDER_REPLICATE)
            * PICTURED_TILES**2
            for one in sums.tiles[[0, 1, 3], light]
        )
        t = statistic(push, power, edges, self.detector.model.tolerance.scatter.boxes[light, 0])
        side = round(sums.tile_mm / self.detector.station.geometry.pixel_pitch_mm)
        return block_means(t, side, area, block=BLOCK_PIXELS)[None]


def _kind(strongest: list[tuple[str, Observed]]) -> str:
    """What the evidence speaks of, where no misprint taught kinds.

    That tiles do not look as designed says least of what is wrong with them.
    """
    kind, _ = named(strongest)
    if kind != WRONG_PAGE_KIND:
        return kind
    others = (kind_of(said.statistic) for _, said in strongest)
    return next((other for other in others if other not in (WRONG_PAGE_KIND, UNKNOWN)), WRONG_PAGE_KIND)


def _regions(
    strongest: list[tuple[str, Observed]], kind: str, looked: Looked, page: Page
) -> tuple[Region, ...]:
    """Places, those of the verdict's kind first; a wrong page is wrong as a whole."""
    size_mm = page.width_mm, page.height_mm
    shift_mm = looked.found.placement.shift_mm if looked.found.found else (0.0, 0.0)
    if kind == WRONG_PAGE_KIND:  # no place says more than another
        return (whole_page(size_mm, strongest[0][1], kind),) if strongest else ()
    kinds = [kind if (one := kind_of(said.statistic)) == UNKNOWN else one for _, said in strongest]
    order = sorted(range(len(kinds)), key=lambda i: kinds[i] != kind)
    return regions_of(
        [strongest[i] for i in order], [kinds[i] for i in order], shift_mm=shift_mm, size_mm=size_mm
    )


def present_inks(page: Page) -> str:
    """Letters of CMYK that a page has."""
    words = np.ascontiguousarray(page.cmyk).view(np.uint32)
    any_of = np.uint32(0)
    for first in range(0, len(words), ROWS_AT_ONCE):
        any_of |= np.bitwise_or.reduce(words[first : first + ROWS_AT_ONCE], axis=None)
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
