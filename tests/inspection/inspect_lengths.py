"""One scan judged at several lengths, in a process of its own: verdicts as JSON, a line each.

python inspect_lengths.py X.press SCAN.pickle DETECTOR LENGTH... ; ``test_scan_lengths`` writes such files.
"""

from __future__ import annotations

import json
import pickle
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from prooflight.inspection.inspector import Inspector
from prooflight.press.artefact import Press

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page


def of_length(scan: NDArray[np.uint16], lines: int) -> NDArray[np.uint16]:
    """A scan (sensors, lines, pixels) cut, or gone on with what has nothing to do with the page."""
    sensors, has, pixels = scan.shape
    beyond = np.random.default_rng(9).integers(0, 3000, (sensors, max(lines - has, 0), pixels))
    return np.concatenate([scan[:, :lines], beyond.astype(np.uint16)], axis=1)


def inspected(
    press: Press, page: Page, scan: NDArray[np.uint16], detector: str, lengths: Iterable[int]
) -> list[dict[str, Any]]:
    """Lines, verdict, kind and score of the scan at each length."""
    inspector = Inspector.of(press, detector)
    ready = inspector.prepare(page)
    rows = []
    for lines in lengths:
        verdict = inspector.inspect(ready, of_length(scan, lines), scan_name="scan").verdict
        rows.append(
            {"lines": lines, "verdict": verdict.verdict, "kind": verdict.kind, "score": verdict.score}
        )
    return rows


if __name__ == "__main__":
    page, scan = pickle.loads(Path(sys.argv[2]).read_bytes())
    for row in inspected(Press.load(Path(sys.argv[1])), page, scan, sys.argv[3], map(int, sys.argv[4:])):
        print(json.dumps(row))  # noqa: T201
