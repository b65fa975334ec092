"""How fast our detector is: what it prepares of a design, how it looks at a scan, what it says of it, and all of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.detectors.matched_filter.analysis import analyse, prepare_page
from prooflight.detectors.matched_filter.statistics.families import all_statistics
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
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

    "fringes": where planes share edges, prediction follows their fringes (``[inspection] fringes``). Of all
    sensors together one megapixel is counted, so that two sensors show what they cost.
    """
    sensors, geometry = press.sensors, press.geometry
    expected = predict(page, sensors=sensors, geometry=geometry, placement=MOVED, threads=1)
    scan = ideal_scan(expected, press, stream(None, "bench-scan"))
    scatter = Scatter.white()

    def prepared(*, fringes: bool = False) -> PreparedPage:
        in_place = predict(page, sensors=sensors, geometry=geometry, threads=1)
        return prepare_page(page, in_place, sensors=sensors, geometry=geometry, fringes=fringes)

    own, followed = prepared(), prepared(fringes=True)

    def seen(known: PreparedPage) -> ScanAnalysis:
        return analyse(known, scan)

    def statistics(analysis: ScanAnalysis) -> object:
        return all_statistics(analysis.sums, analysis.fit, analysis.found, scatter)

    analysis = seen(own)
    size = scan[0].size / 1e6
    return {
        f"our detector: whole, each predicted, {name}": (lambda: statistics(seen(own)), size),
        f"our detector: whole, fresh design, {name}": (lambda: statistics(seen(prepared())), size),
        f"our detector: whole, each predicted, fringes, {name}": (lambda: statistics(seen(followed)), size),
        f"our detector: prepare, {name}": (prepared, size),
        f"our detector: prepare, fringes, {name}": (lambda: prepared(fringes=True), size),
        f"our detector: look, {name}": (lambda: seen(own), size),
        f"our detector: statistics, {name}": (lambda: statistics(analysis), size),
    }
