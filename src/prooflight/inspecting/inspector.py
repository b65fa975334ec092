"""One page and its scan -> one verdict."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from prooflight.comparing.evidence import BLOCK_PIXELS, TILE_PIXELS, Evidence, gather
from prooflight.deciding.chi_square import ChiSquare, tile_statistics
from prooflight.deciding.regions import BlockGrid, Findings, findings
from prooflight.deciding.verdict import Verdict
from prooflight.errors import RequestError, ScanError
from prooflight.inspecting.finding import find_page
from prooflight.predicting.predict import Prediction

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.deciding.verdict import Detector
    from prooflight.inspecting.finding import FoundPage
    from prooflight.pages.raster import Page
    from prooflight.press import Press

DETECTORS = ("chi-square",)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inspection:
    """A verdict and what it rests on; arrays cover the page's area of the scan."""

    verdict: Verdict
    prediction: Prediction
    measured_dn: NDArray[np.uint16]
    evidence: Evidence


def detector(name: str, press: Press) -> Detector:
    """The detector that users call ``name``, with this press's promise; RequestError if there is none."""
    if name != "chi-square":
        raise RequestError("detector", f"there is no {name!r}", remedy=f"choose of {', '.join(DETECTORS)}")
    return ChiSquare(
        good_pages_per_false_alarm=press.good_pages_per_false_alarm, misprint_rate=press.costs.misprint_rate
    )


def check_scan(name: str, scan: NDArray[np.uint16], page: Page, press: Press) -> None:
    """ScanError if a scan is not of this press's camera or ends before its page does."""
    sensors, lines, pixels = scan.shape
    if sensors != len(press.sensors) or pixels != press.geometry.pixels:
        what = f"is of {sensors} sensors x {pixels} pixels"
        remedy = f"press {press.name} has {len(press.sensors)} sensors x {press.geometry.pixels} pixels"
        raise ScanError(name, what, remedy=remedy)
    rows, _ = press.geometry.on_page(page.width_mm, page.height_mm)
    if lines < rows.stop:
        what = f"ends after {lines} lines, {lines * press.geometry.line_pitch_mm:.1f} mm"
        raise ScanError(name, what, remedy=f"page {page.number} needs {rows.stop} lines")


def inspect_page(
    page: Page, scan: NDArray[np.uint16], *, press: Press, judge: Detector, scan_name: str, seed: int = 0
) -> Inspection:
    """Find the page, predict it where it lies, compare, decide; ``page`` as it enters the press (``ScanGeometry.lay``).

    A scan that shows another page, or this one where no good print lies, is the misprint ``wrong-page``.
    scan (sensors, lines, pixels) [DN], named ``scan_name`` in errors. seed: of the randomised integral transform.
    ScanError: the scan does not fit press or page.
    """
    started = time.perf_counter()
    check_scan(scan_name, scan, page, press)
    found_page = find_page(page, scan, press)
    area = (slice(None), *found_page.area)
    prediction = found_page.prediction
    seen = Prediction(expected_dn=prediction.expected_dn[area], variance_dn2=prediction.variance_dn2[area])
    evidence = gather(
        scan[area],
        seen.expected_dn,
        seen.variance_dn2,
        top_codes_dn=[sensor.top_code_dn for sensor in press.sensors],
        seed=seed + page.number,
    )
    judgement = judge.judge(evidence)
    misprint = judgement.misprint or found_page.wrong_page
    found = Findings(regions=(), kind=None)
    if misprint:
        found = findings(_grid(page, press, evidence, found_page))
    stop = misprint and (found_page.wrong_page or press.costs.stopping_pays(judgement.probability))
    verdict = Verdict(
        page=page.name,
        verdict="misprint" if misprint else "good",
        action="stop" if stop else "accept",
        probability=judgement.probability,
        score=judgement.score,
        threshold=judgement.threshold,
        p_value=judgement.p_value,
        kind="wrong-page" if found_page.wrong_page else found.kind,
        regions=found.regions,
        shift_mm=found_page.shift_mm,
        milliseconds=round((time.perf_counter() - started) * 1e3, 1),
    )
    return Inspection(verdict=verdict, prediction=seen, measured_dn=scan[area], evidence=evidence)


def not_inspected(page_name: str) -> Verdict:
    """The verdict of a page that has no scan: it is passed on, and said so."""
    return Verdict(page=page_name, verdict="not-inspected", action="accept")


def _grid(page: Page, press: Press, evidence: Evidence, found: FoundPage) -> BlockGrid:
    """Blocks in millimetres on the page as printed, its shift taken off."""
    geometry = press.geometry
    lines, columns = found.area
    shift_x_mm, shift_y_mm = found.placement.shift_mm
    _, rows, across = evidence.block_z.shape
    width_mm = BLOCK_PIXELS * geometry.pixel_pitch_mm
    height_mm = BLOCK_PIXELS * geometry.line_pitch_mm
    ink = cv2.resize(page.cmyk, (across, rows), interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    return BlockGrid(
        z=evidence.block_z,
        tiles=tile_statistics(evidence),
        blocks_per_tile=TILE_PIXELS // BLOCK_PIXELS,
        ink=ink,
        left_mm=columns.start * geometry.pixel_pitch_mm - geometry.left_mm(page.width_mm) - shift_x_mm,
        top_mm=lines.start * geometry.line_pitch_mm - geometry.lead_in_mm - shift_y_mm,
        width_mm=width_mm,
        height_mm=height_mm,
    )
