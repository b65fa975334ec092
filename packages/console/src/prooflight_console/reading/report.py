"""A run in figures."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.errors import ProoflightError
from prooflight.inspection.inspector import Inspector
from prooflight_console.reading import facts
from prooflight_console.reading.runs import pages_to_review
from prooflight_line.journal.labels import OF_GOOD
from prooflight_line.run.labelled_sheets import counts_of

if TYPE_CHECKING:
    from prooflight_console.reading.incidents import RunIncidents
    from prooflight_console.reading.reprints import Counted
    from prooflight_console.reading.runs import Reading
    from prooflight_console.reading.stations import Stations
    from prooflight_line.journal.records import RunRow

HEAT_MM: Final = 10.0
"""Side of a cell of the heat map."""
MOST_CELLS: Final = 120
"""Largest number of cells along each side: pages longer than 1.2 m have larger cells."""
MOST_OPEN: Final = 60
"""Largest number of sampled sheets that are listed as unlabelled."""


def report(
    reading: Reading, incidents: RunIncidents, stations: Stations, reprints: Counted, run: RunRow
) -> dict[str, Any]:
    """Return the figures of a run; see ``ReportAnswer``.

    Labels change no verdict: a false alarm is one of the misprints by verdict. Only alarms are confirmed by
    people, so ``false_alarms_per_good_sheet`` counts alarms without a label as misprints.
    """
    labelled = incidents.of(run)
    label_of = incidents.labels(run)
    kinds: Counter[str] = Counter()
    by: dict[str, Counter[str]] = defaultdict(Counter)
    false_alarms, boxes = 0, []
    for page in pages_to_review(reading, run):
        if page.verdict.verdict != "misprint":
            continue
        kinds[page.verdict.kind or "unknown"] += 1
        label = label_of(page.sheet)
        false_alarms += label is not None and label.word in OF_GOOD
        boxes += [
            (region.x_mm, region.y_mm, region.width_mm, region.height_mm)
            for region in page.verdict.regions[:1]
        ]
    for one in labelled:
        for label in one.standing:
            by[label.by][label.word] += 1
    good = run.pages - run.not_inspected - run.misprints + false_alarms
    return {
        "run": facts.run_of(run),
        "kinds": dict(kinds.most_common()),
        "incidents": len(labelled),
        "misprint_incidents": sum(one.of_misprints for one in labelled),
        "labelled": sum(one.answered for one in labelled),
        "false_alarms": false_alarms,
        "to_print_again": reprints.count,
        "unprinted": reprints.unprinted,
        "guarantee": _guarantee_text(stations, run),
        "false_alarms_per_good_sheet": false_alarms / good if good else None,
        "sample": sample_of(incidents, run),
        "tolerances": [asdict(one) for one in incidents.proposals([run])],
        "heat": heat_map(boxes),
        "labels_by_user": {name: dict(counts) for name, counts in by.items()},
    }


def sample_of(incidents: RunIncidents, run: RunRow) -> dict[str, Any]:
    """Return the sample for review, its labels, and estimates from them; an estimate may be None."""
    sampled = incidents.sampled(run)
    counts = counts_of(run, sampled)
    open_questions = [one.record.sheet for one in sampled if not one.alarm and not one.state]
    missed, false_alarms = counts.missed, counts.false_alarms
    return {
        "sampled": sum(not one.alarm for one in sampled),
        "sampled_labelled": counts.labelled_passed,
        "alarms": counts.alarms,
        "alarms_labelled": counts.labelled_alarms,
        "open": open_questions[:MOST_OPEN],
        "open_count": len(open_questions),
        "false_alarms": None if false_alarms is None else asdict(false_alarms),
        "missed": None if missed is None else asdict(missed),
    }


def heat_map(boxes: list[tuple[float, float, float, float]]) -> dict[str, Any]:
    """Count the misprints that cover each cell of the page; rows begin at the top.

    boxes: x, y, width and height. [mm]
    """
    if not boxes:
        return {"cell_mm": HEAT_MM, "rows": []}
    corners = np.array(boxes)
    first = np.maximum(corners[:, :2], 0.0)
    last = np.maximum(corners[:, :2] + corners[:, 2:], 0.0)
    cell = max(HEAT_MM, float(last.max()) / MOST_CELLS)
    columns, rows = (int(np.ceil(extent / cell)) or 1 for extent in last.max(axis=0))
    counts = np.zeros((min(rows, MOST_CELLS), min(columns, MOST_CELLS)), int)
    for (left, top), (right, bottom) in zip(first // cell, np.ceil(last / cell), strict=True):
        counts[int(top) : max(int(bottom), int(top) + 1), int(left) : max(int(right), int(left) + 1)] += 1
    return {"cell_mm": cell, "rows": counts.tolist()}


def _guarantee_text(stations: Stations, run: RunRow) -> str | None:
    press = stations.press(run)
    if press is None:
        return None
    try:
        return Inspector.of(press, run.facts.detector).guarantee
    except ProoflightError:
        return None
