"""Reading and grading of a page's codes in its scan, and their effect on the verdict.

Grades are in the manner of ISO/IEC 15416 (bars) and ISO/IEC 15415 (squares), and not those of a verifier: light,
aperture and angle are the camera's, and reflectance is taken with bare paper as 1. The reference for an element is the
camera's prediction of it, not the symbology's nominal widths: a lens that blurs all codes alike costs no grade but
contrast and modulation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.verdict import Code, Region, Verdict
from prooflight.inspection.codes.symbols import (
    SAMPLES_A_PIXEL,
    Profile,
    Symbol,
    cut_elements,
    grey,
    paper_light,
    sampled,
    scan_lines,
    tried,
)

if TYPE_CHECKING:
    from prooflight.detectors.base import Area, Inspection
    from prooflight.inspection.codes.finding import PageCode
    from prooflight.pages.raster import Page
    from prooflight.prediction.tables import SensorModel
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.placement import Placement
    from prooflight.scans.scan import Scan

KIND: Final = "code"
"""Kind of a misprint that is one because a code does not read."""
SHOWN: Final = 24
"""Number of characters of a code's text in a sentence."""
LOST: Final = "lost lines"
"""Reason why a code has no grade where lines were lost, and is not required to read."""
NOT_SCORED: Final = 0.0
"""Score of a region that no statistic detected."""


def with_codes(
    done: Inspection,
    codes: Sequence[PageCode],
    scan: Scan,
    *,
    page: Page,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
) -> Inspection:
    """Return an inspection with the results of the page's codes.

    A good page with a code that does not read, or reads otherwise, becomes a misprint. Where the page was not
    inspected or is another one, its codes are not read. A code on which lines were lost is good if it reads,
    and no evidence if not.
    """
    if done.verdict.verdict == "not-inspected" or done.verdict.kind == "wrong-page":
        return done
    areas = _areas(codes, scan.dn, done.placement, page=page, geometry=geometry)
    cuts, lost = [paper_light(scan.dn[:, *area], sensors, area[1]) for area in areas], scan.lost
    read = [_read(code, light) for code, light in zip(codes, cuts, strict=True)]
    if lost is not None:
        lines_lost = [bool(lost[:, lines].any()) for lines, _ in areas]
        read = [
            _of_rest(code) if incomplete else code for code, incomplete in zip(read, lines_lost, strict=True)
        ]
    failed = [at for at, code in enumerate(read) if code.failed]
    evidence = {
        name: array
        for count, at in enumerate(failed)
        for name, array in _evidence(count, codes[at], cuts[at]).items()
    }
    verdict = _verdict(done.verdict, read, [read[at] for at in failed])
    return replace(done, verdict=verdict, stored_arrays={**done.stored_arrays, **evidence})


def read_codes(
    codes: Sequence[PageCode],
    dn: NDArray[np.uint16],
    placement: Placement,
    *,
    page: Page,
    sensors: Sequence[SensorModel],
    geometry: ScanGeometry,
) -> tuple[Code, ...]:
    """Read a page's codes in its scan (sensors, lines, pixels) [DN], displaced by ``placement``."""
    areas = _areas(codes, dn, placement, page=page, geometry=geometry)
    return tuple(
        _read(code, paper_light(dn[:, *area], sensors, area[1]))
        for code, area in zip(codes, areas, strict=True)
    )


def failed_again(stored: Mapping[str, NDArray[Any]]) -> bool:
    """Return whether a code that did not read does not read now either, from the stored pictures."""
    count = 0
    while (picture := stored.get(f"code{count}")) is not None:
        text, symbology = (
            bytes(np.asarray(stored[f"code{count}_{what}"], np.uint8)).decode()
            for what in ("text", "symbology")
        )
        if not any(one.text == text for one in tried(np.asarray(picture, np.uint8), symbology)):
            return True
        count += 1
    return False


def _evidence(count: int, code: PageCode, light: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
    """Return the arrays that ``failed_again`` needs of one code."""
    text, symbology = code.symbol.text.encode(), code.symbol.symbology.encode()
    return {
        f"code{count}": grey(light),
        f"code{count}_text": np.frombuffer(text, np.uint8),
        f"code{count}_symbology": np.frombuffer(symbology, np.uint8),
    }


def _areas(
    codes: Sequence[PageCode],
    dn: NDArray[np.uint16],
    placement: Placement,
    *,
    page: Page,
    geometry: ScanGeometry,
) -> list[Area]:
    """Return the area of every code and its quiet zone in a scan of a page at this placement."""
    x, y, width, height = np.array([code.box_mm for code in codes]).reshape(-1, 4).T
    x, y = x + width / 2, y + height / 2
    shown_x, shown_y = placement.seen_mm(x, y, page_width_mm=page.width_mm, page_height_mm=page.height_mm)
    shifts = (y - shown_y) / geometry.line_pitch_mm, (x - shown_x) / geometry.pixel_pitch_mm
    return [
        _area(code, dn.shape[1:], (float(down), float(right)))
        for code, down, right in zip(codes, *shifts, strict=True)
    ]


def _area(code: PageCode, scanned: tuple[int, ...], shift: tuple[float, float]) -> Area:
    """Return a code's area in a scan of the given lines and pixels; lines that it lacks are left out."""
    size, extent = np.array(code.light.shape), np.array(scanned)
    first = np.clip(np.rint(np.array(code.corner) + shift).astype(int), 0, extent - 1)
    last = np.clip(first + size, first + 1, extent)
    return slice(int(first[0]), int(last[0])), slice(int(first[1]), int(last[1]))


def _read(code: PageCode, light: NDArray[np.float32]) -> Code:
    symbol = code.symbol
    right: Symbol | None = None
    other: str | None = None
    for one in tried(grey(light), symbol.symbology, along_lines=symbol.along_lines):
        if one.text == symbol.text:
            right = one
            break
        other = one.text if other is None else other
    text = symbol.text if right is not None else other
    return _code(code, text, graded(code, light, right))


def _of_rest(code: Code) -> Code:
    """Return a code on which lines were lost, as it was read without them."""
    return replace(code, checked=code.checked and code.read == code.text, grade=None, weakest=LOST)


def foretold(code: PageCode) -> Code:
    """Return a code as the best print would show it through this camera."""
    return _code(code, code.symbol.text, graded(code, code.light, code.symbol))


def _code(code: PageCode, read: str | None, grade: tuple[float | None, str]) -> Code:
    x, y, width, height = (round(extent, 2) for extent in code.box_mm)
    return Code(
        symbology=code.symbol.symbology,
        text=code.symbol.text,
        read=read,
        checked=code.sure,
        grade=grade[0],
        weakest=grade[1],
        x_mm=x,
        y_mm=y,
        width_mm=width,
        height_mm=height,
    )


def _verdict(verdict: Verdict, read: Sequence[Code], failed: Sequence[Code]) -> Verdict:
    if not failed:
        return replace(verdict, codes=tuple(read))
    regions = tuple(
        Region.rounded((code.x_mm, code.y_mm, code.width_mm, code.height_mm), score=NOT_SCORED, kind=KIND)
        for code in failed
    )
    if verdict.verdict == "misprint":
        return replace(verdict, codes=tuple(read), regions=verdict.regions + regions)
    why = "; ".join(fault_of(code) for code in failed)
    return replace(
        verdict,
        verdict="misprint",
        stopping_costs_more=False,
        kind=KIND,
        reason=why,
        codes=tuple(read),
        regions=regions,
    )


def fault_of(code: Code) -> str:
    """Describe what is wrong with a code."""
    text = code.text if len(code.text) <= SHOWN else f"{code.text[: SHOWN - 3]}..."
    where = f"{code.symbology} {text!r} at x = {code.x_mm:.0f} mm, y = {code.y_mm:.0f} mm"
    return f"{where} does not read" if code.read is None else f"{where} reads {code.read[:SHOWN]!r}"


CONTRAST: Final = (0.70, 0.55, 0.40, 0.20)
"""Least symbol contrast of grades 4, 3, 2, 1 (ISO/IEC 15416, table 1; ISO/IEC 15415, table 3)."""
MODULATION: Final = (0.70, 0.60, 0.50, 0.40)
"""Least modulation of grades 4, 3, 2, 1 (ISO/IEC 15416, table 1)."""
SQUARE_MODULATION: Final = (0.50, 0.40, 0.30, 0.20)
"""Least modulation of a matrix code (ISO/IEC 15415, table 4)."""
DEFECTS: Final = (0.15, 0.20, 0.25, 0.30)
"""Greatest defects of grades 4, 3, 2, 1 (ISO/IEC 15416, table 1)."""
DECODABILITY: Final = (0.62, 0.50, 0.37, 0.25)
"""Least decodability (ISO/IEC 15416, table 1).

Unused error correction has the same limits (ISO/IEC 15415, table 8).
"""
NONUNIFORMITY: Final = (0.06, 0.08, 0.10, 0.12)
"""Greatest axial nonuniformity (ISO/IEC 15415, table 6)."""
LEAST_EDGE_CONTRAST: Final = 0.15
GREATEST_DARK: Final = 0.5
"""Greatest light of the darkest element, as a share of the lightest."""
LETTERS: Final = ((3.5, "A"), (2.5, "B"), (1.5, "C"), (0.5, "D"))


def letter(grade: float) -> str:
    """Return a mean grade as a letter (ISO/IEC 15416, 6.2).

    >>> letter(3.7), letter(1.5), letter(0.2)
    ('A', 'C', 'F')
    """
    return next((name for least, name in LETTERS if grade >= least), "F")


def graded(code: PageCode, light: NDArray[np.float32], read: Symbol | None) -> tuple[float | None, str]:
    """Grade a code in its cut of a scan (lines, columns), bare paper 1, from 0 to 4, and name the weakest parameter.

    read: the code that was read there; None: none was, which is grade 0. The grade is None for a symbology
    with neither bars nor squares whose number is known.
    """
    if read is None:
        return 0.0, "does not read"
    if code.symbol.linear:
        return _bars(code, light, read)
    if code.symbol.modules is not None:
        return _squares(code, light, read)
    return None, ""


def level(value: float, limits: tuple[float, ...], *, falling: bool = False) -> int:
    """Grade a value by its limits of grades 4 to 1; falling: by greatest limits, else by least ones.

    >>> level(0.6, CONTRAST), level(0.17, DEFECTS, falling=True)
    (3, 3)
    """
    for grade, limit in zip((4, 3, 2, 1), limits, strict=True):
        if value <= limit if falling else value >= limit:
            return grade
    return 0


def _bars(code: PageCode, light: NDArray[np.float32], read: Symbol) -> tuple[float, str]:
    """Return the mean of the scan lines' grades, and the parameter that is most often the least."""
    grades: list[int] = []
    blamed: list[str] = []
    lines = scan_lines(light, read)
    highest, lowest = lines.max(axis=1), lines.min(axis=1)
    cut = cut_elements(lines, 1 / SAMPLES_A_PIXEL)
    for high, low, seen, wanted in zip(highest, lowest, cut, code.profiles, strict=True):
        parts = _bar_parts(float(high), float(low), seen, wanted)
        weakest = min(parts, key=lambda name: parts[name])
        grades.append(parts[weakest])
        blamed.append(weakest)
    grade = float(np.mean(grades))
    weak = [name for name, got in zip(blamed, grades, strict=True) if got < 4]
    return round(grade, 1), max(dict.fromkeys(weak), key=weak.count) if weak else ""


def _bar_parts(high: float, low: float, seen: Profile | None, wanted: Profile | None) -> Mapping[str, int]:
    """Grade one scan line by parameter; high, low: the greatest and the least light on it."""
    contrast = high - low
    parts = {
        "symbol contrast": level(contrast, CONTRAST),
        "minimum reflectance": 4 if low <= GREATEST_DARK * high else 0,
    }
    if seen is None or wanted is None or seen.edges.size != wanted.edges.size:
        return parts | {"edges": 0}
    edge = float(np.abs(np.diff(seen.peaks)).min())
    parts["edge contrast"] = 4 if edge >= LEAST_EDGE_CONTRAST else 0
    parts["modulation"] = level(edge / contrast, MODULATION)
    parts["defects"] = level(float(seen.defects.max()) / contrast, DEFECTS, falling=True)
    parts["decodability"] = level(decodability(seen.edges, wanted.edges), DECODABILITY)
    return parts


def decodability(edges: NDArray[np.float64], nominal: NDArray[np.float64]) -> float:
    """Return 1 less the greatest error of an element's width in halves of the narrowest, at the scale that fits best.

    edges, nominal: (n,) [pixel]. In the manner of ISO/IEC 15416, 5.4.6, which takes the symbology's own
    decision widths; an element that is wrong by half the narrowest may be taken for its neighbour in any.
    """
    widths, wanted = np.diff(edges), np.diff(nominal)
    scale = (nominal[-1] - nominal[0]) / (edges[-1] - edges[0])
    worst = float(np.abs(widths * scale - wanted).max())
    return max(0.0, 1 - worst / (float(wanted.min()) / 2))


def _squares(code: PageCode, light: NDArray[np.float32], read: Symbol) -> tuple[float, str]:
    """Return the least of the parameters' grades, and that parameter (ISO/IEC 15415, 7)."""
    modules = code.symbol.modules
    assert modules is not None
    seen, should = (_centres(cut, one, modules) for cut, one in ((light, read), (code.light, code.symbol)))
    contrast = float(np.percentile(seen, 95) - np.percentile(seen, 5))
    threshold = (np.percentile(seen, 95) + np.percentile(seen, 5)) / 2
    dark = should < (should.max() + should.min()) / 2
    right = dark == (seen < threshold)
    swing = np.where(right, 2 * np.abs(seen - threshold) / max(contrast, 1e-6), 0.0)
    corners = np.array(read.corners)
    across = np.hypot(*(corners[1] - corners[0])) / modules[1]
    along = np.hypot(*(corners[3] - corners[0])) / modules[0]
    parts = {
        "symbol contrast": level(contrast, CONTRAST),
        "modulation": level(float(np.percentile(swing, 5)), SQUARE_MODULATION),
        "axial nonuniformity": level(
            float(abs(across - along) / ((across + along) / 2)), NONUNIFORMITY, falling=True
        ),
    }
    if read.unused_correction is not None:
        parts["unused error correction"] = level(read.unused_correction, DECODABILITY)
    weakest = min(parts, key=lambda name: parts[name])
    return float(parts[weakest]), weakest if parts[weakest] < 4 else ""


def _centres(light: NDArray[np.float32], symbol: Symbol, modules: tuple[int, int]) -> NDArray[np.float64]:
    """Return the light at the middle of every module (rows, columns)."""
    rows, columns = modules
    corners = np.array(symbol.corners, np.float32)
    ends = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)], np.float32)
    to_pixels = cv2.getPerspectiveTransform(ends, corners)
    grid = np.stack(np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5), axis=-1)
    points = cv2.perspectiveTransform(grid.reshape(1, -1, 2).astype(np.float32), to_pixels)
    x, y = points.reshape(rows, columns, 2).transpose(2, 0, 1)
    return sampled(light, x, y)
