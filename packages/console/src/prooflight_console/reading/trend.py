"""The press over a run, for an engineer: drift with limits, lost lines, times of verdicts, two runs alike."""

from __future__ import annotations

import os
import resource
import sys
import threading
from collections import OrderedDict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.cmyk import INK_NAMES
from prooflight_line.journal.following import PageQuery
from prooflight_line.journal.labels import run_key
from prooflight_line.run.monitor.channels import drift_channels

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.records import PageRecord, RunRow

POINTS: Final = 240
"""Points of a chart: more cannot be resolved at half the width of a screen."""
MOST_CACHED: Final = 12
# --- drift and times by parts of a run ---

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


MOST_SHEETS: Final = 100_000
"""Largest number of sheets that are read; of longer runs the last ones."""
EDGES_MS: Final = tuple(float(edge) for edge in np.geomspace(1, 10_000, 61).round(3))


def drift(reading: Reading, run: RunRow, *, points: int, channel: str | None) -> dict[str, Any]:
    """Return mean, least and greatest of each channel in ``points`` bins of sheets; see ``DriftAnswer``."""
    sheets: list[int] = []
    values: dict[str, list[tuple[int, float]]] = {}
    for page in _pages(reading, run):
        if channel is None:
            values_of_page = page.nuisance
        else:
            values_of_page = {channel: page.nuisance[channel]} if channel in page.nuisance else {}
        for name, value in values_of_page.items():
            if np.isfinite(value):
                values.setdefault(name, []).append((len(sheets), float(value)))
        sheets.append(page.sheet)
    bins = min(points, len(sheets)) or 1
    channels_by_name = {one.name: one for one in drift_channels(_sensors(values))}
    order = [name for name in channels_by_name if name in values] + sorted(
        values.keys() - channels_by_name.keys()
    )
    channels = []
    for name in order:
        at, numbers = (np.array(part) for part in zip(*values[name], strict=True))
        place = (at.astype(int) * bins) // max(len(sheets), 1)
        about = channels_by_name.get(name)
        scale = about.scale if about else 1.0
        channels.append(
            {
                "name": name,
                "what": about.what if about else name,
                "unit": about.unit if about else "",
                "tolerance": about.tolerance * about.scale if about else None,
                **_binned(place, numbers * scale, bins),
            }
        )
    starts = [sheets[(k * len(sheets)) // bins] for k in range(bins)] if sheets else []
    return {"sheets": starts, "channels": channels, "inks": list(INK_NAMES)}


def latencies(reading: Reading, run: RunRow) -> dict[str, Any]:
    """Return the histogram of inspection times; see ``HistogramAnswer``."""
    of_sheets = (page.verdict.milliseconds for page in _pages(reading, run))
    took = np.array([milliseconds for milliseconds in of_sheets if milliseconds > 0])
    counts, _ = np.histogram(np.clip(took, EDGES_MS[0], EDGES_MS[-1]), EDGES_MS)
    median, p99 = (float(np.quantile(took, share)) if took.size else None for share in (0.5, 0.99))
    return {
        "edges_ms": list(EDGES_MS),
        "counts": counts.tolist(),
        "median_ms": median,
        "p99_ms": p99,
        "greatest_ms": float(took.max()) if took.size else None,
        "late": run.late,
    }


def _pages(reading: Reading, run: RunRow) -> Iterator[PageRecord]:
    follower = reading.follower
    if follower is None:
        return
    after = max(-1, follower.last_sheet(run.id) - MOST_SHEETS)
    while rows := reading.sheets(
        PageQuery(run_id=run.id), after=after, limit=AT_ONCE, damaged=lambda _: None
    ):
        yield from (row.page for row in rows)
        after = rows[-1].page.sheet


def _sensors(values: dict[str, Any]) -> list[str]:
    return [name.removeprefix("light-") for name in values if name.startswith("light-")]


def _binned(place: Any, numbers: Any, bins: int) -> dict[str, list[float | None]]:
    count = np.bincount(place, minlength=bins)
    least, greatest = np.full(bins, np.inf), np.full(bins, -np.inf)
    np.minimum.at(least, place, numbers)
    np.maximum.at(greatest, place, numbers)
    total = np.bincount(place, weights=numbers, minlength=bins)

    def rounded(series: Any) -> list[float | None]:
        return [float(f"{value:.5g}") if many else None for value, many in zip(series, count, strict=True)]

    return {
        "mean": rounded(total / np.maximum(count, 1)),
        "least": rounded(least),
        "greatest": rounded(greatest),
    }
