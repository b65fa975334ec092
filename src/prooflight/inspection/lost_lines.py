"""A scan of which the camera lost lines, judged where it was seen.

What nobody saw is taken to be as foretold: the page is found in what was seen, its own prediction is put where lines
were lost, at the light of the lines around and with the camera's noise, and the sheet is judged so. Whatever the
detector, lines that were lost then speak neither for a misprint nor against one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from prooflight.detectors.verdict import Verdict
from prooflight.rng import stream

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.inspection.inspector import Inspector, Prepared

MOST_UNSEEN: Final = 0.2
"""Of a scan's lines; a sheet of which more were lost is not judged. assumed: the rest still shows where the page lies,
and a person would not call a sheet inspected of which a fifth was not."""
MOST_UNSEEN_OF_UNKNOWN: Final = 0.02
"""Of a sheet that is like no page. assumed: a page lacks so much and is still known by its thumbnail."""
LIGHT_LINES: Final = 32
"""Lines on either side of lost ones whose light is taken for theirs, 3.4 mm of the prototype's paper."""
LIGHT_PIXELS: Final = 65
"""Columns over which that light is evened out: a letter's edge half a pixel off its place must not count as light."""
NEAR_LINES: Final = 8
"""A misprint said within so many lines of lost ones and nowhere else is said for their sake: the side of a block."""


def unseen_share(unseen: Sequence[tuple[int, int]], lines: int) -> float:
    """Which share of a scan's lines was lost; unseen: first and behind the last of each run. [-]"""
    return sum(end - first for first, end in unseen) / max(lines, 1)


def inspect_where_seen(
    inspector: Inspector,
    prepared: Prepared,
    scan: NDArray[np.uint16],
    *,
    unseen: Sequence[tuple[int, int]],
    scan_name: str = "the scan",
    seed: int = 0,
) -> Inspection:
    """As ``Inspector.inspect`` where lines ``unseen`` of the scan (sensors, lines, pixels) [DN] show nothing.

    unseen: first and behind the last of each run of them; none: it is ``Inspector.inspect``. A misprint said only where
    lines were lost is not-inspected: what is wrong there was not on the paper. ScanError: as there.
    """
    if not unseen:
        return inspector.inspect(prepared, scan, scan_name=scan_name, seed=seed)
    found = inspector.inspect(prepared, scan, scan_name=scan_name, seed=seed)
    filled = as_foretold(scan, found, unseen, seed=seed)
    done = inspector.inspect(prepared, filled, scan_name=scan_name, seed=seed)
    verdict = done.verdict
    if verdict.verdict == "misprint" and _only_unseen(done, unseen, inspector):
        why = "lines were lost, and nothing else on the sheet is wrong"
        said = Verdict.skipped(verdict.page, why, detector=verdict.detector)
        return replace(
            done, verdict=replace(said, shift_mm=verdict.shift_mm, milliseconds=verdict.milliseconds)
        )
    return done


def as_foretold(
    scan: NDArray[np.uint16], found: Inspection, unseen: Sequence[tuple[int, int]], *, seed: int
) -> NDArray[np.uint16]:
    """The scan with its page's own prediction where lines were lost; a copy, (sensors, lines, pixels). [DN]

    found: what was seen of it with anything in their place; it says where the page lies.
    """
    rows, columns = found.area
    expected = found.expect()
    filled, rng = scan.copy(), stream(seed, "lost-lines")
    lost = np.zeros(scan.shape[1], bool)
    for first, end in unseen:
        lost[first:end] = True
    for first, end in unseen:
        begin, stop = max(first, rows.start), min(end, rows.stop)
        if begin >= stop:
            continue
        about = slice(max(first - LIGHT_LINES, rows.start), min(end + LIGHT_LINES, rows.stop))
        seen = np.flatnonzero(~lost[about]) + about.start
        here = slice(begin - rows.start, stop - rows.start)
        foretold = expected.expected_dn[:, here]
        if seen.size:
            foretold = foretold * _light(
                scan[:, seen][:, :, columns], expected.expected_dn[:, seen - rows.start]
            )
        noise = rng.standard_normal(foretold.shape, np.float32) * np.sqrt(expected.variance_dn2[:, here])
        filled[:, begin:stop, columns] = np.rint(np.clip(foretold + noise, 0, 65535)).astype(np.uint16)
    return filled


def _light(measured: NDArray[np.uint16], expected: NDArray[np.float32]) -> NDArray[np.float32]:
    """How many times as light lines (sensors, n, columns) are as foretold, by column: (sensors, 1, columns)."""
    sums = [
        cv2.blur(lines.sum(axis=1, dtype=np.float32), (LIGHT_PIXELS, 1), borderType=cv2.BORDER_REPLICATE)
        for lines in (measured, expected)
    ]
    return (sums[0] / np.maximum(sums[1], 1.0))[:, None]


def _only_unseen(done: Inspection, unseen: Sequence[tuple[int, int]], inspector: Inspector) -> bool:
    """Whether all that is wrong lies where lines were lost."""
    geometry = inspector.press.geometry
    near_mm = NEAR_LINES * geometry.line_pitch_mm
    lost_mm = [
        tuple(line * geometry.line_pitch_mm - geometry.lead_in_mm for line in (first, end))
        for first, end in unseen
    ]
    return bool(done.regions) and all(
        any(
            first - near_mm <= region.y_mm and region.y_mm + region.height_mm <= end + near_mm
            for first, end in lost_mm
        )
        for region in done.regions
    )
