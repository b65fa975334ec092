"""Inspection of a scan of which the camera lost lines.

The matched-filter detector leaves them out, from registration on (``LeavesLostLinesOut``). For any other
detector they are filled by the prediction: the page is located in the lines that were seen, its own
prediction is put where lines were lost, at the light of the lines around and with the camera's noise, and the
sheet is inspected so. Lost lines are then evidence neither for a misprint nor against one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.optional import LeavesLostLinesOut
from prooflight.detectors.verdict import Verdict
from prooflight.rng import stream
from prooflight.scans.scan import Scan

if TYPE_CHECKING:
    from prooflight.detectors.base import Inspection
    from prooflight.inspection.inspector import Inspector, Prepared
    from prooflight.scans.lines import Unseen

MOST_UNSEEN: Final = 0.2
"""Greatest share of a scan's lines that may be lost; a sheet that lost more is not inspected.

assumed: the rest still shows where the page lies, and a person would not call a sheet inspected of which a
fifth was not.
"""
MOST_UNSEEN_OF_UNKNOWN: Final = 0.02
"""Greatest share of lost lines of a sheet that is like no page.

assumed: a page that lacks as much is still identified by its thumbnail.
"""
LIGHT_LINES: Final = 32
"""Number of lines on either side of lost ones whose light is taken for theirs, 3.4 mm of the prototype's paper."""
LIGHT_PIXELS: Final = 65
"""Columns over which that light is smoothed: a letter's edge half a pixel off its place must not count as light."""
TONES: Final = 32
"""Number of steps of the expected signal, each with as many pixels."""
NEAR_LINES: Final = 8
"""Distance in lines, the side of a block, at which a misprint that is nowhere else is attributed to lost lines."""
MOST_ELSEWHERE: Final = 0.5
"""Greatest share of such a region's height that may lie elsewhere.

Sums are as high as 32 lines, and lost lines are as likely at a region's border as in its middle.
"""


def unseen_share(unseen: Sequence[Unseen], lines: int) -> float:
    """Return the share of a scan's lines that was lost, by the sensor that lost most. [-]"""
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
    decided: Callable[[Verdict], None] | None = None,
) -> Inspection:
    """Inspect as ``Inspector.inspect`` does, a scan (sensors, lines, pixels) [DN] whose lines ``unseen`` were lost.

    With none unseen it is ``Inspector.inspect``. A misprint only where lines were lost, by a detector that
    was given others in their place, is not-inspected: its evidence was not on the paper. decided, ScanError: as there.
    """
    given = Scan(dn=scan, name=scan_name, unseen=tuple(unseen))
    page = prepared.prepared_page
    if not unseen or (isinstance(page, LeavesLostLinesOut) and page.leaves_lost_lines_out):
        return inspector.inspect(prepared, given, seed=seed, decided=decided)
    done_first = inspector.inspect(prepared, given, seed=seed)
    filled = as_foretold(scan, done_first, unseen, seed=seed)
    done = inspector.inspect(prepared, replace(given, dn=filled), seed=seed)
    verdict = done.verdict
    if verdict.verdict == "misprint" and _only_unseen(done, unseen, inspector):
        why = "lines were lost, and nothing else on the sheet is wrong"
        skipped = Verdict.skipped(verdict.page, why, detector=verdict.detector)
        return replace(
            done, verdict=replace(skipped, shift_mm=verdict.shift_mm, milliseconds=verdict.milliseconds)
        )
    return done


def as_foretold(
    scan: NDArray[np.uint16], inspection: Inspection, unseen: Sequence[Unseen], *, seed: int
) -> NDArray[np.uint16]:
    """Return a copy of the scan with its page's own prediction where lines were lost, (sensors, lines, pixels). [DN]

    inspection: of the scan with any values in their place; it gives the position of the page.
    """
    rows, columns = inspection.area
    expected = inspection.expect()
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
    """Scale a prediction (lines, columns) [DN] to the tones of this print where it was seen (lines,).

    Inks lie a little thicker or thinner on every print, all over it. Lines that are filled with the unscaled
    prediction would differ from the rest of the print by as much. Each of ``TONES`` steps of the expected
    signal is scaled by its mean measured signal, so that an ink on its own is followed and a spot is not.
    """
    if not seen.any():
        return expected
    own, observed = expected[seen].ravel(), measured[seen].ravel()
    edges = np.quantile(own, np.linspace(0, 1, TONES + 1))
    step = np.clip(np.searchsorted(edges, own, side="right") - 1, 0, TONES - 1)
    counts = np.bincount(step, minlength=TONES)
    filled = counts > 0
    middles = np.bincount(step, own, TONES)[filled] / counts[filled]
    ratios = np.bincount(step, observed, TONES)[filled] / np.bincount(step, own, TONES)[filled].clip(1.0)
    order = np.argsort(middles)
    return np.asarray(expected * np.interp(expected, middles[order], ratios[order]), np.float32)


def _of(sensor: int | None) -> slice:
    return slice(None) if sensor is None else slice(sensor, sensor + 1)


def _light(measured: NDArray[np.uint16], expected: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the light of lines (sensors, n, columns) over the expected, by column: (sensors, 1, columns)."""
    sums = [
        cv2.blur(lines.sum(axis=1, dtype=np.float32), (LIGHT_PIXELS, 1), borderType=cv2.BORDER_REPLICATE)
        for lines in (measured, expected)
    ]
    return (sums[0] / np.maximum(sums[1], 1.0))[:, None]


def _only_unseen(done: Inspection, unseen: Sequence[Unseen], inspector: Inspector) -> bool:
    """Return whether all regions of a misprint lie where lines were lost."""
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
