"""Measurements of every print over a run, binned so that a chart of any run is small."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.cmyk import INK_NAMES
from prooflight_line.journal.following import PageQuery
from prooflight_line.run.monitor.channels import drift_channels

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.records import PageRecord, RunRow

AT_ONCE: Final = 2000
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
