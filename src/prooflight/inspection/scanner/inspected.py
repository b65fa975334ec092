"""Inspection of one page of a job by its scan of an office scanner."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.base import Inspection, PlannedPage
from prooflight.detectors.golden.chain import DrawnDetector, bare_light, light_of, to_numbers
from prooflight.detectors.golden.differences import place_of
from prooflight.errors import ScanError
from prooflight.inspection.inspector import raster_of
from prooflight.inspection.job import InspectPage, Pair
from prooflight.inspection.scanner.finding import PlacedScan
from prooflight.inspection.scanner.fits import MOST_SHEETS, SheetEdges, chains_of, sheet_edges, toned_lines
from prooflight.inspection.scanner.placing import (
    LEAST_SEEN,
    channels_of,
    drawn_scan,
)
from prooflight.pages.job import JobSource, opened
from prooflight.scans.scan import Scan
from prooflight.scans.scanner.reading import ScannerSettings

if TYPE_CHECKING:
    from prooflight.inspection.inspector import Prepared
    from prooflight.pages.raster import Page
    from prooflight.pages.zones.zones_file import JobZones
    from prooflight.press.artefact import Press
    from prooflight.scans.recorded import RecordedScan

REMEDY: Final = "scan the page again, flat and whole, or have a person check it"


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectScannedPage(InspectPage):
    """``InspectPage`` for scans of an office scanner, each fitted to its page in place and tone."""

    settings: ScannerSettings = field(default_factory=ScannerSettings)

    def inspection(self, design: Page | Prepared, scan: RecordedScan) -> Inspection:
        """Return the verdict on a page; ScanError: it could not be placed, or too little of it was scanned."""
        assert isinstance(scan, PlacedScan)
        drawn_way = isinstance(self.inspector.detector, DrawnDetector)
        _refuse_unplaced(scan, roughly=drawn_way)
        planned = self.inspector.planned(raster_of(design))
        lines, _ = scan_on_page(scan, planned, self.inspector.press, self.settings, by_type=not drawn_way)
        prepared = self.inspector.prepare(planned)
        return self.inspector.inspect(prepared, Scan(dn=lines, name=scan.scan.name))


def scan_on_page(
    scan: PlacedScan, planned: PlannedPage, press: Press, settings: ScannerSettings, *, by_type: bool
) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
    """Return a scan as lines of the press (sensors, lines, pixels) [DN], and where it shows the page (lines, pixels).

    by_type: see ``fitted_tone``. ScanError: too little of the page was scanned.
    """
    page = planned.page
    picture = channels_of(scan.scan.read(settings), len(press.sensors))
    drawn = drawn_scan(picture, page, scan.where, press)
    rows, columns = press.geometry.on_page(page.width_mm, page.height_mm)
    whole = float(drawn.seen[rows, columns].mean())
    if whole < LEAST_SEEN:
        what = f"only {whole:.0%} of the page was scanned"
        raise ScanError(scan.scan.name, what, remedy=REMEDY)
    lines, _ = toned_lines(drawn, planned.expected, press.sensors, by_type=by_type)
    return lines, drawn.seen


def finely_placed(
    scan: PlacedScan, planned: PlannedPage, press: Press, settings: ScannerSettings
) -> PlacedScan:
    """Return a scan placed anew by all edges of its page, as a golden scan is; as it was if that does not find it.

    A sparse page has too few landmarks for more than a rough place. ScanError: too little of the page was scanned.
    """
    lines, seen = scan_on_page(scan, planned, press, settings, by_type=False)
    usual = to_numbers(np.clip(bare_light(planned.expected, press.sensors), 0, 1))
    judged = seen & ~ignored_on(planned, press, len(seen))
    where = place_of(usual, np.where(judged, to_numbers(light_of(lines, press.sensors)), usual))
    if not where.located or where.bent:
        return scan
    slopes, tile = where.slopes, where.tile_pixels
    middle = [
        count * tile / 2 - extent / 2
        for count, extent in zip(where.nodes.shape[:0:-1], seen.shape[::-1], strict=True)
    ]
    shift = (np.array(where.shift_pixels) - slopes @ middle) * press.geometry.pixel_pitch_mm
    further = np.eye(3)
    further[:2, :2] += slopes
    further[:2, 2] = shift
    return replace(scan, where=replace(scan.where, matrix=scan.where.matrix @ further))


def ignored_on(planned: PlannedPage, press: Press, lines: int) -> NDArray[np.bool_]:
    """Return which pixels of a page's scan lie in ignored zones, (lines, pixels)."""
    at = press.geometry.centres_x_mm(planned.page.width_mm), press.geometry.centres_y_mm(lines)
    if planned.zones is None:
        return np.zeros((at[1].size, at[0].size), np.bool_)
    return planned.zones.holds("ignore", *at)


def drawn_detector(
    pairs: Sequence[Pair],
    job: JobSource,
    press: Press,
    settings: ScannerSettings,
    *,
    zones: JobZones | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> tuple[DrawnDetector, list[Pair]]:
    """Return a detector that compares with the pages as this printer and scanner show them, by their own sheets.

    The pairs come back with their scans placed finely.

    Each sheet is judged by the chain of the others where there are enough. A page that has no
    chain is refused when it is prepared.
    """
    edges: dict[str, SheetEdges] = {}
    raster_mm, press_context, placed = 0.0, press.press_context(), list(pairs)
    for at, (number, scan) in enumerate(pairs):
        if not isinstance(scan, PlacedScan) or scan.nowhere:
            continue
        progress(f"measuring how the scanner reproduces print, from {scan.scan.name}")
        page = press.geometry.lay(opened(job).page(number))
        planned = PlannedPage(page, press_context, None if zones is None else zones.page(page))
        try:
            fine = finely_placed(scan, planned, press, settings)
            placed[at] = number, fine
            if len(edges) >= MOST_SHEETS:
                continue
            lines, seen = scan_on_page(fine, planned, press, settings, by_type=False)
        except ScanError:  # its own inspection says so
            continue
        judged = seen & ~ignored_on(planned, press, len(seen))
        of_sheet = sheet_edges(page, press_context, light_of(lines, press.sensors), judged)
        if of_sheet is not None:
            edges[page.name], raster_mm = of_sheet, page.pixel_mm
    return DrawnDetector(press_context=press_context, chains=chains_of(edges, raster_mm)), placed


def _refuse_unplaced(scan: PlacedScan, *, roughly: bool) -> None:
    """Raise ScanError if a scan lies nowhere; roughly: or only roughly."""
    if scan.nowhere if roughly else scan.trouble:
        raise ScanError(scan.scan.name, f"the page could not be placed: {scan.trouble}", remedy=REMEDY)
