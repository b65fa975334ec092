"""Speed of prediction, comparison and whole inspections, as ratios to baselines measured in the same run."""

from __future__ import annotations

import io
import struct
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image, ImageCms
from scipy import ndimage

from prooflight.detectors.base import PlannedPage
from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.design import prepare_page
from prooflight.detectors.matched_filter.statistics.families import remaining_statistics, screen_statistics
from prooflight.detectors.matched_filter.statistics.local_evidence import Scatter
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES
from prooflight.inspection.codes.finding import page_codes
from prooflight.inspection.inspector import Inspector
from prooflight.kernels.compiled import kernel
from prooflight.kernels.prediction.lookup import NODE_STEP, lookup_light
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.prediction.quantised_table import quantised_table
from prooflight.rng import stream
from prooflight.scans.placement import IN_PLACE, Placement
from prooflight.simulation.scans import ideal_scan
from prooflight_studies.speed.compare import compare_rows, in_turns

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.analysis import ScanAnalysis
    from prooflight.detectors.matched_filter.design import PreparedPage
    from prooflight.detectors.matched_filter.statistics.statistic import Observed
    from prooflight.press.artefact import Press

REPEATS: Final = 5
QUICK_MM, SIDE_MM = 40.0, 190.0
EVERY_OTHER: Final = slice(None, None, 2)


@kernel(
    "packed (_, W), quantised.codes (65536, 16), quantised.inner (_, 4), quantised.outer (_, 8), "
    "quantised.bits (4), level, out (P)",
    where="P <= W, P % 8 == 0",
)
def lookup_page(packed, quantised, level, out):  # type: ignore[no-untyped-def]
    """Look up each row by ``lookup_light``, as far as ``out`` goes."""
    for row in range(packed.shape[0]):
        lookup_light(packed[row, : out.size], quantised, level, out)


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedRow:
    """One timed step; speeds are medians of interleaved repeats."""

    name: str
    mpx_per_cpu_s: float
    """Megapixels a second of processor time, one core; of the raster in look-ups, of the camera elsewhere."""
    ratio: float
    """Speed of the first row of its group, ours, over this one; in growth, of this one over the first."""
    lowest_mpx_per_cpu_s: float
    highest_mpx_per_cpu_s: float


def bench_pages(press: Press, *, quick: bool) -> dict[str, Page]:
    """Return a page of bars like text, one of noisy gradients like a photograph, and one half each.

    They have the press's resolution.
    """
    side = round((QUICK_MM if quick else SIDE_MM) * press.supersampling / press.geometry.pixel_pitch_mm)
    rng = stream(None, "bench-page")
    bars = rng.random((side // 6 + 1, side // 24 + 1)) < 0.2
    bars[(np.arange(side // 6 + 1) % 6) > 2] = False  # space between lines of text
    text = np.zeros((side, side, 4), np.uint8)
    text[..., 3] = 255 * np.repeat(np.repeat(bars, 6, 0), 24, 1)[:side, :side]
    coarse = rng.integers(0, 256, (side // 64 + 2, side // 64 + 2, 4)).astype(np.float32)
    smooth = ndimage.zoom(coarse, (64, 64, 1), order=1)[:side, :side]
    photo = np.clip(smooth + rng.normal(0, 2, (side, side, 4)).astype(np.float32), 0, 255).astype(np.uint8)
    mixed = np.concatenate([text[: side // 2], photo[side // 2 :]])
    return {
        name: Page(cmyk=np.ascontiguousarray(cmyk), dpi=press.dpi, name=name, number=1)
        for name, cmyk in (("text", text), ("mixed", mixed), ("photo", photo))
    }


def bench(press: Press, *, quick: bool = False) -> list[SpeedRow]:
    """Time look-up, prediction, comparison, whole pages, and growth; on one core, but for the last group."""
    rows = []
    for name, page in bench_pages(press, quick=quick).items():
        rows += lookup_rows(name, page, press)
        rows += whole_rows(name, page, press)
        rows += _rows(detector_works(name, page, press))
    return rows + growth_rows(press, quick=quick) + detector_growth_rows(press, quick=quick)


def lookup_rows(name: str, page: Page, press: Press) -> list[SpeedRow]:
    """Time CMYK -> one sensor's mean by this package, lcms2 (Pillow) and scipy; all of every second node's table."""
    table = press.sensors[0].mean_dn
    small = table[EVERY_OTHER, EVERY_OTHER, EVERY_OTHER, EVERY_OTHER]
    height, width = page.cmyk.shape[:2]
    image = Image.frombuffer("CMYK", (width, height), page.cmyk.tobytes(), "raw", "CMYK", 0, 1)
    target, transform = Image.new("LAB", image.size), cmyk_to_lab(small / table.max())
    packed = page.cmyk.view(np.uint32)[:, :, 0]
    quantised, none = quantised_table(table), np.float32(0)
    out = np.empty(width // 8 * 8, np.float32)
    part = page.cmyk[: max(height // 8, 1)].reshape(-1, 4).T / np.float32(2 * NODE_STEP)

    def lookup() -> None:
        lookup_page(packed, quantised, none, out)

    size = packed.size / 1e6
    return _rows(
        {
            f"look-up, {name}": (lookup, height * out.size / 1e6),
            f"lcms2, {name}": (lambda: transform.apply(image, target), size),
            f"scipy map_coordinates, {name}": (
                lambda: ndimage.map_coordinates(small, part, order=1),
                part.shape[1] / 1e6,
            ),
        }
    )


def whole_rows(name: str, page: Page, press: Press) -> list[SpeedRow]:
    """Time prediction in place and moved, whole inspections, comparison and its baselines; ratios: to the first."""
    prediction = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    scan = ideal_scan(prediction, press, stream(None, "bench-scan"))
    size = scan.size / 1e6

    def predicted(placement: Placement = IN_PLACE) -> object:
        return predict(page, sensors=press.sensors, geometry=press.geometry, placement=placement, threads=1)

    works: dict[str, tuple[Callable[[], object], float]] = {
        f"predict, {name}": (predicted, size),
        f"predict moved, {name}": (lambda: predicted(placement=MOVED), size),
    }
    works |= inspections(name, page, press)
    if name == "text":
        alike = tuple(replace(press.sensors[0], name=str(number)) for number in range(2))
        works |= inspections(f"2 sensors, {name}", page, replace(press, sensors=alike, clipped=()))
        coarse = replace(press, supersampling=1)
        works |= inspections(f"s = 1, {name}", halved(page), coarse)
    rows = _rows(works)
    top_codes = [sensor.top_code_dn for sensor in press.sensors]
    compared = compare_rows(scan, prediction, top_codes_dn=top_codes, repeats=REPEATS)
    return rows + [
        SpeedRow(
            name=f"{row.name}, {name}",
            mpx_per_cpu_s=row.mpx_per_cpu_s,
            ratio=row.speed_ratio,
            lowest_mpx_per_cpu_s=row.lowest_mpx_per_cpu_s,
            highest_mpx_per_cpu_s=row.highest_mpx_per_cpu_s,
        )
        for row in compared
    ]


def inspections(name: str, page: Page, press: Press) -> dict[str, tuple[Callable[[], object], float]]:
    """Return whole inspections by the paper's detector, from raster and scan to a verdict; megapixels of all sensors.

    "shared": predicted and prepared before; "off its place": the page is displaced as prints of the press world are, so
    that its prediction is moved.
    """
    inspector = Inspector.of(press, "chi-square")
    prepared = inspector.prepare(page)
    scans = []
    for where in (IN_PLACE, MOVED):
        expected = predict(page, sensors=press.sensors, geometry=press.geometry, placement=where, threads=1)
        scans.append(ideal_scan(expected, press, stream(None, "bench-scan")))
    in_place, moved = scans
    size = in_place.size / 1e6
    return {
        f"whole page, {name}": (
            lambda: inspector.inspect(inspector.prepare(page), in_place, scan_name="bench"),
            size,
        ),
        f"whole page, shared, {name}": (
            lambda: inspector.inspect(prepared, in_place, scan_name="bench"),
            size,
        ),
        f"whole page off its place, shared, {name}": (
            lambda: inspector.inspect(prepared, moved, scan_name="bench"),
            size,
        ),
    }


def halved(page: Page) -> Page:
    """Return every other pixel of every other row, at half the resolution.

    It is the raster of a press with s = 1, from that of one with s = 2.
    """
    cmyk = np.ascontiguousarray(page.cmyk[EVERY_OTHER, EVERY_OTHER])
    return replace(page, cmyk=cmyk, dpi=page.dpi / 2)


def growth_rows(press: Press, *, quick: bool) -> list[SpeedRow]:
    """Time prediction of a mixed page as pages, sensors and raster grow; and on two cores, by the wall clock."""
    base = bench_pages(press, quick=quick)["mixed"]
    works: dict[str, tuple[Callable[[], object], float]] = {}

    def add(name: str, page: Page, of: Press, threads: int = 1) -> None:
        size = len(of.sensors) * of.geometry.lines(page.height_mm) * of.geometry.pixels / 1e6
        works[name] = (
            lambda: predict(page, sensors=of.sensors, geometry=of.geometry, threads=threads),
            size,
        )

    add("growth: as it is", base, press)
    for sensors in (2, 3):
        alike = tuple(replace(press.sensors[0], name=str(number)) for number in range(sensors))
        add(f"growth: {sensors} sensors", base, replace(press, sensors=alike, clipped=()))
    for s in (1, 3, 4):
        finer = replace(press, supersampling=s)
        add(f"growth: s = {s}", bench_pages(finer, quick=quick)["mixed"], finer)
    for times in () if quick else (4, 16):
        tall = np.concatenate([base.cmyk] * times)
        add(f"growth: {times} pages long", replace(base, cmyk=tall), press)
    rows = [replace(row, ratio=round(1 / row.ratio, 2)) for row in _rows(works)]
    works.clear()
    add("1 thread, by the wall", base, press)
    add("2 threads, by the wall", base, press, threads=2)
    by_wall = [replace(row, ratio=round(1 / row.ratio, 2)) for row in _rows(works, clock=time.perf_counter)]
    return rows + by_wall


def detector_growth_rows(press: Press, *, quick: bool) -> list[SpeedRow]:
    """Time the matched filter on a mixed page by size, sensors and raster, and on two cores by the wall clock."""
    base = bench_pages(press, quick=quick)["mixed"]
    grown: dict[str, tuple[Page, Press]] = {"as it is": (base, press)}
    for sensors in (2, 3):
        alike = tuple(replace(press.sensors[0], name=str(number)) for number in range(sensors))
        grown[f"{sensors} sensors"] = base, replace(press, sensors=alike, clipped=())
    for s in (1, 3, 4):
        finer = replace(press, supersampling=s)
        grown[f"s = {s}"] = bench_pages(finer, quick=quick)["mixed"], finer
    for times in () if quick else (0.5, 2, 4):
        rows = round(times * len(base.cmyk))
        tall = np.concatenate([base.cmyk] * max(round(times), 1))[:rows]
        grown[f"{times:g} pages long"] = replace(base, cmyk=np.ascontiguousarray(tall)), press
    timed = []
    for name, one in grown.items():  # one after the other, for a design of several pages takes a gigabyte
        timed += _rows(grown_works({name: one}))
    for threads in (1, 2):
        whole = {f"{threads} threads, by the wall": (base, press)}
        timed += _rows(grown_works(whole, threads=threads), clock=time.perf_counter)
    first = {look: next(row for row in timed if look in row.name).mpx_per_cpu_s for look in PASSES}
    return [
        replace(row, ratio=round(row.mpx_per_cpu_s / first[look], 2))
        for row in timed
        for look in PASSES
        if look in row.name
    ]


def _rows(
    works: Mapping[str, tuple[Callable[[], object], float]],
    *,
    clock: Callable[[], float] = time.process_time,
) -> list[SpeedRow]:
    """Time each function, given with its megapixels, in turns, after one turn that is not counted."""
    times = in_turns({name: work for name, (work, _) in works.items()}, REPEATS, clock=clock)
    speeds = {name: size / times[name] for name, (_, size) in works.items()}
    first = float(np.median(next(iter(speeds.values()))))
    return [
        SpeedRow(
            name=name,
            mpx_per_cpu_s=round(float(np.median(speed)), 1),
            ratio=round(first / float(np.median(speed)), 2),
            lowest_mpx_per_cpu_s=round(float(speed.min()), 1),
            highest_mpx_per_cpu_s=round(float(speed.max()), 1),
        )
        for name, speed in speeds.items()
    ]


# --- a CMYK profile made in memory, so that lcms2 looks up the same table as prediction ---

WHITE_D50: Final = (0.9642, 1.0, 0.8249)
LAB_WHITE: Final = 0xFF00
"""L* = 100 in a 16-bit table (ICC.1:2001-04, 6.5.9: ``lut16Type``, legacy encoding)."""


def cmyk_to_lab(lightness: NDArray[np.floating]) -> ImageCms.ImageCmsTransform:
    """Return Pillow's transform of CMYK to L*a*b* whose L* is a table (n, n, n, n) of 0..1 over the four inks."""
    profile = ImageCms.ImageCmsProfile(io.BytesIO(profile_bytes(lightness)))
    return ImageCms.buildTransform(profile, ImageCms.createProfile("LAB"), "CMYK", "LAB")


def profile_bytes(lightness: NDArray[np.floating]) -> bytes:
    """Return a minimal output profile (ICC.1:2001-04, 6.3.3): description, copyright, white, one table."""
    tags = {
        b"desc": b"desc" + bytes(4) + struct.pack(">I", 6) + b"table\0" + bytes(78),
        b"cprt": b"text" + bytes(4) + b"none\0",
        b"wtpt": b"XYZ " + bytes(4) + _fixed(*WHITE_D50),
        b"A2B0": _table(lightness),
    }
    first, index, body = 128 + 4 + 12 * len(tags), struct.pack(">I", len(tags)), b""
    for name, data in tags.items():
        index += name + struct.pack(">II", first + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    head = struct.pack(">I4sI4s4s4s", first + len(body), bytes(4), 0x02400000, b"prtr", b"CMYK", b"Lab ")
    head += struct.pack(">6H", 2001, 1, 1, 0, 0, 0) + b"acsp" + bytes(28) + _fixed(*WHITE_D50)
    return head + bytes(128 - len(head)) + index + body


def _fixed(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(value * 65536) for value in values))


def _table(lightness: NDArray[np.floating]) -> bytes:
    nodes = np.full((*lightness.shape, 3), 0x8000, ">u2")
    nodes[..., 0] = np.rint(np.clip(lightness, 0, 1) * LAB_WHITE)
    straight = struct.pack(">2H", 0, 65535)
    head = (
        b"mft2" + bytes(4) + struct.pack(">4B", 4, 3, len(lightness), 0) + _fixed(1, 0, 0, 0, 1, 0, 0, 0, 1)
    )
    return head + struct.pack(">2H", 2, 2) + 4 * straight + nodes.tobytes() + 3 * straight


# --- the matched filter: a design prepared, a scan analysed, its statistics, and all together ---

MOVED = Placement(shift_mm=(0.3, -0.2), skew_deg=0.05, stretch_percent=(0.02, -0.01))
"""Displacement of a page like those of prints of worlds.toml's press world."""


PASSES: Final = ("first look", "both looks")


def grown_works(
    pages: Mapping[str, tuple[Page, Press]], *, threads: int = 1
) -> dict[str, tuple[Callable[[], object], float]]:
    """Return the screening pass and both passes of pages on presses, by name; megapixels of all sensors together."""
    works: dict[str, tuple[Callable[[], object], float]] = {}
    for name, (page, press) in pages.items():
        scanned = _Scanned.of(page, press, threads=threads)
        size = len(press.sensors) * scanned.scan[0].size / 1e6
        works[f"matched filter, first look, {name}"] = scanned.at_first, size
        works[f"matched filter, both looks, {name}"] = scanned.at_both, size
    return works


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Scanned:
    """A prepared page with its scan."""

    design: PreparedPage
    scan: NDArray[np.uint16]
    threads: int

    @classmethod
    def of(cls, page: Page, press: Press, *, threads: int) -> _Scanned:
        sensors, geometry = press.sensors, press.geometry
        expected = predict(page, sensors=sensors, geometry=geometry, placement=MOVED)
        in_place = predict(page, sensors=sensors, geometry=geometry)
        design = prepare_page(page, in_place, sensors=sensors, geometry=geometry, fringes=True, glyphs=True)
        return cls(
            design=design, scan=ideal_scan(expected, press, stream(None, "bench-scan")), threads=threads
        )

    def at_first(self) -> tuple[ScanAnalysis, list[Observed]]:
        analysis = analyse(self.design, self.scan, analysed_modes=SCREEN_MODES, threads=self.threads)
        scatter = Scatter.white()
        return analysis, screen_statistics(
            analysis.sums, analysis.marks, analysis.fit, analysis.registration, scatter, threads=self.threads
        )

    def at_both(self) -> object:
        analysis, seen = self.at_first()
        whole = analysis.of_every_mode()
        return remaining_statistics(whole.sums, Scatter.white(), seen, threads=self.threads)


def detector_works(name: str, page: Page, press: Press) -> dict[str, tuple[Callable[[], object], float]]:
    """Return each step and its camera megapixels.

    "whole": from a scan to its statistics, of a prepared page or a fresh one. "First look": the screening pass, which
    every page gets; "both looks": with the full pass, which pages that are passed on get. Prediction includes planes'
    fringes, as a press does by default (``[inspection] fringes``), and glyphs are tested. A fresh design is also
    searched for codes, as ``Inspector.prepare`` does. The megapixels are those of one sensor, so that a second sensor's
    cost shows.
    """
    sensors, geometry = press.sensors, press.geometry
    expected = predict(page, sensors=sensors, geometry=geometry, placement=MOVED, threads=1)
    scan = ideal_scan(expected, press, stream(None, "bench-scan"))
    scatter = Scatter.white()

    def prepared() -> PreparedPage:
        planned = PlannedPage(page, press.press_context(1))
        page_codes(planned, sensors, geometry)
        return prepare_page(
            page, planned.expected, sensors=sensors, geometry=geometry, fringes=True, glyphs=True
        )

    def analysed(design: PreparedPage) -> ScanAnalysis:
        return analyse(design, scan, analysed_modes=SCREEN_MODES)

    def at_first(design: PreparedPage) -> ScanAnalysis:
        analysis = analysed(design)
        screen_statistics(analysis.sums, analysis.marks, analysis.fit, analysis.registration, scatter)
        return analysis

    def again(analysis: ScanAnalysis) -> object:
        return remaining_statistics(analysis.of_every_mode().sums, scatter, seen)

    own = prepared()
    once = analysed(own)
    seen = screen_statistics(once.sums, once.marks, once.fit, once.registration, scatter)
    size = scan[0].size / 1e6
    return {
        f"matched filter: whole, first look, {name}": (lambda: at_first(own), size),
        f"matched filter: whole, both looks, {name}": (lambda: again(at_first(own)), size),
        f"matched filter: whole, first look, fresh design, {name}": (lambda: at_first(prepared()), size),
        f"matched filter: prepare, {name}": (prepared, size),
        f"matched filter: registration, prediction and fit, {name}": (lambda: analysed(own), size),
        f"matched filter: second look, {name}": (lambda: again(once), size),
    }
