"""Pages and their scans -> verdicts; what needs no scan is done ahead."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from prooflight.detectors.base import Verdict
from prooflight.detectors.matched_filter.analysis import prepare_page
from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
from prooflight.detectors.matched_filter.fit.nuisance import Tolerance
from prooflight.detectors.paper.chi_square import ChiSquare, tile_statistics
from prooflight.detectors.paper.evidence import BLOCK_PIXELS, TILE_PIXELS, gather
from prooflight.detectors.paper.regions import BlockGrid, Findings, findings
from prooflight.errors import RequestError, ScanError
from prooflight.inspection.finding import SoughtPage, find
from prooflight.inspection.inspection import Inspection, Prepared, pictured, present_inks
from prooflight.inspection.light import light_tolerance, wrong_light
from prooflight.inspection.light_level import light_levels, lit_squares
from prooflight.inspection.weighing import weigh
from prooflight.kernels.block_inks import INKS, block_inks
from prooflight.prediction.predict import cut, predict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.paper.evidence import Evidence, EvidenceDetector
    from prooflight.inspection.finding import FoundPage
    from prooflight.pages.raster import Page
    from prooflight.prediction.predict import Prediction
    from prooflight.press.artefact import Press

    Judge = EvidenceDetector | CalibratedDetector

PIXELS_A_BLOCK: Final = 4
"""Of the raster, either way, that say how much ink is in a block."""
DETECTORS = ("chi-square", "ours", "bayes")


def detector(name: str | None, press: Press) -> Judge:
    """The detector that users call ``name``, with this press's promise; None: ours if this press was taught it.

    RequestError: there is no such detector, or this press was not taught it.
    """
    if name is None:
        name = "chi-square" if press.ours is None else "ours"
    if name not in DETECTORS:
        raise RequestError("detector", f"there is no {name!r}", remedy=f"choose of {', '.join(DETECTORS)}")
    if name == "chi-square":
        return ChiSquare(
            good_pages_per_false_alarm=press.good_pages_per_false_alarm,
            misprint_rate=press.costs.misprint_rate,
        )
    taught = press.ours if name == "ours" else press.bayes
    if taught is None:
        what = f"press {press.name} was not taught {name!r}"
        remedy = "build it with `prooflight press build --detector quick`, or choose chi-square"
        raise RequestError("detector", what, remedy=remedy)
    return taught


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspector:
    """A press with a detector; small and picklable."""

    press: Press
    judge: Judge
    threads: int | None = None
    """That one page takes; None: one a core."""

    def __post_init__(self) -> None:
        """PressError: the press, or its light as it has been followed, holds what none may."""
        _sound(self.press)

    @classmethod
    def of(cls, press: Press, name: str | None = None) -> Self:
        """With the detector that users call ``name``; see ``detector``."""
        return cls(press=press, judge=detector(name, press))

    @property
    def promise(self) -> str:
        """How rarely a good page alarms, and on what that rests, in words."""
        if isinstance(self.judge, CalibratedDetector):
            return str(self.judge.promise)
        if isinstance(self.judge, ChiSquare):
            odds = f"{self.judge.good_pages_per_false_alarm:,.0f}"
            return f"at most one good page in {odds} alarms, if it differs by sensor noise alone"
        return "none: a page alarms where stopping costs less than letting pass"

    def prepare(self, page: Page) -> Prepared:
        """All that can be known of a page, as it enters the press (``ScanGeometry.lay``), ahead of its scans."""
        sensors, geometry = self.press.sensors, self.press.geometry
        sought = known = None
        if isinstance(self.judge, CalibratedDetector):
            expected = predict(page, sensors=sensors, geometry=geometry, threads=self.threads)
            known = prepare_page(
                page,
                expected,
                sensors=sensors,
                geometry=geometry,
                fringes=self.press.fringes,
                tolerance=self.judge.tolerance.prior,
            )
        else:
            sought = SoughtPage.of(page, self.press, threads=self.threads)
            expected = sought.nominal
        lit = lit_squares(expected, page, sensors=sensors, geometry=geometry)
        return Prepared(page=page, sought=sought, known=known, inks=present_inks(page), lit=lit)

    def inspect(
        self, prepared: Prepared, scan: NDArray[np.uint16], *, scan_name: str, seed: int = 0
    ) -> Inspection:
        """Find the page, compare, decide.

        A scan that shows another page, or this one where no good print lies, is the misprint ``wrong-page``. One made
        under light that the press was not calibrated for is not inspected: what its detector promises is void then.
        scan (sensors, lines, pixels) [DN], named ``scan_name`` in errors. seed: of the randomised integral transform
        of the paper's detectors. ScanError: the scan does not fit press or page.
        """
        started = time.perf_counter()
        scan = judged_lines(scan_name, scan, prepared.page, self.press)
        if isinstance(self.judge, CalibratedDetector):
            done = weigh(prepared, scan, press=self.press, ours=self.judge)
        else:
            done = _compared(self, self.judge, prepared, scan, seed=seed)
        done = replace(done, verdict=self._under_its_light(done.verdict, prepared, scan))
        milliseconds = round((time.perf_counter() - started) * 1e3, 1)
        return replace(done, verdict=replace(done.verdict, milliseconds=milliseconds))

    def _under_its_light(self, verdict: Verdict, prepared: Prepared, scan: NDArray[np.uint16]) -> Verdict:
        """The verdict, or why there is none."""
        sensors, ours = self.press.sensors, self.press.ours
        wrong = wrong_light(
            light_levels(prepared.lit, scan, sensors),
            sensors,
            tolerance=light_tolerance(Tolerance() if ours is None else ours.tolerance.prior),
        )
        if wrong is None or (wrong.of_sheet and verdict.verdict == "misprint"):
            return verdict
        return replace(
            not_inspected(verdict.page),
            shift_mm=verdict.shift_mm,
            detector=verdict.detector,
            reason=wrong.reason,
        )


@lru_cache(maxsize=2)
def _sound(press: Press) -> None:
    press.check()


def inspect_page(
    page: Page, scan: NDArray[np.uint16], *, press: Press, judge: Judge, scan_name: str, seed: int = 0
) -> Inspection:
    """``Inspector.prepare`` and ``inspect`` of one page and one scan, with all that pictures need."""
    inspector = Inspector(press=press, judge=judge)
    done = inspector.inspect(inspector.prepare(page), scan, scan_name=scan_name, seed=seed)
    return pictured(done, page, press)


def paper_evidence(page: Page, scan: NDArray[np.uint16], press: Press) -> Evidence:
    """What the paper's detectors look at in one scan of a page."""
    scan = judged_lines("scan", scan, page, press)
    found_page = find(SoughtPage.of(page, press), scan, press)
    return _gathered(scan, found_page, page, press, seed=0, threads=None)[1]


def judged_lines(name: str, scan: NDArray[np.uint16], page: Page, press: Press) -> NDArray[np.uint16]:
    """The lines of a scan (sensors, lines, pixels) that are looked at: no more than scans of such a page have.

    It may have fewer if it holds the page in its place; what it lacks is unknown to all that follows. ScanError: it is
    not of this press's camera, or ends before its page does.
    """
    sensors, lines, pixels = scan.shape
    if sensors != len(press.sensors) or pixels != press.geometry.pixels:
        what = f"is of {sensors} sensors x {pixels} pixels"
        remedy = f"press {press.name} has {len(press.sensors)} sensors x {press.geometry.pixels} pixels"
        raise ScanError(name, what, remedy=remedy)
    rows, _ = press.geometry.on_page(page.width_mm, page.height_mm)
    if lines < rows.stop:
        what = f"ends after {lines} lines, {lines * press.geometry.line_pitch_mm:.1f} mm"
        raise ScanError(name, what, remedy=f"page {page.number} needs {rows.stop} lines")
    return scan[:, : press.geometry.lines(page.height_mm)]


def not_inspected(page_name: str, reason: str = "") -> Verdict:
    """The verdict of a page that nobody looked at: it is passed on, and said so, and why."""
    return Verdict.passed(page_name, reason)


def _compared(
    inspector: Inspector, judge: EvidenceDetector, prepared: Prepared, scan: NDArray[np.uint16], *, seed: int
) -> Inspection:
    """One scan under the paper's detectors."""
    assert prepared.sought is not None
    page, press, threads = prepared.page, inspector.press, inspector.threads
    found_page = find(prepared.sought, scan, press, threads=threads)
    seen, evidence = _gathered(scan, found_page, page, press, seed=seed, threads=threads)
    judgement = judge.judge(evidence)
    wrong = found_page.wrong_page
    judgement = replace(judgement, misprint=judgement.misprint or wrong)
    found = Findings(regions=(), kind=None)
    if judgement.misprint:
        found = findings(_grid(page, press, evidence, found_page))
    verdict = Verdict.judged(
        page.name,
        judgement,
        costs=press.costs,
        surely=wrong,
        kind="wrong-page" if wrong else found.kind,
        regions=found.regions,
        shift_mm=found_page.shift_mm,
        detector=judge.name,
        reason=found_page.reason,
    )
    return Inspection(
        verdict=verdict,
        placement=found_page.placement,
        area=found_page.area,
        measured_dn=scan[(slice(None), *found_page.area)],
        block_z=evidence.block_z,
        prediction=seen,
        evidence=evidence,
    )


def _gathered(
    scan: NDArray[np.uint16],
    found_page: FoundPage,
    page: Page,
    press: Press,
    *,
    seed: int,
    threads: int | None,
) -> tuple[Prediction, Evidence]:
    """The prediction of the area that is judged, and the evidence there."""
    seen = cut(found_page.prediction, found_page.area)
    measured, seed = scan[(slice(None), *found_page.area)], seed + page.number
    top_codes = [sensor.top_code_dn for sensor in press.sensors]
    expected, variance = seen.expected_dn, seen.variance_dn2
    return seen, gather(measured, expected, variance, top_codes_dn=top_codes, seed=seed, threads=threads)


def _grid(page: Page, press: Press, evidence: Evidence, found: FoundPage) -> BlockGrid:
    """Blocks in millimetres on the page as printed, its shift taken off."""
    geometry = press.geometry
    lines, columns = found.area
    shift_x_mm, shift_y_mm = found.placement.shift_mm
    _, rows, across = evidence.block_z.shape
    width_mm = BLOCK_PIXELS * geometry.pixel_pitch_mm
    height_mm = BLOCK_PIXELS * geometry.line_pitch_mm
    return BlockGrid(
        z=evidence.block_z,
        tiles=tile_statistics(evidence),
        blocks_per_tile=TILE_PIXELS // BLOCK_PIXELS,
        ink=cache(partial(_ink, page, rows, across)),
        left_mm=columns.start * geometry.pixel_pitch_mm - geometry.left_mm(page.width_mm) - shift_x_mm,
        top_mm=lines.start * geometry.line_pitch_mm - geometry.lead_in_mm - shift_y_mm,
        width_mm=width_mm,
        height_mm=height_mm,
    )


def _ink(page: Page, rows: int, across: int) -> NDArray[np.float32]:
    """Mean ink fractions of (rows, across) blocks that share the page evenly, (rows, across, 4).

    A few pixels of each block do: to read all would take as long as the rest of the inspection.
    """
    words = page.words
    lines, columns = (
        np.arange(PIXELS_A_BLOCK * blocks) * size // (PIXELS_A_BLOCK * blocks)
        for blocks, size in zip((rows, across), words.shape, strict=True)
    )
    ink = np.zeros((rows, across, INKS), np.float32)
    block_inks(words, lines.reshape(rows, -1), columns.reshape(across, -1), ink)
    return ink
