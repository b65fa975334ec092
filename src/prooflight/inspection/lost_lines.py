"""A scan of which the camera lost lines, judged where it was seen.

Our detector asks nothing of them, from registration on (``LeavesLostLinesOut``). To any other, what nobody saw is taken
to be as foretold: the page is found in what was seen, its own prediction is put where lines were lost, at the light of
the lines around and with the camera's noise, and the sheet is judged so. Lines that were lost then speak neither for a
misprint nor against one.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.detectors.base import LeavesLostLinesOut
from prooflight.detectors.verdict import Verdict
from prooflight.rng import stream
from prooflight.scans.scan import Scan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.inspection.inspector import Inspector, Prepared
    from prooflight.scans.lines import Unseen

MOST_UNSEEN: Final = 0.2
"""Of a scan's lines; a sheet of which more were lost is not judged. assumed: the rest still shows where the page lies,
and a person would not call a sheet inspected of which a fifth was not."""
MOST_UNSEEN_OF_UNKNOWN: Final = 0.02
"""Of a sheet that is like no page. assumed: a page lacks so much and is still known by its thumbnail."""
LIGHT_LINES: Final = 32
"""Lines on either side of lost ones whose light is taken for theirs, 3.4 mm of the prototype's paper."""
LIGHT_PIXELS: Final = 65
"""Columns over which that light is evened out: a letter's edge half a pixel off its place must not count as light."""
TONES: Final = 32
"""Steps of the expected signal, each with as many pixels."""
NEAR_LINES: Final = 8
"""A misprint said within so many lines of lost ones and nowhere else is said for their sake: the side of a block."""
MOST_ELSEWHERE: Final = 0.5
"""Of a region's height that may lie elsewhere: what is summed is as high as 32 lines, and where lines were lost is as
likely at its border as in its middle."""


def unseen_share(unseen: Sequence[Unseen], lines: int) -> float:
    """Which share of a scan's lines was lost, by the sensor that lost most. [-]"""
    by_sensor = Counter[int | None]()
    for first, end, sensor in unseen:
        by_sensor[sensor] += end - first
    by_all = by_sensor.pop(None, 0)
    return (by_all + max(by_sensor.values(), default=0)) / max(lines, 1)


def inspect_where_seen(
    inspector: Inspector,
    prepared: Prepared,
    scan: NDArray[np.uint16],
    *,
    unseen: Sequence[Unseen],
    scan_name: str = "the scan",
    seed: int = 0,
) -> Inspection:
    """As ``Inspector.inspect`` where lines ``unseen`` of the scan (sensors, lines, pixels) [DN] show nothing.

    None unseen: it is ``Inspector.inspect``. A misprint said only where lines were lost, by a detector that was given
    others in their place, is not-inspected: what is wrong there was not on the paper. ScanError: as there.
    """
    given = Scan(dn=scan, name=scan_name, unseen=tuple(unseen))
    found = inspector.inspect(prepared, given, seed=seed)
    if not unseen or (
        isinstance(prepared.known, LeavesLostLinesOut) and prepared.known.leaves_lost_lines_out
    ):
        return found
    filled = as_foretold(scan, found, unseen, seed=seed)
    done = inspector.inspect(prepared, replace(given, dn=filled), seed=seed)
    verdict = done.verdict
    if verdict.verdict == "misprint" and _only_unseen(done, unseen, inspector):
        why = "lines were lost, and nothing else on the sheet is wrong"
        said = Verdict.skipped(verdict.page, why, detector=verdict.detector)
        return replace(
            done, verdict=replace(said, shift_mm=verdict.shift_mm, milliseconds=verdict.milliseconds)
        )
    return done


def as_foretold(
    scan: NDArray[np.uint16], found: Inspection, unseen: Sequence[Unseen], *, seed: int
) -> NDArray[np.uint16]:
    """The scan with its page's own prediction where lines were lost; a copy, (sensors, lines, pixels). [DN]

    found: what was seen of it with anything in their place; it says where the page lies.
    """
    rows, columns = found.area
    expected = found.expect()
    filled, rng = scan.copy(), stream(seed, "lost-lines")
    lost = np.zeros(scan.shape[:2], bool)
    for first, end, sensor in unseen:
        lost[_of(sensor), first:end] = True
    foreseen = np.stack(
        [
            _as_printed(scan[at, rows, columns], own, ~lost[at, rows])
            for at, own in enumerate(expected.expected_dn)
        ]
    )
    for first, end, sensor in unseen:
        begin, stop = max(first, rows.start), min(end, rows.stop)
        if begin >= stop:
            continue
        of = _of(sensor)
        about = slice(max(first - LIGHT_LINES, rows.start), min(end + LIGHT_LINES, rows.stop))
        seen = np.flatnonzero(~lost[of, about].any(axis=0)) + about.start
        here = slice(begin - rows.start, stop - rows.start)
        foretold = foreseen[of, here]
        if seen.size:
            foretold = foretold * _light(scan[of, seen][:, :, columns], foreseen[of, seen - rows.start])
        noise = rng.standard_normal(foretold.shape, np.float32) * np.sqrt(expected.variance_dn2[of, here])
        filled[of, begin:stop, columns] = np.rint(np.clip(foretold + noise, 0, 65535)).astype(np.uint16)
    return filled


def _as_printed(
    measured: NDArray[np.uint16], expected: NDArray[np.float32], seen: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """A prediction (lines, columns) [DN] as dark and as light as this print was where it was seen (lines,).

    Inks lie a little thicker or thinner on every print, all over it. Lines that are filled as the page should be would
    stand out from the rest of the print by as much. What was measured where so much was expected stands for that, in
    ``TONES`` steps of the expected signal, so that an ink on its own is followed and a spot is not.
    """
    if not seen.any():
        return expected
    own, told = expected[seen].ravel(), measured[seen].ravel()
    edges = np.quantile(own, np.linspace(0, 1, TONES + 1))
    step = np.clip(np.searchsorted(edges, own, side="right") - 1, 0, TONES - 1)
    counts = np.bincount(step, minlength=TONES)
    known = counts > 0
    middles = np.bincount(step, own, TONES)[known] / counts[known]
    ratios = np.bincount(step, told, TONES)[known] / np.bincount(step, own, TONES)[known].clip(1.0)
    order = np.argsort(middles)
    return np.asarray(expected * np.interp(expected, middles[order], ratios[order]), np.float32)


def _of(sensor: int | None) -> slice:
    return slice(None) if sensor is None else slice(sensor, sensor + 1)


def _light(measured: NDArray[np.uint16], expected: NDArray[np.float32]) -> NDArray[np.float32]:
    """How many times as light lines (sensors, n, columns) are as foretold, by column: (sensors, 1, columns)."""
    sums = [
        cv2.blur(lines.sum(axis=1, dtype=np.float32), (LIGHT_PIXELS, 1), borderType=cv2.BORDER_REPLICATE)
        for lines in (measured, expected)
    ]
    return (sums[0] / np.maximum(sums[1], 1.0))[:, None]


def _only_unseen(done: Inspection, unseen: Sequence[Unseen], inspector: Inspector) -> bool:
    """Whether all that is wrong lies where lines were lost."""
    geometry = inspector.press.geometry
    near_mm = NEAR_LINES * geometry.line_pitch_mm
    lost_mm = [
        tuple(line * geometry.line_pitch_mm - geometry.lead_in_mm for line in (first, end))
        for first, end, _ in unseen
    ]
    return bool(done.regions) and all(
        any(
            min(region.y_mm + region.height_mm, end + near_mm) - max(region.y_mm, first - near_mm)
            >= (1 - MOST_ELSEWHERE) * region.height_mm
            for first, end in lost_mm
        )
        for region in done.regions
    )
