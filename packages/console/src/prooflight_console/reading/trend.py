"""The press over a run, for an engineer: drift with limits, lost lines, times of verdicts, two runs alike."""

from __future__ import annotations

import os
import resource
import sys
import threading
from collections import OrderedDict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight_console.reading.drift import drift, latencies
from prooflight_line.journal.following import PageQuery
from prooflight_line.journal.labels import run_key

if TYPE_CHECKING:
    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.records import RunRow

POINTS: Final = 240
"""Points of a chart: more cannot be resolved at half the width of a screen."""
MOST_CACHED: Final = 12
"""Number of cached trends."""
AT_ONCE: Final = 2000
GROUPS: Final = (
    ("density", "gain-"),
    ("register-x", "register-"),
    ("register-y", "register-"),
    ("shift", "shift-"),
    ("light", "light-"),
    ("lamp", "lamp-"),
)
"""Charts, and the prefixes of their channels' names; registers across end in -x."""


class Trends:
    """Cache of trends of runs, computed again when a run has got further.

    They are computed one at a time, since that of a long run takes seconds.
    """

    def __init__(self, reading: Reading) -> None:
        self._reading = reading
        self._guard = threading.Lock()
        self._cached: OrderedDict[tuple[str, int, str], dict[str, Any]] = OrderedDict()

    def of(self, run: RunRow) -> dict[str, Any]:
        """Return channels by chart, troubles of lines and verdicts, and the histogram of times."""
        key = run_key(run), run.pages, run.state
        with self._guard:
            if (cached := self._cached.get(key)) is None:
                cached = self._cached[key] = trend(self._reading, run)
                while len(self._cached) > MOST_CACHED:
                    self._cached.popitem(last=False)
            self._cached.move_to_end(key)
            return cached


def trend(reading: Reading, run: RunRow) -> dict[str, Any]:
    """Compute the trend of a run as ``Trends.of`` returns it; raises JournalError."""
    drifts = drift(reading, run, points=POINTS, channel=None)
    charts: dict[str, list[dict[str, Any]]] = {name: [] for name, _ in GROUPS}
    for channel in drifts["channels"]:
        if (name := group_of(channel["name"])) is not None:
            charts[name].append(channel)
    return {
        "run": run.id,
        "sheets": drifts["sheets"],
        "charts": {name: channels for name, channels in charts.items() if channels},
        "troubles": troubles(reading, run, drifts["sheets"]),
        "latency": latencies(reading, run),
    }


def group_of(channel: str) -> str | None:
    """Return the chart that shows a channel; None if none does."""
    for name, beginning in GROUPS:
        if channel.startswith(beginning) and (not name.startswith("register") or channel.endswith(name[-2:])):
            return name
    return None


def troubles(reading: Reading, run: RunRow, starts: list[int]) -> dict[str, list[int]]:
    """Count sheets with lost lines, late, or not inspected, in the parts of a run that begin at ``starts``."""
    totals = {name: np.zeros(max(len(starts), 1), int) for name in ("lost-lines", "late", "not-inspected")}
    after, query = -1, PageQuery(run_id=run.id, to_review=True)
    while starts and (rows := reading.sheets(query, after=after, limit=AT_ONCE, damaged=lambda _: None)):
        for row in rows:
            page = row.page
            at = max(int(np.searchsorted(starts, page.sheet, side="right")) - 1, 0)
            totals["lost-lines"][at] += "lost-lines" in page.faults
            totals["late"][at] += page.late
            totals["not-inspected"][at] += page.verdict.verdict == "not-inspected"
        after = rows[-1].page.sheet
    return {name: counts.tolist() for name, counts in totals.items()}


def run_figures(run: RunRow, trend: dict[str, Any]) -> dict[str, Any]:
    """Return the figures by which runs are compared; None if unknown."""
    latency, troubled = trend["latency"], trend["troubles"]
    stages = {} if run.end is None else run.end.counts.get("stages") or {}
    verdict = stages.get("verdict") or {}
    elapsed_s = None if run.end is None else run.end.counts.get("elapsed_s")
    return {
        "pages": run.pages,
        "misprints": run.misprints,
        "not_inspected": run.not_inspected,
        "late": run.late,
        "lost_lines": sum(troubled["lost-lines"]),
        "sheets_per_s": run.pages / elapsed_s if elapsed_s else None,
        "inspection_median_ms": latency["median_ms"],
        "inspection_p99_ms": latency["p99_ms"],
        "verdict_median_ms": verdict.get("median_ms"),
        "verdict_p99_ms": verdict.get("p99_ms"),
        "verdict_p999_ms": verdict.get("p999_ms"),
        "busy": _busy_s(latency) / elapsed_s if elapsed_s and sum(latency["counts"]) else None,
    }


def _busy_s(latency: dict[str, Any]) -> float:
    """Return the total time of all inspections, from the centres of the histogram's bins (17 % wide). [s]"""
    edges = np.array(latency["edges_ms"])
    return float(np.dot(np.sqrt(edges[:-1] * edges[1:]), latency["counts"])) / 1000


def machine() -> dict[str, float | None]:
    """Return the machine's load per core, and the console's CPU time and peak memory so far."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    unit = 1 if sys.platform == "darwin" else 1024
    return {
        "load": os.getloadavg()[0] / (os.cpu_count() or 1),
        "cpu_s": used.ru_utime + used.ru_stime,
        "megabytes": used.ru_maxrss * unit / 1e6,
    }
