"""What a verdict can be made from again: kept with its page, judged again with the press of the run.

Kept is what the detector itself was given (of ours some kilobytes, of the paper's a tenth of a megabyte), and for
people a cut of the scan at each place of a misprint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.comparing.evidence import Evidence
from prooflight.deciding.calibrated import CalibratedDetector, score_of, shows_another
from prooflight.deciding.families import all_said
from prooflight.deciding.said import stated
from prooflight.errors import RequestError
from prooflight.inspecting.inspector import detector

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from prooflight.deciding.verdict import Judgement, Verdict
    from prooflight.inspecting.inspection import Inspection, Prepared
    from prooflight.inspecting.inspector import Inspector
    from prooflight.press import Press

    Kept = Mapping[str, NDArray[Any]]

WRONG: Final = "wrong-page"
CUTS: Final = 3
"""Places of a misprint of which the scan is kept."""
CUT_PIXELS: Final = 256
"""Longest side of such a cut, 27 mm at the prototype's pitch."""
MARGIN_MM: Final = 2.0
ROUNDING: Final = 1e-9
"""Relative; other processors add in another order."""


def kept_evidence(
    inspection: Inspection, prepared: Prepared, inspector: Inspector
) -> dict[str, NDArray[Any]]:
    """What ``judged_again`` needs of one page, and cuts of the scan where it is a misprint.

    Arrays: "wrong_page"; "values" and "portrait" for ours, "tile_histogram" and "block_z" for the paper's detectors,
    each the one it looks at; "cutN" (sensors, lines, pixels) [DN] and "cutN_mm", its x, y, width and height on the
    page as printed.
    """
    judge, evidence, looked = inspector.judge, inspection.evidence, inspection.looked
    given: dict[str, NDArray[Any]]
    if isinstance(judge, CalibratedDetector):
        assert looked is not None
        assert prepared.known is not None
        said = all_said(looked.sums, looked.fit, looked.found, judge.tolerance.scatter)
        wrong = shows_another(looked.found)
        given = {"values": stated(said), "portrait": prepared.known.portrait}
    else:
        assert evidence is not None
        wrong = inspection.verdict.kind == WRONG
        counts = evidence.tile_histogram
        least = np.min_scalar_type(int(counts.max(initial=0)))
        given = (
            {"block_z": evidence.block_z}
            if judge.name == "bayes"
            else {"tile_histogram": counts.astype(least)}
        )
    cuts = _cuts(inspection, prepared, inspector.press) if inspection.verdict.regions else {}
    return {"wrong_page": np.array(wrong), **given, **cuts}


def judged_again(kept: Kept, press: Press, detector_name: str) -> Judgement:
    """The judgement that this evidence led to; RequestError if it is of another detector."""
    judge = detector(detector_name, press)
    try:
        if isinstance(judge, CalibratedDetector):
            another = bool(kept["wrong_page"])
            return judge.judge(score_of(judge.tolerance, kept["values"], kept["portrait"], another=another))
        of_blocks = judge.name == "bayes"
        return judge.judge(
            Evidence(
                tile_histogram=np.zeros((0,) * 4, np.int64)
                if of_blocks
                else kept["tile_histogram"].astype(np.int64),
                naive_histogram=np.zeros((0, 0), np.int64),
                block_z=kept["block_z"] if of_blocks else np.zeros((0,) * 3, np.float32),
            )
        )
    except KeyError as error:
        what = f"does not hold {error.args[0]!r}, which {detector_name} looks at"
        raise RequestError("evidence", what, remedy="only what the run kept can be replayed") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One figure of a verdict, as recorded and as it comes out again."""

    name: str
    recorded: float | str | None
    again: float | str | None

    @property
    def same(self) -> bool:
        """Equal, or but for rounding."""
        if isinstance(self.recorded, float) and isinstance(self.again, float):
            return bool(np.isclose(self.recorded, self.again, rtol=ROUNDING, atol=0, equal_nan=True))
        return self.recorded == self.again


def replayed(verdict: Verdict, kept: Kept, press: Press) -> list[Figure]:
    """Verdict, score, threshold, p-value and probability made from evidence again, beside what was recorded.

    RequestError: nobody judged the page, or its evidence is of another detector.
    """
    if verdict.score is None:
        raise RequestError(
            verdict.page, "was not compared with anything", remedy="choose a page with a score"
        )
    again = judged_again(kept, press, verdict.detector)
    again = replace(again, misprint=again.misprint or bool(kept["wrong_page"]))
    figures = [Figure(name="verdict", recorded=verdict.verdict, again=again.word)]
    figures += [
        Figure(name=name, recorded=getattr(verdict, name), again=getattr(again, name))
        for name in ("score", "threshold", "p_value", "probability")
    ]
    return figures


def _cuts(inspection: Inspection, prepared: Prepared, press: Press) -> dict[str, NDArray[Any]]:
    """The scan at the places that say most."""
    geometry = press.geometry
    pitch = np.array([geometry.line_pitch_mm, geometry.pixel_pitch_mm])
    shift_x_mm, shift_y_mm = inspection.placement.shift_mm
    left_mm = geometry.left_mm(prepared.page.width_mm)
    # From the page as printed to the area: its place in the scan, less where the area begins.
    begin_mm = np.array([geometry.lead_in_mm + shift_y_mm, left_mm + shift_x_mm])
    begin_mm -= np.array([part.start for part in inspection.area]) * pitch
    extent = np.array(inspection.measured_dn.shape[1:])
    kept = {}
    for index, region in enumerate(inspection.verdict.regions[:CUTS]):
        corner_mm, size_mm = (
            np.array([region.y_mm, region.x_mm]),
            np.array([region.height_mm, region.width_mm]),
        )
        middle = (corner_mm + size_mm / 2 + begin_mm) / pitch
        half = np.minimum((size_mm / 2 + MARGIN_MM) / pitch, CUT_PIXELS / 2)
        first = np.clip(np.rint(middle - half), 0, extent - 1).astype(int)
        last = np.clip(np.rint(middle + half), first + 1, extent).astype(int)
        kept[f"cut{index}"] = inspection.measured_dn[:, first[0] : last[0], first[1] : last[1]].copy()
        (y, x), (height, width) = first * pitch - begin_mm, (last - first) * pitch
        kept[f"cut{index}_mm"] = np.array([x, y, width, height])
    return kept
