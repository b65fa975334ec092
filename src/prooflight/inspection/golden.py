"""Inspection of scans against a golden scan, where no raster of the page is available."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Self

from prooflight.detectors.golden.detector import GoldenSheet, evened
from prooflight.detectors.verdict import Verdict
from prooflight.errors import ScanError
from prooflight.inspection.inspector import refuse_other_camera
from prooflight.inspection.job import scan_missing
from prooflight.pages.files import page_name
from prooflight.pages.raster import MM_PER_INCH
from prooflight.scans.pictures import PictureFile, picture_files
from prooflight.scans.scan import Scan

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from prooflight.press.artefact import Press
    from prooflight.scans.pictures import Picture


@dataclass(frozen=True, slots=True, kw_only=True)
class GoldenPage:
    """Scan of a page, if there is one, and its golden scan."""

    name: str
    scan: PictureFile | None
    golden: PictureFile
    left_mm: float = 0.0
    """Distance from the scan's left end to the page's left edge, where a job states the page's width."""
    scans: Path | None = None
    """File or folder in which its scan was looked for."""
    trouble: str = ""
    """Reason why the job's page cannot be used; empty: it can."""


def golden_pages(
    golden: Path,
    scans: Path,
    *,
    sensors: int | None = None,
    lefts_mm: Sequence[float] | None = None,
    troubles: Mapping[str, str] | None = None,
) -> list[GoldenPage]:
    """Return every page with its scan and golden, in order.

    One golden is that of all scans; several belong to scans of their names, or else to pages in order.
    sensors: number of images of a TIFF that make up a scan, where a press states it; else a golden's file is
    one scan. lefts_mm: of each page of a job; pages without a scan are there too. troubles: of the job's
    pages that cannot be used, by name. ScanError: there is nothing to read, or numbers do not fit.
    """
    goldens = picture_files(golden, images=sensors)
    scan_files = picture_files(scans, images=sensors or goldens[0].images)
    rows: list[tuple[str, PictureFile | None]] = [(file.name, file) for file in scan_files]
    if lefts_mm is not None:
        rows = _of_job(scans, scan_files, len(lefts_mm))
    named = {file.name: file for file in goldens}
    if len(goldens) == 1:
        theirs = goldens * len(rows)
    elif all(name in named for name, _ in rows):
        theirs = [named[name] for name, _ in rows]
    elif len(goldens) == len(rows):
        theirs = goldens
    else:
        what = f"holds {len(goldens)} golden scans for {len(rows)} pages"
        raise ScanError(golden, what, remedy="give one for all pages, or one for each")
    lefts = lefts_mm or [0.0] * len(rows)
    return [
        GoldenPage(
            name=name,
            scan=scan,
            golden=its,
            left_mm=left,
            scans=scans,
            trouble=(troubles or {}).get(name, ""),
        )
        for (name, scan), its, left in zip(rows, theirs, lefts, strict=True)
    ]


def _of_job(
    scans: Path, scan_files: Sequence[PictureFile], pages: int
) -> list[tuple[str, PictureFile | None]]:
    """Return the pages of a job with their scans, by name (p0001.tif) if all have such names, else in order."""
    names = [page_name(number) for number in range(1, pages + 1)]
    by_name = {file.name: file for file in scan_files}
    if len(by_name) == len(scan_files) and set(by_name) <= set(names):
        return [(name, by_name.get(name)) for name in names]
    if len(scan_files) > pages:
        raise ScanError(scans, f"holds {len(scan_files)} scans", remedy=f"the job has {pages} pages")
    return [(name, scan_files[at] if at < len(scan_files) else None) for at, name in enumerate(names)]


@dataclass(frozen=True, slots=True, kw_only=True)
class GoldenInspector:
    """Inspector of scans against golden ones.

    It is small and picklable, so that it can be sent to worker processes.
    """

    press: Press | None = None
    """Press that gives pixel pitch, lead-in and columns; None: the golden's file states its resolution."""

    @classmethod
    def of(cls, press: Press | None, *goldens: PictureFile) -> Self:
        """Create an inspector; ScanError, before any work, if no golden states the size of a pixel."""
        inspector = cls(press=press)
        for golden in goldens[:-1]:
            with contextlib.suppress(ScanError):
                inspector._pitch_mm(golden, _read(golden))
                return inspector
        inspector._pitch_mm(goldens[-1], _read(goldens[-1]))  # it raises
        return inspector

    def __call__(self, page: GoldenPage) -> Verdict:
        """Return the verdict on one page; ScanError if its scan is no scan of the golden's kind."""
        if page.scan is None:
            return scan_missing(page.name, page.scans)
        if page.trouble:
            return Verdict.skipped(page.name, page.trouble)
        started = time.perf_counter()
        golden, scan = _read(page.golden), page.scan.read()
        sensors = () if self.press is None else self.press.sensors
        if self.press is not None:
            for picture, file in ((golden, page.golden), (scan, page.scan)):
                refuse_other_camera(file.path, picture.light, self.press)
        sheet = GoldenSheet(
            page=page.name,
            golden=page.golden.path.name,
            light=evened(golden.light, sensors),
            pitch_mm=self._pitch_mm(page.golden, golden),
            left_mm=page.left_mm,
            lead_in_mm=0.0 if self.press is None else self.press.geometry.lead_in_mm,
            sensors=sensors,
        )
        try:
            done = sheet.inspect(Scan(dn=scan.light, name=page.scan.path.name))
        except ScanError as error:
            raise ScanError(page.scan.path, error.what, remedy=error.remedy) from error
        return replace(done.verdict, milliseconds=round((time.perf_counter() - started) * 1e3, 1))

    def _pitch_mm(self, golden: PictureFile, picture: Picture) -> tuple[float, float]:
        if self.press is not None:
            return self.press.geometry.pixel_pitch_mm, self.press.geometry.line_pitch_mm
        if picture.dpi is None:
            remedy = "save it with its resolution, or give the press with --press"
            raise ScanError(
                golden.path, "states no resolution, so that nothing has a place in mm", remedy=remedy
            )
        return MM_PER_INCH / picture.dpi[0], MM_PER_INCH / picture.dpi[1]


@lru_cache(maxsize=2)
def _read(golden: PictureFile) -> Picture:
    return golden.read()
