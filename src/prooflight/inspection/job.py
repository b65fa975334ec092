"""Inspection of a whole job against its recorded scans."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.optional import LearnsPages, ScannedPage
from prooflight.detectors.verdict import Verdict
from prooflight.errors import ProoflightError, RequestError, ScanError
from prooflight.inspection.guarantee import Judged, summary_of
from prooflight.inspection.inspector import raster_of
from prooflight.inspection.reasons import reason_of
from prooflight.pages.job import Job, JobSource, opened
from prooflight.pages.parallel import KILLED, Files
from prooflight.scans.recorded import RecordedScan, recorded_scans
from prooflight.scans.scan import Scan

if TYPE_CHECKING:
    from prooflight.detectors.base import Inspection
    from prooflight.inspection.inspector import Inspector, Prepared
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.press.pages import PressJob

Pair = tuple[int, "RecordedScan | None"]
Item = TypeVar("Item")
Result = TypeVar("Result")
LONGEST = 4
"""Greatest length of a recorded scan over its page's: lines beyond the page are not inspected, but are read."""
DIGEST_DIGITS = 16
"""Number of digits of a SHA-256: enough to distinguish a press's scans, and its pages' rasters."""
MISSING: Final = "the scan is missing"
UNUSABLE: Final = (ProoflightError, OSError, MemoryError)
"""Exceptions that are raised where a page or its scan cannot be used."""
NAMED: Final = 5
"""Greatest number of pages or scans that an error names; the rest is counted."""


def paired(job: Job, scans: Path, *, sensors: int) -> list[Pair]:
    """Return every page of the job with its scan, in job order; None where a page has no scan.

    Files named after pages (p0001.tif) belong to those pages; fewer files than pages, whose names all end in
    the number of a page (scan-3.tif), belong to those; else scans follow the pages in order. ScanError if
    there are more scans than pages, or a name is of no page.
    """
    recorded = recorded_scans(scans, sensors=sensors, damaged=True)
    numbers = range(1, len(job) + 1)
    by_name = {scan.name: scan for scan in recorded}
    names = {number: job.source.page_name(number) for number in numbers}
    if len(by_name) == len(recorded) and not by_name.keys().isdisjoint(names.values()):
        unknown = sorted(set(by_name) - set(names.values()))
        if unknown:
            named = _some([by_name[name].path.name for name in unknown])
            what = f"{named} {'is' if len(unknown) == 1 else 'are'} not in the job"
            raise ScanError(scans, what, remedy=f"the job has pages {names[1]} to {names[len(job)]}")
        return [(number, by_name.get(name)) for number, name in names.items()]
    by_number = {_last_number(scan.name): scan for scan in recorded}
    if len(recorded) < len(job) and len(by_number) == len(recorded) and set(by_number) <= set(numbers):
        return [(number, by_number.get(number)) for number in numbers]
    if len(recorded) > len(job):
        what = f"holds {len(recorded)} scans"
        raise ScanError(scans, what, remedy=f"the job has {len(job)} pages")
    return [(number, recorded[number - 1] if number <= len(recorded) else None) for number in numbers]


def pair(job: PressJob, scans: str | Path, *, partly: bool = False) -> Iterator[tuple[Page, Scan]]:
    """Yield every page of a job, as it enters the press, with its scan; both are read when their turn comes.

    scans: a folder of TIFF files, or one file, paired as `inspect` does (``paired``). partly: pages without a
    scan are left out. ScanError: the scans are not those of the job, or, unless ``partly``, pages have none
    and are named; later, a scan that cannot be used. JobError, later: a page that cannot.
    """
    where = Path(scans)
    pairs = paired(job, where, sensors=len(job.press.sensors))
    lacking = [job.source.page_name(number) for number, scan in pairs if scan is None]
    if lacking and not partly:
        what = f"holds no scan of {_some(lacking)}"
        raise ScanError(where, what, remedy="add them, or give partly=True to leave such pages out")
    there = ((number, scan) for number, scan in pairs if scan is not None)
    return ((page := job.page(number), read_scan(scan, page, job.press)) for number, scan in there)


def read_scan(scan: RecordedScan, page: Page, press: Press) -> Scan:
    """Read a page's scan; ScanError, before it is decoded, if it cannot be one of this page on this press."""
    lines_max = LONGEST * press.geometry.lines(page.height_mm)
    return Scan(dn=scan.read(pixels=press.geometry.pixels, lines_max=lines_max), name=str(scan.path))


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def _last_number(name: str) -> int | None:
    """Return the number in which a file's stem ends."""
    match = re.search(r"([0-9]{1,9})$", name)
    return None if match is None else int(match[1])


def scan_missing(name: str, scans: Path | None) -> Verdict:
    """Return the verdict on a page without a scan; scans: the folder or file in which it was looked for."""
    if scans is None:
        return Verdict.skipped(name, MISSING)
    where = f"looked for {name}.tif in {scans}" if scans.is_dir() else f"{scans} ends before it"
    return Verdict.skipped(name, f"{MISSING} ({where})")


def lacks_scan(verdict: Verdict) -> bool:
    """Return whether a page was not inspected because it has no scan."""
    return verdict.verdict == "not-inspected" and (not verdict.reason or verdict.reason.startswith(MISSING))


def unusable(name: str, error: Exception) -> Verdict:
    """Return the verdict on a page that cannot be used, or whose scan cannot."""
    return Verdict.skipped(name, reason_of(error, of=name))


@dataclass(frozen=True, slots=True)
class Tried(Generic[Item, Result]):
    """Wrapper of work on one page: where page or scan cannot be used, the verdict is not-inspected, with the reason."""

    work: Callable[[Item], Result]
    name: Callable[[Item], str]
    bare: Callable[[Verdict], Result]
    """Conversion of the verdict on a page that was not inspected to the work's result."""

    def __call__(self, item: Item) -> Result:
        """Return the work's result, or the one that replaces it."""
        try:
            return self.work(item)
        except UNUSABLE as error:
            return self.bare(unusable(self.name(item), error))

    def killed(self, item: Item) -> Result:
        """Return the result for a page whose inspection the operating system killed."""
        return self.bare(Verdict.skipped(self.name(item), KILLED))


def alone(verdict: Verdict) -> Verdict:
    """Return a verdict as it is, where its page is in no run; for ``Tried.bare``."""
    return verdict


def first_reason(verdicts: Sequence[Verdict]) -> str:
    """Return the reason why none of these was inspected: the first other than a missing scan."""
    return next((one for one in verdicts if not lacks_scan(one)), verdicts[0]).reason


class StoredDesigns(Protocol):
    """Pages of a job that were prepared before; picklable."""

    def prepared(self, number: int) -> Prepared | None:
        """Return a page of the job, from 1, as it was prepared; None: it was not."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectPage:
    """Inspection of one page of a job; small and picklable, so that it can be sent to worker processes."""

    job: JobSource
    inspector: Inspector
    scans: Path | None = None
    """File or folder in which scans were looked for."""
    stored: StoredDesigns | None = None
    """Pages that were prepared before; None: none."""

    def __call__(self, pair: Pair) -> Judged:
        """Return verdict and evidence of one page and its scan.

        ProoflightError: one of them cannot be used.
        """
        number, scan = pair
        if scan is None:
            return Judged(scan_missing(self.name(pair), self.scans))
        design = self.design(number)
        inspection = self.inspection(design, scan)
        return Judged(inspection.verdict, summary_of(inspection), raster_of(design).warnings)

    @property
    def files(self) -> Files[Pair]:
        """Files of the job, and of each scan."""
        return Files(of_work=self.job.files, of_item=lambda pair: () if pair[1] is None else (pair[1].path,))

    def name(self, pair: Pair) -> str:
        """Return the name of a page, whether it has a scan or not."""
        return self.job.page_name(pair[0])

    def design(self, number: int) -> Page | Prepared:
        """Return a page as it was prepared; if it was not, as it lies in the press."""
        before = None if self.stored is None else self.stored.prepared(number)
        return before or self.inspector.press.geometry.lay(opened(self.job).page(number))

    def inspection(self, design: Page | Prepared, scan: RecordedScan) -> Inspection:
        """Return the verdict on one page, as ``design`` gives it, with its evidence and the data for pictures."""
        return self.inspector.inspect(design, read_scan(scan, raster_of(design), self.inspector.press))


@dataclass(frozen=True, slots=True)
class ScanPage:
    """``InspectPage`` that returns a page to learn from; its inspector's detector ``LearnsPages``."""

    work: InspectPage

    def __call__(self, scanned: tuple[int, RecordedScan]) -> ScannedPage:
        """Inspect a page, by its number, in its scan.

        ScanError: it was made under other light than the press knows. RequestError: the detector learns from no page.
        """
        number, scan = scanned
        page, inspector = raster_of(self.work.design(number)), for_learning(self.work.inspector)
        read = read_scan(scan, page, inspector.press)
        inspection = inspector.inspect(page, read)
        if inspection.verdict.score is None or inspection.variation is None:
            remedy = "give scans of good pages, made by the press as it was calibrated"
            raise ScanError(scan.path, inspection.verdict.reason, remedy=remedy)
        return ScannedPage(
            name=page.name,
            score=inspection.verdict.score,
            evidence=inspection.stored_arrays,
            variation=inspection.variation(),
            digest=_digest(read.dn),
            design=_digest(page.cmyk),
        )


def _digest(array: NDArray[np.generic]) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()[:DIGEST_DIGITS]


def for_learning(inspector: Inspector) -> Inspector:
    """Return an inspector whose detector keeps all that it learns from; RequestError: it learns from no page."""
    detector = inspector.detector
    if not isinstance(detector, LearnsPages):
        what = f"{detector.name!r} of press {inspector.press.name} cannot learn from real pages"
        raise RequestError(
            "learn", what, remedy="build the press with `prooflight press build --detector quick`"
        )
    return type(inspector)(inspector.press, detector.for_learning())
