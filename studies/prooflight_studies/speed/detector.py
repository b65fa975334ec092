"""Speed of the matched filter: preparation of a design, analysis of a scan, its statistics, and all together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.detectors.base import PlannedPage
from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.statistics.families import (
    remaining_statistics,
    screen_statistics,
)
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES
from prooflight.inspection.codes.finding import page_codes
from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.scans.placement import Placement
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.analysis import ScanAnalysis
    from prooflight.detectors.matched_filter.design import PreparedPage
    from prooflight.detectors.matched_filter.statistics.statistic import Observed
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

MOVED = Placement(shift_mm=(0.3, -0.2), skew_deg=0.05, stretch_percent=(0.02, -0.01))
"""Displacement of a page like those of prints of worlds.toml's press world."""


PASSES: Final = ("first look", "both looks")


def grown_works(
    pages: Mapping[str, tuple[Page, Press]], *, threads: int = 1
) -> dict[str, tuple[Callable[[], object], float]]:
    """Return the screening pass and both passes of pages on presses, by name; megapixels of all sensors together."""
    works: dict[str, tuple[Callable[[], object], float]] = {}
    for name, (page, press) in pages.items():
        scanned = _Scanned.of(page, press, threads=threads)
        size = len(press.sensors) * scanned.scan[0].size / 1e6
        works[f"matched filter, first look, {name}"] = scanned.at_first, size
        works[f"matched filter, both looks, {name}"] = scanned.at_both, size
    return works


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Scanned:
    """A prepared page with its scan."""

    design: PreparedPage
    scan: NDArray[np.uint16]
    threads: int

    @classmethod
    def of(cls, page: Page, press: Press, *, threads: int) -> _Scanned:
        sensors, geometry = press.sensors, press.geometry
        expected = predict(page, sensors=sensors, geometry=geometry, placement=MOVED)
        in_place = predict(page, sensors=sensors, geometry=geometry)
        design = prepare_page(page, in_place, sensors=sensors, geometry=geometry, fringes=True, glyphs=True)
        return cls(
            design=design, scan=ideal_scan(expected, press, stream(None, "bench-scan")), threads=threads
        )

    def at_first(self) -> tuple[ScanAnalysis, list[Observed]]:
        analysis = analyse(self.design, self.scan, analysed_modes=SCREEN_MODES, threads=self.threads)
        scatter = Scatter.white()
        return analysis, screen_statistics(
            analysis.sums, analysis.marks, analysis.fit, analysis.registration, scatter, threads=self.threads
        )

    def at_both(self) -> object:
        analysis, seen = self.at_first()
        whole = analysis.of_every_mode()
        return remaining_statistics(whole.sums, Scatter.white(), seen, threads=self.threads)


def detector_works(name: str, page: Page, press: Press) -> dict[str, tuple[Callable[[], object], float]]:
    """Return each step and its camera megapixels.

    "whole": from a scan to its statistics, of a prepared page or a fresh one. "First look": the screening pass, which
    every page gets; "both looks": with the full pass, which pages that are passed on get. Prediction includes planes'
    fringes, as a press does by default (``[inspection] fringes``), and glyphs are tested. A fresh design is also
    searched for codes, as ``Inspector.prepare`` does. The megapixels are those of one sensor, so that a second sensor's
    cost shows.
    """
    sensors, geometry = press.sensors, press.geometry
    expected = predict(page, sensors=sensors, geometry=geometry, placement=MOVED, threads=1)
    scan = ideal_scan(expected, press, stream(None, "bench-scan"))
    scatter = Scatter.white()

    def prepared() -> PreparedPage:
        planned = PlannedPage(page, press.press_context(1))
        page_codes(planned, sensors, geometry)
        return prepare_page(
            page, planned.expected, sensors=sensors, geometry=geometry, fringes=True, glyphs=True
        )

    def analysed(design: PreparedPage) -> ScanAnalysis:
        return analyse(design, scan, analysed_modes=SCREEN_MODES)

    def at_first(design: PreparedPage) -> ScanAnalysis:
        analysis = analysed(design)
        screen_statistics(analysis.sums, analysis.marks, analysis.fit, analysis.registration, scatter)
        return analysis

    def again(analysis: ScanAnalysis) -> object:
        return remaining_statistics(analysis.of_every_mode().sums, scatter, seen)

    own = prepared()
    once = analysed(own)
    seen = screen_statistics(once.sums, once.marks, once.fit, once.registration, scatter)
    size = scan[0].size / 1e6
    return {
        f"matched filter: whole, first look, {name}": (lambda: at_first(own), size),
        f"matched filter: whole, both looks, {name}": (lambda: again(at_first(own)), size),
        f"matched filter: whole, first look, fresh design, {name}": (lambda: at_first(prepared()), size),
        f"matched filter: prepare, {name}": (prepared, size),
        f"matched filter: registration, prediction and fit, {name}": (lambda: analysed(own), size),
        f"matched filter: second look, {name}": (lambda: again(once), size),
    }
