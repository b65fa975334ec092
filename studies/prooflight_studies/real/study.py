"""Real copies, printed and scanned on office devices: verdicts on sheets as they are, and on marks laid into them.

A mark is laid into a real scan by the share of light that it takes from the page as the preset's lens sees it, neither
grown nor sharpened, which makes it no easier to see than a printed one. Marks of the table of ``study visible`` lie on
bare paper, apart from each other and from print.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.detectors.base import PlannedPage
from prooflight.detectors.golden.chain import DrawnSheet, bare_light, light_of
from prooflight.errors import RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.scanner.finding import ExpectedPages, PlacedScan, placed_scans
from prooflight.inspection.scanner.inspected import drawn_detector, scan_on_page
from prooflight.pages.job import JobSource, opened
from prooflight.pages.zones.zones_file import JobZones, ZoneEntry
from prooflight.press.pages import job_source
from prooflight.press.scanner import feeder_of, scanner_press_file
from prooflight.rng import stream
from prooflight.scans.scan import Scan
from prooflight.scans.scanner.reading import ScannerSettings, scanned_pages
from prooflight_studies.harness.page import write_page
from prooflight_studies.real.against_each_other import GoldenRow, golden_rows, new_places
from prooflight_studies.visible.marks import NAMED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.golden.chain import DrawnDetector, SignalChain
    from prooflight.inspection.job import Pair
    from prooflight.press.artefact import Press

JOB: Final = "midterm1-v2-test.pdf"
COPIES: Final = ("midterm_scan_100.pdf", "midterm_scan_101.pdf")
STAMP_MM: Final = (0.0, 5.0, 215.9, 36.0)
"""Strip in which each copy has a stamped code and label that the job lacks. [mm]"""
MARKS_AT_ONCE: Final = 5
"""Marks that are laid into a scan at once: a verdict lists twelve places, and a splash may take six."""
BORDER_MM: Final = 15.0
SEPARATION_MM: Final = 3.0
"""Distance of a mark from the page's border, and beyond its reach from print and other marks."""
TRIES: Final = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetRow:
    """One real sheet."""

    scans: str
    page: int
    verdict: str
    reason: str
    places_mm: tuple[tuple[float, float, float, float], ...]
    """x, y, width and height of what differs."""
    moved_mm: tuple[float, float]
    """Mean displacement that was left after placing, and is followed by the comparison."""
    residual_mm: float
    """Distance of the print from the place that the comparison follows, rms along an axis."""
    by_other: str
    """Verdict by the chain of the other copy alone; empty: there is no other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkRow:
    """One mark of the table."""

    name: str
    laid: int
    caught: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainRow:
    """Chain fitted to all sheets of one copy."""

    scans: str
    growth_um: float
    growth_sd_um: float
    kernel: tuple[float, ...]
    edge_sd: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RealStudy:
    """Figures of the page."""

    seed: int
    quick: bool
    sheets: tuple[SheetRow, ...]
    marks: tuple[MarkRow, ...]
    chains: tuple[ChainRow, ...]
    goldens: tuple[GoldenRow, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Copy:
    """One copy, placed, with the detector of its own sheets."""

    scans: Path
    source: JobSource
    zones: JobZones
    detector: DrawnDetector
    pairs: list[Pair]


def run_real_study(
    folder: Path,
    out: Path,
    *,
    seed: int,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
) -> RealStudy:
    """Inspect the real sheets of ``folder`` as they are and with marks laid into them; writes ``real.md``.

    quick: one copy. RequestError: the folder lacks the job or its scans.
    """
    from prooflight.commissioning.build import build_press

    files = [folder / name for name in (JOB, *COPIES)]
    if missing := [file.name for file in files if not file.is_file()]:
        raise RequestError(
            folder, f"has no {', '.join(missing)}", remedy="give --copies the folder of the scans"
        )
    press = build_press(scanner_press_file(dpi=300.0, grey=True, width_mm=216.0), seed=1, progress=progress)
    source = job_source(files[0], press, profile=None)
    sheets, caught = [], {mark.name: [0, 0] for mark in NAMED}
    copies = [_copy(folder / name, source, press, progress) for name in COPIES[: 1 if quick else None]]
    for copy in copies:
        others = [other.detector.chains[""] for other in copies if other is not copy]
        for row, marks in _of_copy(copy, others, press, seed, progress):
            sheets.append(row)
            for name, one in marks:
                caught[name][0] += 1
                caught[name][1] += one
    results = RealStudy(
        seed=seed,
        quick=quick,
        sheets=tuple(sheets),
        marks=tuple(
            MarkRow(name=name, laid=marked_dn, caught=one) for name, (marked_dn, one) in caught.items()
        ),
        chains=tuple(_chain_row(copy.scans.name, copy.detector.chains[""]) for copy in copies),
        goldens=()
        if quick
        else tuple(golden_rows({copy.scans: copy.pairs for copy in copies}, STAMP_MM, seed, progress)),
    )
    write_page(out / "real.md", "real", results)
    return results


def _chain_row(copy: str, chain: SignalChain) -> ChainRow:
    return ChainRow(
        scans=copy,
        growth_um=round(chain.growth_um, 1),
        growth_sd_um=round(chain.growth_sd_um, 1),
        kernel=tuple(round(float(weight), 3) for weight in chain.kernels[0]),
        edge_sd=round(chain.edge_sd, 3),
    )


def _copy(scans: Path, source: JobSource, press: Press, progress: Callable[[str], None]) -> Copy:
    with source.open() as job:
        sizes = job.page_sizes_mm
    stamp = ZoneEntry(name="stamp", kind="ignore", rectangle_mm=STAMP_MM)
    zones, settings = JobZones.create([stamp], sizes), ScannerSettings()
    pages = ExpectedPages(job=source, press=press, feeder=feeder_of(press))
    placed = placed_scans(scanned_pages(scans), pages, len(sizes), settings=settings, progress=progress)
    detector, pairs = drawn_detector(placed, source, press, settings, zones=zones, progress=progress)
    return Copy(scans=scans, source=source, zones=zones, detector=detector, pairs=pairs)


def _of_copy(
    copy: Copy, others: Sequence[SignalChain], press: Press, seed: int, progress: Callable[[str], None]
) -> Iterator[tuple[SheetRow, list[tuple[str, bool]]]]:
    """Return each sheet of a copy with its marks, each caught or not."""
    scans, zones, settings = copy.scans, copy.zones, ScannerSettings()
    inspector = Inspector(press, copy.detector, zones=zones)
    crossed = [Inspector(press, replace(copy.detector, chains={"": chain}), zones=zones) for chain in others]
    for number, scan in copy.pairs:
        assert isinstance(scan, PlacedScan)
        progress(f"{scans.name}: page {number}")
        page = press.geometry.lay(opened(copy.source).page(number))
        planned = PlannedPage(page, press.press_context(), zones.page(page))
        lines, _ = scan_on_page(scan, planned, press, settings, by_type=False)
        prepared = inspector.prepare(planned)
        sheet = prepared.prepared_page
        assert isinstance(sheet, DrawnSheet)
        verdict = inspector.inspect(prepared, Scan(dn=lines, name=scan.scan.name)).verdict
        by_others = [
            other.inspect(other.prepare(planned), Scan(dn=lines, name=scan.scan.name)).verdict.verdict
            for other in crossed
        ]
        rng = stream(seed, "real-marks", COPIES.index(scans.name), number)
        caught: list[tuple[str, bool]] = []
        for first in range(0, len(NAMED), MARKS_AT_ONCE):
            some = NAMED[first : first + MARKS_AT_ONCE]
            marked, places = page, _places(planned, press, [mark.reach_mm for mark in some], rng)
            for mark, at in zip(some, places, strict=True):
                marked = mark.draw(marked, at, rng)
            clean = bare_light(planned.expected, press.sensors)
            share = bare_light(press.press_context().predict(marked), press.sensors) / np.maximum(clean, 1e-3)
            seen = np.clip(light_of(lines, press.sensors) * share, 0, 1)
            sensor = press.sensors[0]
            dn = sensor.column_offset_dn + sensor.column_gain * np.float32(sensor.white_dn) * seen[0]
            changed = share[0] < 1 - 1e-3
            marked_dn = np.where(changed, np.clip(np.rint(dn), 0, sensor.top_code_dn), lines[0]).astype(
                np.uint16
            )
            judged = inspector.inspect(prepared, Scan(dn=marked_dn[None], name=scan.scan.name)).verdict
            new = new_places(judged, verdict)
            caught += [
                (mark.name, any(_near(box, at, mark.reach_mm) for box in new))
                for mark, at in zip(some, places, strict=True)
            ]
        boxes = tuple((one.x_mm, one.y_mm, one.width_mm, one.height_mm) for one in verdict.regions)
        row = SheetRow(
            scans=scans.stem,
            page=number,
            verdict=verdict.verdict,
            reason=verdict.reason,
            places_mm=boxes,
            moved_mm=verdict.shift_mm or (0.0, 0.0),
            residual_mm=press.geometry.pixel_pitch_mm
            * sheet.residual_pixels(Scan(dn=lines, name=scan.scan.name)),
            by_other=", ".join(by_others),
        )
        yield row, caught


def _near(box: tuple[float, float, float, float], at: tuple[float, float], reach_mm: float) -> bool:
    x, y, width, height = box
    return (x - reach_mm <= at[0] <= x + width + reach_mm) and (
        y - reach_mm <= at[1] <= y + height + reach_mm
    )


def _places(
    planned: PlannedPage, press: Press, reaches_mm: Sequence[float], rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Return places on bare paper, one for each mark, apart from print, stamp and each other."""
    page, light = planned.page, bare_light(planned.expected, press.sensors).min(axis=0)
    x_mm, y_mm = press.geometry.centres_x_mm(page.width_mm), press.geometry.centres_y_mm(len(light))
    taken = light < 0.95
    if planned.zones is not None:
        taken |= planned.zones.holds("ignore", x_mm, y_mm)
    free_mm: NDArray[np.float32] = cv2.distanceTransform((~taken).astype(np.uint8), cv2.DIST_L2, 5)
    free_mm = free_mm * np.float32(press.geometry.pixel_pitch_mm)
    places: list[tuple[float, float]] = []
    for _ in range(TRIES):
        reach = reaches_mm[len(places)]
        x = float(rng.uniform(BORDER_MM, page.width_mm - BORDER_MM))
        y = float(rng.uniform(BORDER_MM, page.height_mm - BORDER_MM))
        clear = (
            free_mm[int(np.abs(y_mm - y).argmin()), int(np.abs(x_mm - x).argmin())] > reach + SEPARATION_MM
        )
        is_separate = all(
            np.hypot(x - one[0], y - one[1]) > reach + other + SEPARATION_MM
            for one, other in zip(places, reaches_mm, strict=False)
        )
        if clear and is_separate:
            places.append((x, y))
            if len(places) == len(reaches_mm):
                return places
    raise RequestError(page.name, "has no bare paper for marks", remedy="place fewer marks at once")
