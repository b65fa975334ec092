"""Evidence that is stored with a page, from which its verdict can be repeated with the press of the run.

It holds the detector's own input (some kilobytes for the matched-filter detector, a tenth of a megabyte for
the paper's), and for people a cut of the scan at each place of a misprint, or the whole scan of a sheet that
passed and is sampled for review.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.base import Inspection, StoredArrays
from prooflight.detectors.registry import detector
from prooflight.errors import RequestError
from prooflight.inspection.codes.reading import failed_again

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Decision, Verdict
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


StoredEvidence = Mapping[str, NDArray[Any]]

CUTS: Final = 3
"""Greatest number of places of a misprint of which the scan is stored."""
CUT_PIXELS: Final = 256
"""Longest side of such a cut, 27 mm at the prototype's pitch."""
MARGIN_MM: Final = 2.0
WHOLE_PIXELS: Final = 12_000_000
"""Greatest number of pixels of a stored whole scan, an A3 page at the prototype's pitch.

Larger ones are halved.
"""
UNKNOWN_PIXELS: Final = 2_000_000
"""Greatest number of pixels of the picture of a sheet that shows no page of the job: nothing is computed from it."""
ROUNDING: Final = 1e-9
"""Relative tolerance of repeated figures; other processors add in another order."""


def evidence_to_store(
    inspection: Inspection, page: Page, press: Press, *, whole: bool = False
) -> dict[str, NDArray[Any]]:
    """Return the arrays that ``decided_again`` needs of one page, and cuts of the scan where it is a misprint.

    Arrays: ``Inspection.kept``; "cutN" (sensors, lines, pixels) [DN] and "cutN_mm", its x, y, width and
    height on the page as printed. whole: also "whole" (lines, pixels) [DN], the first sensor's image of the
    page, of at most ``WHOLE_PIXELS``, and "whole_mm".
    """
    cuts = _cuts(inspection, page, press) if inspection.verdict.regions else {}
    return {**inspection.stored_arrays, **cuts, **(_whole(inspection, page, press) if whole else {})}


def scan_to_store(scan: NDArray[np.uint16], press: Press) -> dict[str, NDArray[Any]]:
    """Return the picture of a sheet that shows no page of the job, of at most ``UNKNOWN_PIXELS``.

    scan: (sensors, lines, pixels) [DN]. Arrays: "whole" (lines, pixels) [DN] of the first sensor, and "whole_mm", whose
    origin is the camera's first column and the sheet's leading edge.
    """
    geometry = press.geometry
    lines, pixels = scan.shape[1:]
    size_mm = pixels * geometry.pixel_pitch_mm, lines * geometry.line_pitch_mm
    return {
        "whole": _halved(scan[0], UNKNOWN_PIXELS),
        "whole_mm": np.array([0.0, -geometry.lead_in_mm, *size_mm]),
    }


def decided_again(stored: StoredEvidence, press: Press, detector_name: str) -> Decision:
    """Repeat the decision from this evidence.

    RequestError if it is of another detector, or of no page at all.
    """
    arrays = StoredArrays(stored, detector_name)
    _ = arrays.wrong_page  # refused where it is not told
    again = detector(detector_name, press).decided_again(arrays)
    if np.isnan(again.score):
        raise arrays.refusal("it gives no score")
    return again


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One figure of a verdict, as recorded and as it is repeated."""

    name: str
    recorded: float | str | None
    again: float | str | None

    @property
    def same(self) -> bool:
        """Return whether both are equal up to rounding."""
        if isinstance(self.recorded, float) and isinstance(self.again, float):
            return bool(np.isclose(self.recorded, self.again, rtol=ROUNDING, atol=0, equal_nan=True))
        return self.recorded == self.again


def replayed(verdict: Verdict, stored: StoredEvidence, press: Press) -> list[Figure]:
    """Repeat verdict, score, threshold, p-value and probability from evidence, with the recorded ones.

    RequestError: the page was not inspected, or its evidence is of another detector.
    """
    if verdict.score is None:
        raise RequestError(
            verdict.page, "was not compared with anything", remedy="choose a page with a score"
        )
    again = decided_again(stored, press, verdict.detector)
    misprint = again.misprint or StoredArrays(stored, verdict.detector).wrong_page or failed_again(stored)
    figures = [Figure(name="verdict", recorded=verdict.verdict, again="misprint" if misprint else "good")]
    figures += [
        Figure(name=name, recorded=getattr(verdict, name), again=getattr(again, name))
        for name in ("score", "threshold", "p_value", "probability")
    ]
    return figures


def _whole(inspection: Inspection, page: Page, press: Press) -> dict[str, NDArray[Any]]:
    """Return the whole area that was inspected, as the first sensor saw it."""
    begin_mm, pitch = _begin_mm(inspection, page, press)
    seen = inspection.measured_dn[0]
    (y, x), (height, width) = -begin_mm, np.array(seen.shape) * pitch
    return {"whole": _halved(seen, WHOLE_PIXELS), "whole_mm": np.array([x, y, width, height])}


def _halved(image: NDArray[np.uint16], most: int) -> NDArray[np.uint16]:
    """Return a copy of an image (lines, pixels), halved until it has at most ``most`` pixels."""
    image = image.copy()
    while image.size > most:
        half = max(image.shape[1] // 2, 1), max(image.shape[0] // 2, 1)
        image = np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA), np.uint16).reshape(
            half[::-1]
        )
    return image


def _begin_mm(
    inspection: Inspection, page: Page, press: Press
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the offset from the page as printed to the inspected area, and the pitch of lines and pixels. [mm]

    The offset is y and x of the page's place in the scan, less where the area begins.
    """
    geometry = press.geometry
    pitch = np.array([geometry.line_pitch_mm, geometry.pixel_pitch_mm])
    shift_x_mm, shift_y_mm = inspection.placement.shift_mm
    left_mm = geometry.left_mm(page.width_mm)
    begin_mm = np.array([geometry.lead_in_mm + shift_y_mm, left_mm + shift_x_mm])
    return begin_mm - np.array([part.start for part in inspection.area]) * pitch, pitch


def _cuts(inspection: Inspection, page: Page, press: Press) -> dict[str, NDArray[Any]]:
    """Return cuts of the scan at the regions of greatest evidence."""
    begin_mm, pitch = _begin_mm(inspection, page, press)
    extent = np.array(inspection.measured_dn.shape[1:])
    cuts = {}
    for index, region in enumerate(inspection.verdict.regions[:CUTS]):
        corner_mm, size_mm = (
            np.array([region.y_mm, region.x_mm]),
            np.array([region.height_mm, region.width_mm]),
        )
        middle = (corner_mm + size_mm / 2 + begin_mm) / pitch
        half = np.minimum((size_mm / 2 + MARGIN_MM) / pitch, CUT_PIXELS / 2)
        first = np.clip(np.rint(middle - half), 0, extent - 1).astype(int)
        last = np.clip(np.rint(middle + half), first + 1, extent).astype(int)
        cuts[f"cut{index}"] = inspection.measured_dn[:, first[0] : last[0], first[1] : last[1]].copy()
        (y, x), (height, width) = first * pitch - begin_mm, (last - first) * pitch
        cuts[f"cut{index}_mm"] = np.array([x, y, width, height])
    return cuts
