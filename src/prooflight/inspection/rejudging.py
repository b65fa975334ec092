"""What a verdict can be made from again: kept with its page, judged again with the press of the run.

Kept is what the detector itself was given (of ours some kilobytes, of the paper's a tenth of a megabyte), and for
people a cut of the scan at each place of a misprint.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.matched_filter.calibrated import CalibratedDetector, score_of, shows_another
from prooflight.detectors.matched_filter.statistics.families import all_said
from prooflight.detectors.matched_filter.statistics.statistic import stated
from prooflight.detectors.paper.evidence import Evidence, interval_shares
from prooflight.errors import RequestError
from prooflight.inspection.inspector import detector

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from prooflight.detectors.base import Judgement, Verdict
    from prooflight.inspection.inspection import Inspection, Prepared
    from prooflight.inspection.inspector import Inspector
    from prooflight.press.artefact import Press

    Kept = Mapping[str, NDArray[Any]]

WRONG: Final = "wrong-page"
CUTS: Final = 3
"""Places of a misprint of which the scan is kept."""
CUT_PIXELS: Final = 256
"""Longest side of such a cut, 27 mm at the prototype's pitch."""
MARGIN_MM: Final = 2.0
MOST_COUNT: Final = 2**40
"""Pixels of one tile, far beyond any."""
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
    """The judgement that this evidence led to; RequestError if it is of another detector, or of no page at all."""
    judge = detector(detector_name, press)
    held = _Held(kept, detector_name)
    sensors, another = len(press.sensors), held.wrong_page
    with np.errstate(all="ignore"):  # what comes of odd numbers is looked at below
        if isinstance(judge, CalibratedDetector):
            tolerance = judge.tolerance
            values = held.array("values", "fiu", (len(tolerance.names),))
            portrait = held.array("portrait", "f", tolerance.centre.shape[1:], finite=True)
            again = judge.judge(score_of(tolerance, values, portrait, another=another))
        elif judge.name == "bayes":
            blocks = held.array("block_z", "f", (sensors, None, None), finite=True)
            again = judge.judge(_evidence(block_z=blocks))
        else:
            counts = held.array("tile_histogram", "ui", (sensors, None, None, interval_shares().size))
            if int(counts.min()) < 0 or float(counts.max()) >= MOST_COUNT or not counts.any(axis=3).all():
                raise held.refusal("'tile_histogram' holds what are no counts of pixels")
            again = judge.judge(_evidence(tile_histogram=counts.astype(np.int64)))
    if np.isnan(again.score):
        raise held.refusal("it gives no score")
    return again


@dataclass(frozen=True, slots=True)
class _Held:
    """Kept evidence, of which every array is checked before a detector sees it."""

    kept: Kept
    detector: str

    @property
    def wrong_page(self) -> bool:
        """Whether the scan showed another page."""
        return bool(self.array("wrong_page", "b", ()))

    def array(
        self, name: str, kinds: str, shape: tuple[int | None, ...], *, finite: bool = False
    ) -> NDArray[Any]:
        """One array; kinds of its numbers, its shape, None where any size above 0 will do. RequestError."""
        if name not in self.kept:
            raise self.refusal(f"does not hold {name!r}")
        array = np.asarray(self.kept[name])
        fits = len(array.shape) == len(shape) and all(
            size == wanted or (wanted is None and size)
            for size, wanted in zip(array.shape, shape, strict=True)
        )
        if not fits or array.dtype.kind not in kinds or (finite and not np.isfinite(array).all()):
            raise self.refusal(f"holds {name!r} of {array.dtype} {array.shape} that cannot be of its page")
        return array

    def refusal(self, what: str) -> RequestError:
        """Says why the evidence cannot be judged."""
        what = f"{what}, which {self.detector} looks at"
        return RequestError("evidence", what, remedy="only what the run kept can be replayed")


def _evidence(**given: NDArray[Any]) -> Evidence:
    nothing: dict[str, NDArray[Any]] = {
        "tile_histogram": np.zeros((0,) * 4, np.int64),
        "naive_histogram": np.zeros((0, 0), np.int64),
        "block_z": np.zeros((0,) * 3, np.float32),
    }
    return Evidence(**nothing | given)


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
    misprint = again.misprint or _Held(kept, verdict.detector).wrong_page
    figures = [Figure(name="verdict", recorded=verdict.verdict, again="misprint" if misprint else "good")]
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
