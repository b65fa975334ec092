"""Inspection of a job with the pictures that a report needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.inspecting.inspector import not_inspected
from prooflight.pages.files import page_name
from prooflight.reporting.report import PageEntry, page_entry

if TYPE_CHECKING:
    from prooflight.inspecting.job import InspectPage, Pair


@dataclass(frozen=True, slots=True)
class PicturedPage:
    """``InspectPage`` that gives a report's entry rather than the bare verdict."""

    work: InspectPage

    def __call__(self, pair: Pair) -> PageEntry:
        """Inspect and picture one page; a page without scan is pictured as not inspected."""
        number, scan = pair
        page = self.work.page(number)
        if scan is None:
            return page_entry(page, not_inspected(page_name(number)), self.work.inspector.press)
        return page_entry(page, self.work.inspection(number, scan), self.work.inspector.press)
