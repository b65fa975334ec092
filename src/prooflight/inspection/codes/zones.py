"""Careful zones from the bar codes of a page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from prooflight.detectors.base import PlannedPage
from prooflight.inspection.codes.finding import QUIET_MM, page_codes
from prooflight.pages.zones.rules import entry_of

if TYPE_CHECKING:
    from prooflight.pages.job import Job
    from prooflight.pages.zones.zones_file import ZoneEntry
    from prooflight.press.artefact import Press


def code_zones(job: Job, number: int, press: Press) -> list[ZoneEntry]:
    """Return careful zones about all codes of page ``number`` that the press's camera reads, with their quiet zones.

    Errors as ``Job.page`` and ``ScanGeometry.lay``.
    """
    size_mm = job.page_size_mm(number)
    own = job.page(number)
    page = press.geometry.lay(own)
    entries = []
    for code in page_codes(PlannedPage(page, press.press_context()), press.sensors, press.geometry):
        x, y, width, height = code.box_mm
        if page is not own:  # back from a page that was turned as ``pages.raster.turned`` does
            x, y, width, height = y, own.height_mm - x - width, height, width
        box = x - QUIET_MM, y - QUIET_MM, width + 2 * QUIET_MM, height + 2 * QUIET_MM
        entry = entry_of(f"{code.symbol.symbology} {code.symbol.text}", "careful", box, number, size_mm)
        entries += [] if entry is None else [entry]
    return entries
