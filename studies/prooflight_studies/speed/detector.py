"""How fast our detector is: what it prepares of a design, how it looks at a scan, what it says of it, and all of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.detectors.matched_filter.analysis import analyse, prepare_page
from prooflight.detectors.matched_filter.statistics.families import all_statistics, screen_statistics
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES
from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.scans.placement import Placement
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.detectors.matched_filter.analysis import PreparedPage, ScanAnalysis
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

MOVED = Placement(shift_mm=(0.3, -0.2), skew_deg=0.05, stretch_percent=(0.02, -0.01))
"""A page off its place as prints of worlds.toml's press world are."""


def detector_works(name: str, page: Page, press: Press) -> dict[str, tuple[Callable[[], object], float]]:
    """Each step and its camera megapixels; "whole": from a scan to its statistics, of a page prepared or a fresh one.

    "First look": what every page is looked at for; "both looks": what one takes that is passed on. Prediction follows
    planes' fringes, as a press does unless it is told otherwise (``[inspection] fringes``). Of all sensors together one
    megapixel is counted, so that two sensors show what they cost.
    """
    sensors, geometry = press.sensors, press.geometry
    expected = predict(page, sensors=sensors, geometry=geometry, placement=MOVED, threads=1)
    scan = ideal_scan(expected, press, stream(None, "bench-scan"))
    scatter = Scatter.white()

    def prepared() -> PreparedPage:
        in_place = predict(page, sensors=sensors, geometry=geometry, threads=1)
        return prepare_page(page, in_place, sensors=sensors, geometry=geometry, fringes=True)

    def analysed(known: PreparedPage) -> ScanAnalysis:
        return analyse(known, scan, looked_at=SCREEN_MODES)

    def at_first(known: PreparedPage) -> ScanAnalysis:
        analysis = analysed(known)
        screen_statistics(analysis.sums, analysis.fit, analysis.found, scatter)
        return analysis

    def again(analysis: ScanAnalysis) -> object:
        whole = analysis.of_every_mode()
        return all_statistics(whole.sums, whole.fit, whole.found, scatter)

    own = prepared()
    once = analysed(own)
    size = scan[0].size / 1e6
    return {
        f"our detector: whole, first look, {name}": (lambda: at_first(own), size),
        f"our detector: whole, both looks, {name}": (lambda: again(at_first(own)), size),
        f"our detector: whole, first look, fresh design, {name}": (lambda: at_first(prepared()), size),
        f"our detector: prepare, {name}": (prepared, size),
        f"our detector: registration, prediction and fit, {name}": (lambda: analysed(own), size),
        f"our detector: second look, {name}": (lambda: again(once), size),
    }
