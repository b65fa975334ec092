"""Reading and grading of a page's codes in its scan, and their effect on the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.verdict import Code, Region, Verdict
from prooflight.inspection.codes.grading import graded
from prooflight.inspection.codes.symbols import Symbol, grey, paper_light, tried

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
