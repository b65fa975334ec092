"""A whole job against its recorded scans."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from prooflight.acquiring.replay import recorded_scans
from prooflight.errors import ScanError
from prooflight.inspecting.inspection import pictured
from prooflight.inspecting.inspector import Inspector, not_inspected
from prooflight.pages.files import page_name
from prooflight.pages.job import opened

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.acquiring.replay import RecordedScan
    from prooflight.deciding.verdict import Verdict
    from prooflight.inspecting.inspection import Inspection
    from prooflight.pages.job import Job, JobSource
    from prooflight.pages.raster import Page

Pair = tuple[int, "RecordedScan | None"]
DIGEST_DIGITS = 16
"""Of a scan's SHA-256: enough to tell a press's scans apart."""


def paired(job: Job, scans: Path, *, sensors: int) -> list[Pair]:
    """Every page of the job with its scan, in job order; None where a page has no scan.

    Files named after pages (p0001.tif) belong to those pages; else scans follow the pages in order. ScanError if there
    are more scans than pages, or a name is of no page.
    """
    recorded = recorded_scans(scans, sensors=sensors)
    numbers = range(1, len(job) + 1)
    by_name = {scan.name: scan for scan in recorded}
    if len(by_name) == len(recorded) and any(page_name(number) in by_name for number in numbers):
        strange = sorted(set(by_name) - {page_name(number) for number in numbers})
        if strange:
            what = f"{by_name[strange[0]].path.name} is no page of the job"
            raise ScanError(scans, what, remedy=f"the job has pages {page_name(1)} to {page_name(len(job))}")
        return [(number, by_name.get(page_name(number))) for number in numbers]
    if len(recorded) > len(job):
        what = f"holds {len(recorded)} scans"
        raise ScanError(scans, what, remedy=f"the job has {len(job)} pages")
    return [(number, recorded[number - 1] if number <= len(recorded) else None) for number in numbers]


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectPage:
    """Inspect one page of a job; small and picklable, so that it travels to worker processes."""

    job: JobSource
    inspector: Inspector

    def __call__(self, pair: Pair) -> Verdict:
        """The verdict on one page and its scan."""
        number, scan = pair
        if scan is None:
            return not_inspected(page_name(number))
        return self._inspection(self.page(number), scan).verdict

    def page(self, number: int) -> Page:
        """The job's page as it lies in the press."""
        return self.inspector.press.geometry.lay(opened(self.job).page(number))

    def inspection(self, number: int, scan: RecordedScan) -> Inspection:
        """The verdict on one page and all that it rests on, with what pictures need."""
        page = self.page(number)
        return pictured(self._inspection(page, scan), page, self.inspector.press)

    def _inspection(self, page: Page, scan: RecordedScan) -> Inspection:
        prepared = self.inspector.prepare(page)
        return self.inspector.inspect(prepared, scan.read(), scan_name=str(scan.path))


@dataclass(frozen=True, slots=True, kw_only=True)
class PageScore:
    """What one page of a job scored."""

    name: str
    score: float
    digest: str
    """Of its scan."""


@dataclass(frozen=True, slots=True)
class ScoredPage:
    """``InspectPage`` that gives the score alone, and tells one scan from another."""

    work: InspectPage

    def __call__(self, pair: Pair) -> PageScore:
        """Inspect one page that has a scan; ScanError: it was made under other light than the press knows."""
        number, scan = pair
        assert scan is not None
        dn = scan.read()
        inspector = self.work.inspector
        inspection = inspector.inspect(
            inspector.prepare(self.work.page(number)), dn, scan_name=str(scan.path)
        )
        score = inspection.verdict.score
        if score is None:
            remedy = "give scans of good pages, made by the press as it was calibrated"
            raise ScanError(scan.path, inspection.verdict.reason, remedy=remedy)
        digest = hashlib.sha256(np.ascontiguousarray(dn).tobytes()).hexdigest()[:DIGEST_DIGITS]
        return PageScore(name=page_name(number), score=score, digest=digest)
