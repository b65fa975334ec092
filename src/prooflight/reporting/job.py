"""Inspection of a job with the pictures that a report needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from prooflight.errors import ProoflightError
from prooflight.inspection.inspector import not_inspected
from prooflight.inspection.job import name_of
from prooflight.inspection.reasons import reason_of
from prooflight.reporting.report import PageEntry, page_entry, unpictured_entry

if TYPE_CHECKING:
    from prooflight.detectors.base import Inspection
    from prooflight.detectors.verdict import Verdict
    from prooflight.inspection.job import InspectPage, Pair

UNUSABLE = (ProoflightError, OSError, MemoryError)


@dataclass(frozen=True, slots=True)
class PicturedPage:
    """``job.Tried`` that gives a report's entry rather than the bare verdict."""

    work: InspectPage

    def __call__(self, pair: Pair) -> PageEntry:
        """Inspect and picture one page; a page without a scan, or with one that cannot be used, is pictured as well."""
        name = name_of(pair)
        try:
            page = self.work.page(pair[0])
            return page_entry(page, self._result(pair), self.work.inspector.press)
        except UNUSABLE as error:
            return unpictured_entry(pair[0], not_inspected(name, reason_of(error, of=name)))

    def _result(self, pair: Pair) -> Inspection | Verdict:
        number, scan = pair
        if scan is None:
            return self.work.missing(number)
        try:
            return self.work.inspection(number, scan)
        except UNUSABLE as error:
            return not_inspected(name_of(pair), reason_of(error, of=name_of(pair)))
