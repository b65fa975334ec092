"""Geometry of the SVG drawings of pages: heat maps, bars and trends. Templates draw them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight.cmyk import INK_NAMES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from prooflight_console.pages.language import Language
    from prooflight_console.quality.pareto import Group
    from prooflight_console.quality.trends import Drift

A4_MM: Final = (210.0, 297.0)
"""Least size at which a page is drawn: the journal does not store the size of pages."""
STEPS: Final = 5
"""Number of steps of colour: more cannot be distinguished in print."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A run of cells of a row that have the same step."""

    x_mm: float
    y_mm: float
    width_mm: float
    step: int
    """Step of colour, from 1 to ``STEPS``."""
    count: int
    """Greatest count in the run of cells."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeatMap:
    """Density of misprints over the page."""

    width_mm: float
    height_mm: float
    cell_mm: float
    cells: tuple[Cell, ...]
    most: int
    bounds: tuple[tuple[int, int], ...]
    """Least and greatest count of each step; steps that no count falls into are left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """A row of a bar chart."""

    name: str
    count: int
    share: float
    """Length relative to the longest bar, 0..1."""


def heat_drawing(heat: dict[str, Any]) -> HeatMap:
    """Return the drawing of a heat map of ``report.heat_map``."""
    rows, cell = heat["rows"], float(heat["cell_mm"])
    most = max((max(row) for row in rows), default=0)
    cells: list[Cell] = []
    for at, row in enumerate(rows):
        start = 0
        for column in range(1, len(row) + 1):
            if column < len(row) and step_of(row[column], most) == step_of(row[start], most):
                continue
            if step := step_of(row[start], most):
                many = max(row[start:column])
                cells.append(
                    Cell(
                        x_mm=start * cell,
                        y_mm=at * cell,
                        width_mm=(column - start) * cell,
                        step=step,
                        count=many,
                    )
                )
            start = column
    steps: dict[int, list[int]] = {}
    for count in range(1, most + 1) if most <= 10_000 else ():
        steps.setdefault(step_of(count, most), []).append(count)
    width = max([A4_MM[0], *(len(row) * cell for row in rows)])
    return HeatMap(
        width_mm=width,
        height_mm=max(A4_MM[1], len(rows) * cell),
        cell_mm=cell,
        cells=tuple(cells),
        most=most,
        bounds=tuple((counts[0], counts[-1]) for _, counts in sorted(steps.items())),
    )


def step_of(count: int, most: int) -> int:
    """Return the step of colour of a count; 0 if the count is 0. Few counts get steps of their own."""
    if not count:
        return 0
    return math.ceil(STEPS * count / most) if most > STEPS else STEPS - most + count


def bars(counts: dict[str, int]) -> list[Bar]:
    """Return the bars of named counts, in their order."""
    most = max(counts.values(), default=0)
    return [Bar(name=name, count=count, share=count / most) for name, count in counts.items()]


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """A row of a Pareto chart."""

    group: Group
    value: float
    length: float
    """Length relative to the longest bar, 0..1."""
    cumulated: float
    """Share that this group and all before it have of all groups shown, 0..1."""


def shares(groups: Sequence[Group], values: Sequence[float]) -> list[Share]:
    """Return the rows of a Pareto chart of groups, the greatest first. values: number or cost of each."""
    total, most, running = sum(values), max(values, default=0.0), 0.0
    rows = []
    for group, value in zip(groups, values, strict=True):
        running += value
        length, cumulated = (value / most, running / total) if most else (0.0, 0.0)
        rows.append(Share(group=group, value=value, length=length, cumulated=cumulated))
    return rows


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftChart:
    """Lines of one chart of drifts over periods, each period 10 units wide, in a drawing 100 units high."""

    lines: tuple[tuple[Drift, str], ...]
    """Each drift with the path of its line; a period without a value leaves a gap."""
    zero: float
    least: float
    greatest: float
    unit: str


def drift_lines(drifts: Sequence[Drift], chart: str) -> DriftChart | None:
    """Return the drawing of the drifts of one chart; None if there are none."""
    chosen = [one for one in drifts if one.chart == chart]
    values = [mean for one in chosen for mean in one.means if mean is not None]
    if not values:
        return None
    least, greatest = min(*values, 0.0), max(*values, 0.0)
    span = (greatest - least) or 1.0

    def height(value: float) -> float:
        return 96 - 92 * (value - least) / span

    lines = []
    for one in chosen:
        path, connected = "", False
        for at, mean in enumerate(one.means):
            if mean is not None:
                # A step as wide as its period, so that a single one is seen.
                path += f"{'L' if connected else 'M'}{10 * at + 1} {height(mean):.1f}H{10 * at + 9}"
            connected = mean is not None
        lines.append((one, path))
    return DriftChart(
        lines=tuple(lines), zero=height(0.0), least=least, greatest=greatest, unit=chosen[0].unit
    )


def channel_colour(channel: str, at: int) -> str:
    """Return the class of a channel's colour: that of its ink, or one of six by its place in the chart."""
    ink = next((part for part in channel.split("-") if part in INK_NAMES), None)
    return f"ink-{ink}" if ink else f"line-{at % 6}"


def channel_name(t: Language, channel: str) -> str:
    """Return the name of a channel within its chart."""
    group, part, *_ = channel.split("-")
    return f"{t('chart.wave')} {part}" if group == "lamp" else t.named("chart", part)
