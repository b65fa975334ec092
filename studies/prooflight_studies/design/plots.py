"""The picture of the design study: cost of errors against cost of hardware and computing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight.reporting.camera_pictures import COLOURS
from prooflight_studies.harness.picture import legend_below, new_figure, plain_axes, write_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from prooflight_studies.design.results import DesignRow

_ROOM = 0.25


def draw_designs(path: Path, rows: Sequence[DesignRow], *, detector: str) -> None:
    """Draw one panel a world: designs with 95 % intervals, efficient ones filled and joined, the least total dotted."""
    worlds = list(dict.fromkeys(row.world for row in rows))
    figure = new_figure(6.2 * len(worlds), 4.8, pads_inch=(0.1, 0.08))
    designs = list(dict.fromkeys(row.design for row in rows))
    colours = {design: COLOURS[place % len(COLOURS)] for place, design in enumerate(designs)}
    for place, world in enumerate(worlds):
        axes = figure.add_subplot(1, len(worlds), place + 1)
        _panel(axes, [row for row in rows if row.world == world], colours)
        axes.set_title(f"{world} world")
    legend_below(figure, figure.axes[0], columns=2, size_pt=8.5)
    figure.suptitle(f"What each design costs, detector {detector}; filled: efficient", fontsize=11)
    write_figure(figure, path)


def _panel(axes: Axes, rows: Sequence[DesignRow], colours: dict[str, str]) -> None:
    bought = np.array([row.bought_cents for row in rows])
    left, right = bought.min(), bought.max()
    margin = _ROOM * (right - left) if right > left else 1.0
    for row in rows:
        errors, colour = row.error_cents, colours[row.design]
        axes.errorbar(
            row.bought_cents,
            errors.value,
            yerr=[[max(errors.value - errors.low, 0)], [max(errors.high - errors.value, 0)]],
            color=colour,
            marker="o",
            markersize=8,
            markerfacecolor=colour if row.efficient else "white",
            markeredgewidth=1.6,
            elinewidth=1.0,
            capsize=3,
            linestyle="none",
            label=row.design,
            zorder=3,
        )
    front = sorted((row.bought_cents, row.error_cents.value) for row in rows if row.efficient)
    axes.plot(*zip(*front, strict=True), color="#777777", lw=1.2, zorder=1)
    least = min(row.total_cents for row in rows)
    x = np.array([left - margin, right + margin])
    axes.plot(x, least - x, ":", color="#777777", lw=1.0, zorder=1)
    top = np.nanmax([(row.error_cents.value, row.error_cents.high) for row in rows])
    axes.set(
        xlabel="hardware and computing [cents per 10,000 pages]",
        ylabel="false alarms and misses [cents per 10,000 pages]",
        xlim=(left - margin, right + margin),
        ylim=(0, 1.08 * top if top > 0 else 1),
    )
    axes.text(
        0.98,
        0.98,
        f"dotted: {least:.3g} cents in all, the least",
        transform=axes.transAxes,
        ha="right",
        va="top",
        fontsize=8,
        color="#666666",
    )
    plain_axes(axes)
