"""Inspection of one page of a job by its scan of an office scanner."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from prooflight.errors import ScanError
from prooflight.inspection.job import InspectPage
from prooflight.inspection.scanner.finding import PlacedScan
from prooflight.inspection.scanner.placing import (
    LEAST_SEEN,
    channels_of,
    drawn_scan,
)
from prooflight.inspection.scanner.tone_fit import toned_lines
from prooflight.scans.scan import Scan
from prooflight.scans.scanner.reading import ScannerSettings

if TYPE_CHECKING:
    from prooflight.detectors.base import Inspection
    from prooflight.pages.raster import Page
    from prooflight.scans.recorded import RecordedScan

REMEDY = "scan the page again, flat and whole, or leave it to a person"


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectScannedPage(InspectPage):
    """``InspectPage`` for scans of an office scanner, each fitted to its page in place and tone."""

    settings: ScannerSettings = field(default_factory=ScannerSettings)

    def inspection(self, page: Page, scan: RecordedScan) -> Inspection:
        """Return the verdict on a page; ScanError: it could not be placed, or too little of it was scanned."""
        assert isinstance(scan, PlacedScan)
        if scan.trouble:
            raise ScanError(scan.scan.name, f"the page could not be placed: {scan.trouble}", remedy=REMEDY)
        press = self.inspector.press
        planned = self.inspector.planned(page)
        picture = channels_of(scan.scan.read(self.settings), len(press.sensors))
        drawn = drawn_scan(picture, page, scan.where, press)
        rows, columns = press.geometry.on_page(page.width_mm, page.height_mm)
        whole = float(drawn.seen[rows, columns].mean())
        if whole < LEAST_SEEN:
            what = f"only {whole:.0%} of the page was scanned"
            raise ScanError(scan.scan.name, what, remedy=REMEDY)
        lines, _ = toned_lines(drawn, planned.expected, press.sensors)
        prepared = self.inspector.prepare(planned)
        return self.inspector.inspect(prepared, Scan(dn=lines, name=scan.scan.name))
