"""The level that is caught in nine of ten prints, by kind, place and method, before the first preset at 0.254 mm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight_studies.harness.picture import legend_below, new_figure, plain_axes, write_figure
from prooflight_studies.visible.findings import CHANCES
from prooflight_studies.visible.marks import EVERYWHERE

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from prooflight_studies.visible.findings import Cell, Curves

NINE_OF_TEN: Final = CHANCES.index(0.9)
COLOURS: Final = {
    "matched_filter": "#0b3d85",
    "difference": "#c8006f",
    "SSIM": "#8a8a82",
    "variation": "#c98a00",
}
MARKERS: Final = {"matched_filter": "o", "difference": "s", "SSIM": "^", "variation": "D"}
SHOWN: Final = ("spot", "void", "hair", "scratch", "streak", "band", "smear", "local density")
"""Kinds with several places."""
CAMERA: Final = "two sensors, 0.254 mm"


def draw_curves(path: Path, curves: Sequence[Curves]) -> None:
    """A panel a kind; the cameras' first where there is none of two sensors at 0.254 mm."""
    if not curves:
        return
    shown = next((one for one in curves if one.camera == CAMERA), curves[0])
    figure = new_figure(13.5, 6.4)
    grid = figure.add_gridspec(2, 4)
    for at, kind in enumerate(SHOWN):
        axes = figure.add_subplot(grid[divmod(at, 4)])
        _panel(axes, [cell for cell in shown.cells if cell.kind == kind])
        axes.set_title(
            f"{kind} [{next(cell.unit for cell in shown.cells if cell.kind == kind)}]", fontsize=10
        )
    legend_below(figure, figure.axes[0], columns=4, size_pt=10)
    figure.suptitle(
        f"Caught in 9 of 10 prints ({shown.camera} a pixel); lower is better; hollow: more than was printed",
        fontsize=11,
    )
    write_figure(figure, path)


def _panel(axes: Axes, cells: Sequence[Cell]) -> None:
    plain_axes(axes)
    places = [place for place in EVERYWHERE if any(cell.place == place for cell in cells)]
    by_place = {cell.place: cell for cell in cells}
    for name, colour in COLOURS.items():
        axes.plot([], [], MARKERS[name], color=colour, label=name)
    for shift, name in zip((-0.24, -0.08, 0.08, 0.24), COLOURS, strict=True):
        for x, place in enumerate(places):
            cell = by_place[place]
            level = next(one for one in cell.methods if one.method == name).at[NINE_OF_TEN]
            top = cell.greatest
            beyond = level.value > top
            axes.plot(
                x + shift,
                min(level.value, top),
                MARKERS[name],
                color=COLOURS[name],
                markerfacecolor="white" if beyond else COLOURS[name],
                markersize=6,
            )
            if not beyond:
                axes.plot(
                    [x + shift] * 2, [level.low, min(level.high, top)], color=COLOURS[name], linewidth=1
                )
    axes.set_yscale("log")
    ticks = np.geomspace(cells[0].least, cells[0].greatest, 3)
    axes.set_yticks(ticks, [f"{tick:.2g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xticks(range(len(places)), places)
    axes.set_xlim(-0.5, len(places) - 0.5)
    axes.set_ylim(0.7 * cells[0].least, 1.3 * cells[0].greatest)
