"""The report of scans that were compared with golden scans: its entries and facts, where there is no raster."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.base import Inspection
from prooflight.detectors.golden.detector import GUARANTEE, NAME
from prooflight.detectors.verdict import Verdict
from prooflight.inspection.job import UNUSABLE, unusable
from prooflight.pages.parallel import KILLED
from prooflight.reporting.pictures import Frame, encoded, grey_picture, pictures_of
from prooflight.reporting.report import PAGE_PICTURE_PX, PageEntry, RunSummary, unpictured_entry

if TYPE_CHECKING:
    from prooflight.inspection.golden import GoldenInspector, GoldenPage

PICTURE_GAMMA: Final = 2.2
"""Exponent by which pictures encode light (IEC 61966-2-1, nearly); a press's scans are linear."""
WHITE_PERCENT: Final = 99.0


@dataclass(frozen=True, slots=True)
class PicturedGolden:
    """Inspection of one page that returns a report's entry instead of the bare verdict."""

    inspector: GoldenInspector

    def __call__(self, page: GoldenPage) -> PageEntry:
        """Inspect one page and make its entry, also without a scan, or with one that cannot be used."""
        try:
            result = self.inspector.result(page)
            if not isinstance(result, Inspection):
                return unpictured_entry(page.number, result)
            return self._entry(page, result)
        except UNUSABLE as error:
            return unpictured_entry(page.number, unusable(page.name, error))

    def killed(self, page: GoldenPage) -> PageEntry:
        """Return the entry of a page whose inspection the system ended."""
        return unpictured_entry(page.number, Verdict.skipped(page.name, KILLED))

    def _entry(self, page: GoldenPage, result: Inspection) -> PageEntry:
        press, verdict = self.inspector.press, result.verdict
        golden = result.expect().expected_dn
        white = max(float(np.percentile(golden, WHITE_PERCENT)), 1e-9)
        expected, measured = (
            _light(image, white, 1.0 if press is not None else PICTURE_GAMMA)
            for image in (golden, result.measured_dn)
        )
        across_mm, along_mm = self.inspector.pitch_mm(page)
        lines, pixels = expected.shape
        frame = Frame(
            x_mm=-page.left_mm,
            y_mm=0.0 if press is None else -press.geometry.lead_in_mm,
            width_mm=pixels * across_mm,
            height_mm=lines * along_mm,
        )
        alarm = None
        if verdict.verdict == "misprint":
            place = verdict.regions[0] if verdict.regions else None
            alarm = pictures_of(expected, measured, result.block_z, frame, place=place)
        return PageEntry(
            number=page.number,
            name=page.name,
            verdict=verdict,
            size_mm=(round(frame.width_mm, 2), round(frame.height_mm, 2)),
            picture=encoded(grey_picture(measured, frame, width_px=PAGE_PICTURE_PX)),
            alarm=alarm,
        )


def golden_summary(inspector: GoldenInspector, *, scans: str, golden: str, pages_per_s: float) -> RunSummary:
    """Return the facts of scans that were compared with golden scans today."""
    press = inspector.press
    return RunSummary(
        job=f"{scans} against {golden}",
        press="unknown" if press is None else press.name,
        press_digest="none" if press is None else press.digest,
        guarantee=GUARANTEE,
        world=None,
        seed=None,
        date=datetime.now(UTC).strftime("%Y-%m-%d"),
        pages_per_s=pages_per_s,
        detector=NAME,
    )


def _light(image: NDArray[np.generic], white: float, gamma: float) -> NDArray[np.float32]:
    """Return the light of the first channel of (channels, lines, pixels), paper 1."""
    return np.asarray(np.clip(image[0].astype(np.float32) / white, 0, None) ** gamma, np.float32)
