"""The means of every run of a press, for a chart over all runs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight_console.reading.trend import group_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_console.reading.trend import Trends
    from prooflight_line.journal.records import RunRow

SHOWN: Final = ("density", "register-x", "register-y", "light")
"""Charts of the history, as ``reading.trend`` names them."""
WIDTH, HEIGHT = 640.0, 180.0
"""Size of a drawing, without its texts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunMean:
    """Mean of a channel over one run."""

    run: int
    started_s: float
    value: float
    x: float
    """Position in the drawing."""
    y: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelHistory:
    """Means of one channel over all runs, as a line in a drawing."""

    name: str
    what: str
    unit: str
    means: tuple[RunMean, ...]

    @property
    def points(self) -> str:
        """Points of the line."""
        return " ".join(f"{one.x:.1f},{one.y:.1f}" for one in self.means)


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryChart:
    """One drawing: channels of one kind and unit, with their limits."""

    group: str
    unit: str
    tolerance: float | None
    limits: tuple[float, ...]
    """Heights of the limits in the drawing."""
    zero: float
    channels: tuple[ChannelHistory, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeScale:
    """Positions of moments in a drawing."""

    since_s: float
    until_s: float

    @classmethod
    def of(cls, runs: Sequence[RunRow]) -> TimeScale:
        """Return the scale from the first run to the last."""
        starts = [run.facts.started_s for run in runs] or [0.0]
        return cls(since_s=min(starts), until_s=max(starts))

    def x(self, at_s: float) -> float:
        """Return the position of a moment; one outside the runs lies at the edge."""
        span_s = self.until_s - self.since_s
        share = 0.5 if span_s <= 0 else (at_s - self.since_s) / span_s
        return 8 + (WIDTH - 16) * min(max(share, 0.0), 1.0)


def history(runs: Sequence[RunRow], trends: Trends) -> list[HistoryChart]:
    """Return the drawings of the means of runs; a run whose measurements cannot be read is left out."""
    scale = TimeScale.of(runs)
    values: dict[str, list[tuple[RunRow, float]]] = {}
    about: dict[str, dict[str, Any]] = {}
    for run in sorted(runs, key=lambda one: one.facts.started_s):
        for channels in trends.of(run)["charts"].values():
            for channel in channels:
                means = [one for one in channel["mean"] if one is not None and math.isfinite(one)]
                if means:
                    values.setdefault(channel["name"], []).append((run, sum(means) / len(means)))
                    about[channel["name"]] = channel
    charts = []
    for group in SHOWN:
        names = [name for name in values if group_of(name) == group]
        if names:
            charts.append(_chart(group, names, values, about, scale))
    return charts


def _chart(
    group: str,
    names: Sequence[str],
    values: dict[str, list[tuple[RunRow, float]]],
    about: dict[str, dict[str, Any]],
    scale: TimeScale,
) -> HistoryChart:
    tolerance = about[names[0]]["tolerance"]
    most = max([abs(value) for name in names for _, value in values[name]] + [tolerance or 0.0, 1e-9])

    def y(value: float) -> float:
        return HEIGHT / 2 - value / (1.1 * most) * HEIGHT / 2

    return HistoryChart(
        group=group,
        unit=about[names[0]]["unit"],
        tolerance=tolerance,
        limits=() if tolerance is None else (y(tolerance), y(-tolerance)),
        zero=y(0.0),
        channels=tuple(
            ChannelHistory(
                name=name,
                what=about[name]["what"],
                unit=about[name]["unit"],
                means=tuple(
                    RunMean(
                        run=run.id,
                        started_s=run.facts.started_s,
                        value=value,
                        x=scale.x(run.facts.started_s),
                        y=y(value),
                    )
                    for run, value in values[name]
                ),
            )
            for name in names
        ),
    )
