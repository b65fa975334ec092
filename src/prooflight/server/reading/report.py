"""A run in figures."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.errors import ProoflightError
from prooflight.inspection.inspector import Inspector
from prooflight.journal.following import Asked
from prooflight.line.told import counts_of
from prooflight.server.reading import facts

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.journal.records import PageRecord, RunRow
    from prooflight.server.reading.incidents import RunIncidents
    from prooflight.server.reading.runs import Reading
    from prooflight.server.reading.stations import Stations

HEAT_MM: Final = 10.0
"""Side of a cell of the heat map."""
MOST_CELLS: Final = 120
"""Along each side: pages longer than 1.2 m have larger cells."""
AT_ONCE: Final = 1000
MOST_OPEN: Final = 60
"""Sheets of the sample that are listed as not yet told."""


def looked_at(reading: Reading, run: RunRow) -> Iterator[PageRecord]:
    """A run's sheets that somebody should look at."""
    after, asked = -1, Asked(run_id=run.id, to_look_at=True)
    while rows := reading.sheets(asked, after=after, limit=AT_ONCE, damaged=lambda _: None):
        yield from (row.page for row in rows)
        after = rows[-1].page.sheet


def report(reading: Reading, incidents: RunIncidents, stations: Stations, run: RunRow) -> dict[str, Any]:
    """See ``ReportAnswer``. A sheet counts as a false alarm where its incident was called one.

    Only alarms are confirmed by people, so ``realised_per_good_sheet`` counts unanswered alarms as misprints.
    """
    told = incidents.of(run)
    cleared = {one.incident.number for one in told if one.word == "false-alarm"}
    kinds: Counter[str] = Counter()
    by: dict[str, Counter[str]] = defaultdict(Counter)
    false_alarms, boxes = 0, []
    for page in looked_at(reading, run):
        if page.verdict.verdict != "misprint":
            continue
        kinds[page.verdict.kind or "unknown"] += 1
        false_alarms += incidents.of_sheet(run, page.sheet) in cleared
        boxes += [
            (region.x_mm, region.y_mm, region.width_mm, region.height_mm)
            for region in page.verdict.regions[:1]
        ]
    for one in told:
        for word in one.words:
            by[word.by][word.word] += 1
    good = run.pages - run.not_inspected - run.misprints + false_alarms
    return {
        "run": facts.run_of(run),
        "kinds": dict(kinds.most_common()),
        "incidents": len(told),
        "answered": sum(one.word is not None for one in told),
        "false_alarms": false_alarms,
        "promised": _promised(stations, run),
        "realised_per_good_sheet": false_alarms / good if good else None,
        "sample": sample_of(incidents, run),
        "tolerances": [asdict(one) for one in incidents.proposals([run])],
        "heat": heat_map(boxes),
        "words_by": {name: dict(words) for name, words in by.items()},
    }


def sample_of(incidents: RunIncidents, run: RunRow) -> dict[str, Any]:
    """What people were asked and told, and what it says of the run; None: it says nothing yet."""
    asked = incidents.asked(run)
    counts = counts_of(run, asked)
    open_questions = [one.record.sheet for one in asked if not one.alarm and not one.state]
    missed, false_alarms = counts.missed, counts.false_alarms
    return {
        "sampled": sum(not one.alarm for one in asked),
        "sampled_told": counts.passed_told,
        "alarms": counts.alarms,
        "alarms_told": counts.alarms_told,
        "open": open_questions[:MOST_OPEN],
        "open_count": len(open_questions),
        "false_alarms": None if false_alarms is None else asdict(false_alarms),
        "missed": None if missed is None else asdict(missed),
    }


def heat_map(boxes: list[tuple[float, float, float, float]]) -> dict[str, Any]:
    """How many misprints cover each cell of the page; boxes: x, y, width, height [mm]. Rows begin at the top."""
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


def _promised(stations: Stations, run: RunRow) -> str | None:
    press = stations.press(run)
    if press is None:
        return None
    try:
        return Inspector.of(press, run.facts.detector).promise
    except ProoflightError:
        return None
