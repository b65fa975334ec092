"""The paper's detectors on a press: register a page, predict it there, compare pixel by pixel, decide."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.detectors.base import (
    BLOCK_PIXELS,
    LAMP_WAVES,
    ContextDetector,
    Inspection,
    PlannedPage,
    PressContext,
    PrintState,
    StoredArrays,
)
from prooflight.detectors.paper.chi_square import tile_statistics
from prooflight.detectors.paper.evidence import TILE_PIXELS, Evidence, EvidenceDetector, gather
from prooflight.detectors.paper.finding import BlockGrid, Findings, PlacedPage, SoughtPage, find, findings
from prooflight.detectors.placing import WRONG_PAGE_KIND
from prooflight.detectors.verdict import Decision, Verdict
from prooflight.kernels.comparison.page_sums import block_inks, column_sums
from prooflight.pages.parallel import shared_out
from prooflight.prediction.predict import Prediction, cut

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.scan import Scan

PIXELS_A_BLOCK: Final = 4
"""Raster pixels per block and axis from which a block's ink is computed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperDetector(ContextDetector):
    """Detector that tests the error's histograms or block means by one of the paper's tests."""

    test: EvidenceDetector

    @property
    def name(self) -> str:
        """See ``Detector``."""
        return self.test.name

    @property
    def guarantee(self) -> str:
        """See ``Detector``."""
        return self.test.guarantee

    @property
    def false_alarm_rate(self) -> float | None:
        """See ``Detector``."""
        return self.test.false_alarm_rate

    def prepare(self, planned: PlannedPage) -> PaperPage:
        """See ``Detector``."""
        return PaperPage(detector=self, sought=SoughtPage.of(planned))

    def decided_again(self, stored: StoredArrays) -> Decision:
        """See ``Detector``."""
        with np.errstate(all="ignore"):  # the caller checks results that are not finite
            return self.test.decide(self.test.evidence_of(stored, sensors=len(self.press_context.sensors)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PaperPage:
    """A page predicted in its nominal place, with the landmarks of its design."""

    detector: PaperDetector
    sought: SoughtPage

    def under(self, press_context: PressContext) -> PaperPage:
        """See ``PreparedPage``; cheap, because landmarks stay."""
        return PaperPage(detector=self.detector.at(press_context), sought=self.sought.relit(press_context))

    def inspect(self, scan: Scan, *, seed: int = 0) -> Inspection:
        """See ``PreparedPage``; seed: of the randomised integral transform."""
        page, press_context, test = self.sought.page, self.detector.press_context, self.detector.test
        placed = find(self.sought, scan.dn, press_context)
        seen, measured = cut(placed.prediction, placed.area), scan.dn[:, *placed.area]
        evidence = _gathered(measured, seen, press_context, seed=seed + page.number)
        decision, wrong = test.decide(evidence), placed.wrong_page
        decision = replace(decision, misprint=decision.misprint or wrong)
        result = Findings(regions=(), kind=None)
        if decision.misprint:
            result = findings(_grid(page, press_context.geometry, evidence, placed))
        verdict = Verdict.from_decision(
            page.name,
            decision,
            costs=press_context.costs,
            always_stop=wrong,
            kind=WRONG_PAGE_KIND if wrong else result.kind,
            regions=result.regions,
            shift_mm=placed.shift_mm,
            detector=test.name,
            reason=placed.reason,
        )
        if placed.unplaced:
            verdict = Verdict.skipped(page.name, placed.unplaced, detector=test.name)
        return Inspection(
            verdict=verdict,
            placement=placed.placement,
            area=placed.area,
            measured_dn=measured,
            block_z=evidence.block_z,
            expect=lambda: seen,
            stored_arrays={
                "wrong_page": np.array(verdict.kind == WRONG_PAGE_KIND),
                **test.stored_arrays(evidence),
            },
            state=partial(print_state, measured, seen.expected_dn, placed.area[1], press_context),
        )


def page_evidence(page: Page, scan_dn: NDArray[np.uint16], press_context: PressContext) -> Evidence:
    """Return the evidence of the paper's detectors from one scan (sensors, lines, pixels) of a page."""
    placed = find(SoughtPage.of(PlannedPage(page, press_context)), scan_dn, press_context)
    seen, measured = cut(placed.prediction, placed.area), scan_dn[:, *placed.area]
    return _gathered(measured, seen, press_context, seed=page.number)


def _gathered(
    measured: NDArray[np.uint16], seen: Prediction, press_context: PressContext, *, seed: int
) -> Evidence:
    return gather(
        measured,
        seen.expected_dn,
        seen.variance_dn2,
        top_codes_dn=[sensor.top_code_dn for sensor in press_context.sensors],
        seed=seed,
        threads=press_context.threads,
    )


def _grid(page: Page, geometry: ScanGeometry, evidence: Evidence, placed: PlacedPage) -> BlockGrid:
    """Return the blocks in millimetres on the page as printed, without its shift."""
    lines, columns = placed.area
    shift_x_mm, shift_y_mm = placed.placement.shift_mm
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
    """Return mean ink fractions of (rows, across) blocks that divide the page evenly, (rows, across, 4).

    A few pixels of each block suffice: reading all would take as long as the rest of the inspection.
    """
    packed = page.packed
    lines, columns = (
        np.arange(PIXELS_A_BLOCK * blocks) * size // (PIXELS_A_BLOCK * blocks)
        for blocks, size in zip((rows, across), packed.shape, strict=True)
    )
    ink = np.zeros((rows, across, INKS), np.float32)
    block_inks(packed, lines.reshape(rows, -1), columns.reshape(across, -1), ink)
    return ink


PARTS: Final = 8
"""Number of parts of a page's height: a column's value is their median, so that no local misprint makes a
streak."""


def print_state(
    measured_dn: NDArray[np.uint16],
    expected_dn: NDArray[np.float32],
    part: slice,
    press_context: PressContext,
) -> PrintState:
    """Return the state of measured and expected lines (sensors, lines, columns) [DN].

    part: their columns in the field.
    """
    of_sensors = light_sums(measured_dn, expected_dn, part, press_context)
    pixels = press_context.geometry.pixels
    amounts = lamp_waves(of_sensors.sum(axis=0), part, pixels)
    for sensor, (over, whole) in zip(press_context.sensors, of_sensors, strict=True):
        amounts[f"light-{sensor.name}"] = float(np.median(over.sum(axis=0) / whole.sum(axis=0)))
    excess, light = (np.zeros((PARTS, pixels)) for _ in "el")
    excess[:, part], light[:, part] = of_sensors.sum(axis=0)
    return PrintState(
        amounts=amounts, excess=excess, light=light, pitch_mm=press_context.geometry.pixel_pitch_mm
    )


def light_sums(
    measured: NDArray[np.uint16], expected: NDArray[np.float32], part: slice, press_context: PressContext
) -> NDArray[np.float64]:
    """Return light minus expected light, and expected light, summed down the columns of an area.

    (sensors, 2, PARTS, columns of the area) [DN]
    """
    bounds = np.arange(PARTS + 1) * measured.shape[1] // PARTS
    sums = np.empty((len(press_context.sensors), 2, PARTS, measured.shape[2]))

    def add(index: int, share: int, first: int, last: int) -> None:
        offset = press_context.sensors[index].column_offset_dn[part]
        seen, due = np.zeros(offset.size, np.uint32), np.zeros(offset.size)
        column_sums(measured[index], expected[index], first, last, seen, due)
        sums[index, 0, share] = seen - due
        sums[index, 1, share] = due - (last - first) * offset

    tasks = [
        partial(add, index, share, first, last)
        for index in range(len(press_context.sensors))
        for share, (first, last) in enumerate(pairwise(bounds))
    ]
    shared_out(tasks, threads=press_context.threads or 1)
    return sums


def lamp_waves(sums: NDArray[np.float64], part: slice, pixels: int) -> dict[str, float]:
    """Return amplitudes of the lamp's waves cos(k pi x / W) over the field.

    sums: (2, parts, columns of ``part``).
    """
    ratio = sums[0].sum(axis=0) / sums[1].sum(axis=0)
    x = (np.arange(pixels)[part] + 0.5) / pixels
    waves = np.cos(np.pi * np.multiply.outer(x, np.arange(LAMP_WAVES + 1)))
    # Normal equations: a BLAS least-squares fit takes longer, in threads that compete with the inspection's.
    amplitudes = np.linalg.solve(waves.T @ waves, waves.T @ ratio)
    return {f"lamp-{k}": float(amplitudes[k]) for k in range(1, LAMP_WAVES + 1)}
