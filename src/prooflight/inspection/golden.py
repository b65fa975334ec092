"""Scans against a golden one: where no raster says what was to be printed, a good scan does."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from prooflight.detectors.base import Judgement, Region, Verdict
from prooflight.detectors.golden.differences import compare
from prooflight.detectors.golden.place import TILE_PIXELS
from prooflight.detectors.golden.regions import LEAST_VOLUME, Mark, marks
from prooflight.errors import ScanError
from prooflight.inspection.inspector import not_inspected
from prooflight.inspection.job import scan_missing
from prooflight.pages.files import page_name
from prooflight.pages.parallel import KILLED
from prooflight.pages.raster import MM_PER_INCH
from prooflight.scans.pictures import PictureFile, picture_files

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight.scans.pictures import Picture

DETECTOR: Final = "golden"
MOST_REGIONS: Final = 12
MARGIN_PIXELS: Final = 2
"""Around a region: as far as edges may lie off, so much of it may be hidden."""
CROPPED: Final = 0.05
"""A scan may be longer or shorter than its golden by this share; what both show is compared."""
STREAK_WIDTH_MM: Final = 5.0
STREAK_RATIO: Final = 4.0
SPOT_MM: Final = 6.0
"""The greatest spot of worlds.toml."""
WRONG_SHIFT_MM: Final = 1.8
"""worlds.toml: a page this far off is a misprint; two good prints lie at most 1.6 mm apart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GoldenPage:
    """A page's scan, if there is one, and its golden."""

    name: str
    scan: PictureFile | None
    golden: PictureFile
    left_mm: float = 0.0
    """From the scan's left end to the page's left edge, where a job tells the page's width."""
    scans: Path | None = None
    """Where its scan was looked for."""
    trouble: str = ""
    """Why the job's page cannot be used; empty: it can."""


def golden_pages(
    golden: Path,
    scans: Path,
    *,
    sensors: int | None = None,
    lefts_mm: Sequence[float] | None = None,
    troubles: Mapping[str, str] | None = None,
) -> list[GoldenPage]:
    """Every page with its scan and golden, in order.

    One golden is that of all scans; several belong to scans of their names, or else to pages in order. sensors: how
    many images of a TIFF make up a scan, where a press says so; else a golden's file is one scan. lefts_mm: of each
    page of a job; pages without a scan are there too. troubles: of the job's pages that cannot be used, by name.
    ScanError: there is nothing to read, or numbers do not fit.
    """
    goldens = picture_files(golden, images=sensors)
    found = picture_files(scans, images=sensors or goldens[0].images)
    rows: list[tuple[str, PictureFile | None]] = [(file.name, file) for file in found]
    if lefts_mm is not None:
        rows = _of_job(scans, found, len(lefts_mm))
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


def page_killed(page: GoldenPage) -> Verdict:
    """The verdict on a page whose inspection the system ended."""
    return not_inspected(page.name, KILLED)


def _of_job(scans: Path, found: Sequence[PictureFile], pages: int) -> list[tuple[str, PictureFile | None]]:
    """Pages of a job with their scans, by name (p0001.tif) if all have such names, else in order."""
    names = [page_name(number) for number in range(1, pages + 1)]
    by_name = {file.name: file for file in found}
    if len(by_name) == len(found) and set(by_name) <= set(names):
        return [(name, by_name.get(name)) for name in names]
    if len(found) > pages:
        raise ScanError(scans, f"holds {len(found)} scans", remedy=f"the job has {pages} pages")
    return [(name, found[at] if at < len(found) else None) for at, name in enumerate(names)]


@dataclass(frozen=True, slots=True, kw_only=True)
class GoldenInspector:
    """Compares scans with golden ones; small and picklable, so that it travels to worker processes."""

    press: Press | None = None
    """For pixel pitch, lead-in and columns; None: the golden's file states its resolution."""

    @classmethod
    def of(cls, press: Press | None, *goldens: PictureFile) -> Self:
        """ScanError, before any work, if nothing says how large a pixel is of any golden."""
        made = cls(press=press)
        for golden in goldens[:-1]:
            with contextlib.suppress(ScanError):
                made._pitch_mm(golden, _read(golden))
                return made
        made._pitch_mm(goldens[-1], _read(goldens[-1]))  # it raises
        return made

    def __call__(self, page: GoldenPage) -> Verdict:
        """The verdict on one page; ScanError if its scan is no scan of the golden's kind."""
        scan, golden = page.scan, page.golden
        if scan is None:
            return scan_missing(page.name, page.scans)
        if page.trouble:
            return not_inspected(page.name, page.trouble)
        started = time.perf_counter()
        good = _read(golden)
        expected, seen = _alike(scan, self._evened(good.light, golden), self._evened(scan.read().light, scan))
        for light, file in ((expected, golden), (seen, scan)):
            if not np.isfinite(light).all():
                why = f"{file.path.name} holds values that are not finite numbers"
                return Verdict.passed(page.name, why, detector=DETECTOR)
        difference = compare(expected, seen)
        places = marks(difference)
        where = difference.place
        pitch_mm = self._pitch_mm(golden, good)
        shift_mm = tuple(
            round(shift * pitch, 4) for shift, pitch in zip(where.shift_pixels, pitch_mm, strict=True)
        )
        off_place = max(map(abs, shift_mm)) >= WRONG_SHIFT_MM
        wrong_page = not where.found or off_place
        regions = tuple(self._region(mark, pitch_mm, page.left_mm) for mark in places[:MOST_REGIONS])
        kind = "wrong-page" if wrong_page else regions[0].kind if regions else None
        judgement = Judgement(
            misprint=wrong_page or bool(places),
            score=round(places[0].volume, 1) if places else 0.0,
            threshold=LEAST_VOLUME,
            p_value=None,
            probability=None,
        )
        return Verdict.judged(
            page.name,
            judgement,
            kind=kind,
            regions=regions,
            shift_mm=(shift_mm[0], shift_mm[1]) if where.found else None,
            milliseconds=round((time.perf_counter() - started) * 1e3, 1),
            detector=DETECTOR,
            reason=_reason(where.likeness, off_place=off_place, found=where.found, places=len(places)),
        )

    def _pitch_mm(self, golden: PictureFile, picture: Picture) -> tuple[float, float]:
        if self.press is not None:
            return self.press.geometry.pixel_pitch_mm, self.press.geometry.line_pitch_mm
        if picture.dpi is None:
            remedy = "save it with its resolution, or give the press with --press"
            raise ScanError(
                golden.path, "states no resolution, so that nothing has a place in mm", remedy=remedy
            )
        return MM_PER_INCH / picture.dpi[0], MM_PER_INCH / picture.dpi[1]

    def _evened(self, light: NDArray[np.float32], file: PictureFile) -> NDArray[np.float32]:
        """Columns' offsets and gains taken out, where the press knows them; ScanError if it is another camera's."""
        if self.press is None:
            return light
        sensors = self.press.sensors
        if light.shape[0] != len(sensors) or light.shape[2] != self.press.geometry.pixels:
            what = f"is of {light.shape[0]} sensors x {light.shape[2]} pixels"
            remedy = (
                f"press {self.press.name} has {len(sensors)} sensors x {self.press.geometry.pixels} pixels"
            )
            raise ScanError(file.path, what, remedy=remedy)
        return np.stack(
            [
                (sheet - one.column_offset_dn) / one.column_gain
                for sheet, one in zip(light, sensors, strict=True)
            ]
        )

    def _region(self, mark: Mark, pitch_mm: tuple[float, float], left_mm: float) -> Region:
        left, top, right, bottom = mark.grown(MARGIN_PIXELS)
        width_mm, height_mm = (right - left) * pitch_mm[0], (bottom - top) * pitch_mm[1]
        lead_in_mm = 0.0 if self.press is None else self.press.geometry.lead_in_mm
        return Region(
            x_mm=round(left * pitch_mm[0] - left_mm, 2),
            y_mm=round(top * pitch_mm[1] - lead_in_mm, 2),
            width_mm=round(width_mm, 2),
            height_mm=round(height_mm, 2),
            score=round(mark.volume, 1),
            kind=_kind(width_mm, height_mm, lighter=mark.lighter),
        )


@lru_cache(maxsize=2)
def _read(golden: PictureFile) -> Picture:
    return golden.read()


def _alike(
    scan: PictureFile, golden: NDArray[np.float32], seen: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Both cut to what both show, grey if either is; ScanError if their sizes are too different, or too small."""
    if len(golden) != len(seen):
        golden, seen = (image.mean(axis=0, keepdims=True) for image in (golden, seen))
    sizes = np.array([golden.shape[1:], seen.shape[1:]])
    if sizes.min() < TILE_PIXELS:
        small = "its golden is" if sizes[0].min() < TILE_PIXELS else "is"
        lines, pixels = sizes[sizes.min(axis=1).argmin()]
        what = f"{small} of {lines} lines x {pixels} pixels"
        raise ScanError(
            scan.path, what, remedy=f"{TILE_PIXELS} x {TILE_PIXELS} are the least that can be compared"
        )
    if (np.abs(sizes[1] / sizes[0] - 1) > CROPPED).any():
        what = f"is of {seen.shape[1]} lines x {seen.shape[2]} pixels"
        raise ScanError(scan.path, what, remedy=f"its golden has {golden.shape[1]} x {golden.shape[2]}")
    lines, pixels = sizes.min(axis=0)
    return golden[:, :lines, :pixels], seen[:, :lines, :pixels]


def _kind(width_mm: float, height_mm: float, *, lighter: bool) -> str:
    """What one place looks like."""
    if width_mm <= STREAK_WIDTH_MM and height_mm > max(STREAK_RATIO * width_mm, SPOT_MM):
        return "streak"
    if max(width_mm, height_mm) <= SPOT_MM:
        return "spots-voids"
    return "missing-content" if lighter else "unknown"


def _reason(likeness: float, *, off_place: bool, found: bool, places: int) -> str:
    if not found:
        return f"the scan does not show what the golden shows: their edges agree to {max(likeness, 0):.0%}"
    if off_place:
        return f"the page lies {WRONG_SHIFT_MM} mm or more from where the golden lies"
    if places:
        return f"{places} place{'s differ' if places > 1 else ' differs'} from the golden by more than good prints do"
    return ""
