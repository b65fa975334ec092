"""Inspection of scans against a golden scan, where no raster of the page is available."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.base import Inspection, PressContext
from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.golden.detector import NAME, ZONES, Golden, GoldenDetector, evened
from prooflight.detectors.golden.differences import mean_and_spread
from prooflight.detectors.registry import detector as detector_of
from prooflight.detectors.verdict import Verdict
from prooflight.errors import RequestError, ScanError
from prooflight.inspection.inspector import refuse_other_camera
from prooflight.inspection.job import scan_missing
from prooflight.pages.files import page_name
from prooflight.pages.raster import MM_PER_INCH
from prooflight.pages.zones.zone import PageZones, Zone
from prooflight.pages.zones.zones_file import CAREFUL_SHARE, JobZones
from prooflight.scans.geometry import ScanGeometry
from prooflight.scans.pictures import Picture, PictureFile, picture_files
from prooflight.scans.scan import Scan

if TYPE_CHECKING:
    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press


@dataclass(frozen=True, slots=True, kw_only=True)
class GoldenPage:
    """Scan of a page, if there is one, and its golden scan."""

    number: int
    """Place in the job, from 1."""
    name: str
    scan: PictureFile | None
    goldens: tuple[PictureFile, ...]
    """Its golden scans, of which the first gives the place of every pixel."""
    left_mm: float = 0.0
    """Distance from the scan's left end to the page's left edge, where a job states the page's width."""
    scans: Path | None = None
    """File or folder in which its scan was looked for."""
    trouble: str = ""
    """Reason why the job's page cannot be used; empty: it can."""
    zones: tuple[Zone, ...] = ()
    """Zones of the page; those of the kind careful are judged as all places are."""


def golden_pages(
    golden: Path | Sequence[Path],
    scans: Path,
    *,
    sensors: int | None = None,
    lefts_mm: Sequence[float] | None = None,
    troubles: Mapping[str, str] | None = None,
) -> list[GoldenPage]:
    """Return every page with its scan and golden, in order.

    One golden is that of all scans; several belong to scans of their names, or else to pages in order.
    golden: a file or folder, or several, each of which gives every page one golden more. sensors: number of images
    of a TIFF that make up a scan, where a press states it; else a golden's file is one scan. lefts_mm: of each page
    of a job; pages without a scan are there too. troubles: of the job's pages that cannot be used, by name.
    ScanError: there is nothing to read, or numbers do not fit.
    """
    copies = [golden] if isinstance(golden, Path) else list(golden)
    each = [picture_files(copy, images=sensors) for copy in copies]
    scan_files = picture_files(scans, images=sensors or each[0][0].images)
    rows: list[tuple[str, PictureFile | None]] = [(file.name, file) for file in scan_files]
    if lefts_mm is not None:
        rows = _of_job(scans, scan_files, len(lefts_mm))
    theirs = [_of_pages(copy, files, rows) for copy, files in zip(copies, each, strict=True)]
    lefts = lefts_mm or [0.0] * len(rows)
    return [
        GoldenPage(
            number=number,
            name=name,
            scan=scan,
            goldens=its,
            left_mm=left,
            scans=scans,
            trouble=(troubles or {}).get(name, ""),
        )
        for number, ((name, scan), its, left) in enumerate(
            zip(rows, zip(*theirs, strict=True), lefts, strict=True), start=1
        )
    ]


def _of_pages(
    golden: Path, files: Sequence[PictureFile], rows: Sequence[tuple[str, PictureFile | None]]
) -> Sequence[PictureFile]:
    """Return the golden of each page among those of one file or folder."""
    named = {file.name: file for file in files}
    if len(files) == 1:
        return list(files) * len(rows)
    if all(name in named for name, _ in rows):
        return [named[name] for name, _ in rows]
    if len(files) == len(rows):
        return files
    what = f"holds {len(files)} golden scans for {len(rows)} pages"
    raise ScanError(golden, what, remedy="give one for all pages, or one for each")


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
        result = self.result(page)
        return result.verdict if isinstance(result, Inspection) else result

    def result(self, page: GoldenPage) -> Inspection | Verdict:
        """Return the inspection of one page, or the bare verdict on one that has no scan or cannot be used."""
        if page.scan is None:
            return scan_missing(page.name, page.scans)
        if page.trouble:
            return Verdict.skipped(page.name, page.trouble)
        started = time.perf_counter()
        scan = page.scan.read()
        sensors = () if self.press is None else self.press.sensors
        pitch_mm = self.pitch_mm(page)
        if self.press is not None:
            for picture, file in (*((_read(one), one) for one in page.goldens), (scan, page.scan)):
                refuse_other_camera(file.path, picture.light, self.press)
        light, spread = _combined(page.goldens, sensors)
        golden = Golden(name=page.goldens[0].path.name, light=light, spread=spread)
        zones = PageZones(zones=page.zones, careful_share=CAREFUL_SHARE) if page.zones else None
        detector = replace(self._detector(golden, pitch_mm), goldens={page.name: golden})
        sheet = detector.sheet(page.name, left_mm=page.left_mm, zones=zones)
        try:
            done = sheet.inspect(Scan(dn=scan.light, name=page.scan.path.name))
        except ScanError as error:
            raise ScanError(page.scan.path, error.what, remedy=error.remedy) from error
        milliseconds = round((time.perf_counter() - started) * 1e3, 1)
        return replace(done, verdict=replace(done.verdict, milliseconds=milliseconds))

    def _detector(self, golden: Golden, pitch_mm: tuple[float, float]) -> GoldenDetector:
        """Return the registered detector on the press, or on a scanner of which only the pixels are known."""
        if self.press is not None:
            detector = detector_of(NAME, self.press)
            assert isinstance(detector, GoldenDetector)
            return detector
        geometry = ScanGeometry(
            pixels=golden.light.shape[2],
            pixel_pitch_mm=pitch_mm[0],
            line_pitch_mm=pitch_mm[1],
            lead_in_mm=0.0,
            lead_out_mm=0.0,
        )
        return GoldenDetector(
            press_context=PressContext(name="scanner", sensors=(), geometry=geometry, costs=RunningCosts())
        )

    def pitch_mm(self, page: GoldenPage) -> tuple[float, float]:
        """Return the pitch of a page's pixels, across and along."""
        return self._pitch_mm(page.goldens[0], _read(page.goldens[0]))

    def with_zones(self, pages: Sequence[GoldenPage], path: Path) -> list[GoldenPage]:
        """Return the pages with the zones of a file, whose places count from the golden's first pixel.

        JobError: the file holds no zones, or they do not fit the pages. RequestError: it holds careful zones.
        """
        sizes_mm = []
        for page in pages:
            golden = _read(page.goldens[0])
            across_mm, along_mm = self.pitch_mm(page)
            _, lines, pixels = golden.light.shape
            sizes_mm.append((pixels * across_mm, lines * along_mm))
        zones = JobZones.read(path, sizes_mm)
        if zones.kinds - ZONES:
            what = "holds careful zones, which a golden scan does not support"
            raise RequestError(path, what, remedy="leave them out, or inspect by the job's raster")
        return [
            replace(page, zones=zones.of_pages.get(number, ())) for number, page in enumerate(pages, start=1)
        ]

    def _pitch_mm(self, golden: PictureFile, picture: Picture) -> tuple[float, float]:
        if self.press is not None:
            return self.press.geometry.pixel_pitch_mm, self.press.geometry.line_pitch_mm
        if picture.dpi is None:
            remedy = "save it with its resolution, or give the press with --press"
            raise ScanError(
                golden.path, "states no resolution, so that positions in mm are unknown", remedy=remedy
            )
        return MM_PER_INCH / picture.dpi[0], MM_PER_INCH / picture.dpi[1]


def _combined(
    goldens: tuple[PictureFile, ...], sensors: Sequence[SensorModel]
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Return mean and spread of the goldens of one page."""
    if not sensors:
        return _combined_pictures(goldens)
    lights = [evened(_read(golden).light, sensors) for golden in goldens]
    return mean_and_spread(lights, [str(golden.path) for golden in goldens])


@lru_cache(maxsize=1)
def _combined_pictures(
    goldens: tuple[PictureFile, ...],
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Return mean and spread of goldens that need no press; the last are kept, since they may be of all pages."""
    return mean_and_spread([_read(one).light for one in goldens], [str(one.path) for one in goldens])


@lru_cache(maxsize=2)
def _read(golden: PictureFile) -> Picture:
    return golden.read()
