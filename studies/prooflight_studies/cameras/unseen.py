"""Lost lines before detectors that ignore them: no detector may call a misprint what is none without the loss."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.inspection.inspector import Inspector
from prooflight.inspection.lost_lines import inspect_where_seen
from prooflight.press.artefact import Press
from prooflight.rng import stream
from prooflight.scans.lines import Unseen
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.prints import Print
from prooflight.simulation.scans import ideal_scan
from prooflight_studies.running.rig import DESIGN_SEED, Pieces, day

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

RUNS: Final = (1, 3, 32, 64)
"""Numbers of lines that are lost at once: a packet's, a block's."""
DETECTORS: Final = ("chi-square", "bayes", "matched_filter")


def unseen_rows(
    press_at: Path, *, prints: int, seed: int, progress: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Return a row for each detector and world: the same prints with and without a run of lost lines."""
    press = Press.load(press_at)
    pieces = Pieces(seed=DESIGN_SEED + 7, dpi=press.dpi)
    pages = [press.geometry.lay(pieces.page(index)) for index in range(prints)]
    rows = []
    for world in ("ideal", "press"):
        scans = [_scan(press, page, world, seed, index) for index, page in enumerate(pages)]
        for name in DETECTORS:
            if name != "chi-square" and name not in press.detectors:
                continue
            progress(f"lost lines: {name}, {world} world")
            rows.append(_row(Inspector.of(press, name), name, world, pages, scans, seed))
    return rows


def _scan(press: Press, page: Any, world: str, seed: int, index: int) -> Any:
    rng = stream(seed, "running-print", index)
    if world == "ideal":
        expected = Inspector.of(press, "chi-square").planned(page).expected
        return ideal_scan(expected, press, rng)
    session = day(press, seed)
    return fast_scan(page, press, session, Print.draw(session, press, page, rng), rng=rng)


def _row(inspector: Inspector, name: str, world: str, pages: Any, scans: Any, seed: int) -> dict[str, Any]:
    rng = stream(seed, "camera-losses", 3)
    good = false_misprints = skipped = unfilled = remaining_misprints = 0
    ratios = []
    for index, (page, scan) in enumerate(zip(pages, scans, strict=True)):
        prepared = inspector.prepare(page)
        usual = inspector.inspect(prepared, scan, seed=index).verdict
        good += usual.verdict == "good"
        for lines in RUNS:
            first = int(rng.integers(40, scan.shape[1] - 40 - lines))
            holed = scan.copy()
            holed[:, first : first + lines] = holed[:, first - 1 : first]
            unseen = (Unseen(first, first + lines),)
            checked = inspect_where_seen(inspector, prepared, holed, unseen=unseen, seed=index).verdict
            plain = inspector.inspect(prepared, holed, seed=index).verdict
            if usual.verdict == "good":
                false_misprints += checked.verdict == "misprint"
                unfilled += plain.verdict == "misprint"
                skipped += checked.verdict == "not-inspected"
            else:
                remaining_misprints += checked.verdict == "misprint"
            if usual.score and checked.score is not None:
                ratios.append(checked.score / usual.score)
    return {
        "detector": name,
        "world": world,
        "prints": len(pages),
        "runs": len(pages) * len(RUNS),
        "good": good,
        "good_runs": good * len(RUNS),
        "made_misprints": false_misprints,
        "made_misprints_unfilled": unfilled,
        "skipped": skipped,
        "misprint_runs": (len(pages) - good) * len(RUNS),
        "misprints_kept": remaining_misprints,
        "score_median": float(np.median(ratios)) if ratios else None,
        "score_most": float(np.max(ratios)) if ratios else None,
    }
