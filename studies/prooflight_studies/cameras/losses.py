"""Losses of every kind, injected where blocks come off the wire: the faults that are reported for lines and sheets."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.weighted_conformal import exact_interval
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.lost_lines import inspect_where_seen
from prooflight.press.artefact import Press
from prooflight.rng import stream
from prooflight.scans.lines import Unseen
from prooflight.scans.raw import write_block
from prooflight.simulation.fast import fast_scan
from prooflight.simulation.prints import Print
from prooflight.simulation.scans import ideal_scan
from prooflight_line.cameras.camera import Grab
from prooflight_line.cameras.counting import PERIOD, LineCounter
from prooflight_studies.cameras.job import rows_from_file
from prooflight_studies.cameras.rig import PIXELS, next_message, verdict
from prooflight_studies.running.rig import DESIGN_SEED, Pieces, day

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from prooflight.scans.lines import LineBlock
    from prooflight_studies.cameras.rig import Rig

KINDS: Final = ("packets", "block", "triggers")
BLOCK_LINES: Final = 32
MOST_PASSED_OVER: Final = 4
"""Greatest number of line triggers lost within a block."""
PACKET_BYTES: Final = 1464
"""Bytes of payload, in packets of 1500 bytes."""
FIRST_ID: Final = 65_401
"""First block number of Aravis' simulated camera: block numbers wrap around after 135 blocks."""
FIRST_TRIGGERS: Final = 60_000
"""First count of triggers, which has 16 bits as well."""


ALARM: Final = ("sheet", "job_page", "kind", "family", "score", "threshold", "p_value", "reason")
"""Values that are stored of a good print that is called a misprint."""


@dataclass(slots=True)
class Loss:
    """One injected loss."""

    kind: str
    lines: tuple[int, int]
    """First line affected, and the line after the last, by the triggers of the press."""


def loss_figures(
    rig: Rig, *, losses: int, sheets: int, seed: int, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Inject losses, count them, judge the sheets, and compare with the same sheets without losses."""
    progress("sheets without a loss")
    whole = rows_from_file(rig, rig.prints)
    usual = [verdict(row) for row in whole]
    progress(f"{losses} losses on {sheets} sheets")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "lost.raw")
        with path.open("wb") as file:
            counted = count_losses(
                rig, losses=losses, sheets=sheets, seed=seed, given=lambda block: write_block(file, block)
            )
        process = rig.watch("--source", f"raw:{path}", "--framed", "--sheets", sheets)
        came = []
        while (row := next_message(process)) is not None:
            if "verdict" in row and "missing" not in row["faults"]:  # a page that did not come is no sheet
                came.append(row)
    passed = [round(row["first_line"] / rig.trigger) for row in came]  # of all sheets, by the camera's count
    pairs = [(verdict(row), usual[sheet % rig.prints]) for row, sheet in zip(came, passed, strict=True)]
    changes = [a[2] - b[2] for a, b in pairs if a[2] is not None and b[2] is not None]
    alarms = [
        {name: row[name] for name in ALARM} | {"score_before": before[2]}
        for row, (_, before) in zip(came, pairs, strict=True)
        if row["verdict"] == "misprint" and before[1] == "good"
    ]
    return counted | {
        "sheets": len(came),
        "prints": rig.prints,
        "prints_good": sum(row[1] == "good" for row in usual),
        "alarms": alarms,
        "without": _without(rig, whole),
        "skipped": [
            {name: row[name] for name in ("sheet", "first_line", "job_page", "reason")}
            for row in came
            if row["verdict"] == "not-inspected"
        ],
        "score_change_median": float(np.median(changes)),
        "score_change_95": float(np.quantile(changes, 0.95)),
        "out_of_step": sum(
            row["job_page"] not in (None, sheet) for row, sheet in zip(came, passed, strict=True)
        ),
        "said_lost": sum("lost-lines" in a[3] for a, _ in pairs),
        "not_inspected": sum(a[1] == "not-inspected" for a, _ in pairs),
        "good_before": sum(b[1] == "good" for _, b in pairs),
        "false_misprints": sum(a[1] == "misprint" and b[1] == "good" for a, b in pairs),
        "misprints_before": sum(b[1] == "misprint" for _, b in pairs),
        "misprints_kept": sum(a[1] == "misprint" and b[1] == "misprint" for a, b in pairs),
    }


def _without(rig: Rig, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the prints that alarm without a loss, and the target false-alarm rate of the press."""
    detector = model_of(Press.load(rig.press))
    alarms = [{name: row[name] for name in ALARM} for row in rows if row["verdict"] == "misprint"]
    low, high = exact_interval(len(alarms), len(rows))
    share = {"value": len(alarms) / len(rows), "low": low, "high": high}
    return {"alarms": alarms, "share": share, "promised": detector.guarantee.rate}


def count_losses(
    rig: Rig, *, losses: int, sheets: int, seed: int, given: Callable[[LineBlock], None]
) -> dict[str, Any]:
    """Inject losses and compare the reported with the injected ones; given: takes every block that comes out."""
    counter, injected = LineCounter(name="camera"), list[Loss]()
    named, other = np.zeros(sheets * rig.trigger + 10_000, bool), 0
    for grab in _grabs(rig, losses, sheets, seed, injected):
        for block in counter.take(grab):
            given(block)
            for fault in block.faults:
                named[fault.first_line : fault.next_line] = True
            at = np.arange(block.first_line, block.next_line)
            wrong = (block.lines[0] != rig.lines[at % len(rig.lines)]).any(axis=1)
            other += int((wrong & ~named[at]).sum())
    wanted = np.zeros_like(named)
    for loss in injected:
        wanted[slice(*loss.lines)] = True
    around = [slice(max(loss.lines[0] - 1, 0), loss.lines[1] + 1) for loss in injected]
    return {
        "losses": len(injected),
        "kinds": {kind: sum(loss.kind == kind for loss in injected) for kind in KINDS},
        "block_turns": (FIRST_ID + sheets * rig.trigger // BLOCK_LINES) // PERIOD,
        "trigger_turns": (FIRST_TRIGGERS + sheets * rig.trigger) >> 16,
        "named_exactly": sum(bool((named[part] == wanted[part]).all()) for part in around),
        "lines_named": int(named.sum()),
        "lines_lost": int(wanted.sum()),
        "other_lines": other,
    }


def _grabs(rig: Rig, losses: int, sheets: int, seed: int, injected: list[Loss]) -> Iterator[Grab]:
    """Yield blocks of the prints, repeated, with losses spread evenly; the injected losses are added to the list."""
    rng = stream(seed, "camera-losses", 0)
    every = sheets * rig.trigger
    passed_over = MOST_PASSED_OVER * -(-losses // len(KINDS))
    places = np.linspace(4, (every - passed_over) // BLOCK_LINES - 4, losses).astype(int)
    kinds = {int(place): KINDS[turn % len(KINDS)] for turn, place in enumerate(places)}
    line = 0  # by the triggers of the press
    for number in count():
        lines = min(BLOCK_LINES, every - line)  # the last block ends with the last sheet
        if not lines:
            return
        kind, first, size = kinds.get(number), line, lines * PIXELS * 2
        taken = np.arange(line, line + lines)
        missing: tuple[tuple[int, int], ...] = ()
        if kind == "triggers":
            over, at = int(rng.integers(1, MOST_PASSED_OVER + 1)), int(rng.integers(1, BLOCK_LINES))
            taken = np.where(np.arange(BLOCK_LINES) < at, taken, taken + over)
            line += over
        line += lines
        if kind == "packets":
            packet = int(rng.integers(0, -(-size // PACKET_BYTES)))
            hole = packet * PACKET_BYTES, min((packet + int(rng.integers(1, 4))) * PACKET_BYTES, size)
            missing = (hole,)
            injected.append(Loss(kind, (first + hole[0] // (2 * PIXELS), first - (-hole[1] // (2 * PIXELS)))))
        elif kind is not None:
            injected.append(Loss(kind, (first, line)))
        if kind == "block":
            continue
        data = rig.lines[taken % len(rig.lines)].astype("<u2").view(np.uint8).ravel().copy()
        for begin, end in missing:
            data[begin:end] = 0
        yield Grab(
            block_id=(FIRST_ID + number - 1) % PERIOD + 1,
            id_wraps=True,
            data=data,
            missing=missing,
            pixel_format="Mono16",
            lines=lines,
            pixels=PIXELS,
            padding=0,
            time_s=line / 1000,
            triggers=(FIRST_TRIGGERS + line) & 0xFFFF,
        )


# --- lost lines before detectors that ignore them: none may call a good print a misprint ---

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
