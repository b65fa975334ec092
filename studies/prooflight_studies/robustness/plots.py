"""The picture of the robustness study: cost against the size of each error."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.reporting.camera_pictures import COLOURS
from prooflight_studies.harness.picture import legend_below, new_figure, plain_axes, write_figure
from prooflight_studies.robustness.disturbances import AXES, NOTHING, SIZES, UNDISTURBED
from prooflight_studies.robustness.results import CHI_SQUARE, PRINTED, TUNED

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

    from prooflight_studies.robustness.disturbances import Belief
    from prooflight_studies.robustness.results import Point, RobustnessResult, When

SHOWN: Final = (CHI_SQUARE, PRINTED, TUNED, "difference, 5 x 5", "variation model")
_ROWS: Final[dict[When, str]] = {"kept": "thresholds kept", "relearned": "relearned"}
_COLUMNS: Final = 3
_LOGARITHMIC: Final = ("sigma factor", "swing", "swing, calibrated", "table noise")
_TOP: Final = 1.3
"""Upper limit of the axes: never stopping costs 1 at alpha = 1, and honest costs go a little beyond."""


def draw_robustness(path: Path, result: RobustnessResult) -> None:
    """Draw honest c at alpha = 1 against the size of each error, kept, and below it relearned; bars are 95 %."""
    beliefs = list(SIZES)
    blocks = -(-len(beliefs) // _COLUMNS)
    figure = new_figure(4.4 * _COLUMNS, 2.8 * len(_ROWS) * blocks + 0.9, dpi=100)
    panels = figure.subplots(len(_ROWS) * blocks, _COLUMNS, sharey=True)
    for place, belief in enumerate(beliefs):
        block, column = divmod(place, _COLUMNS)
        for row, (when, words) in enumerate(_ROWS.items()):
            axes = panels[block * len(_ROWS) + row][column]
            _panel(axes, result, belief, when)
            axes.set_title(f"{belief}: {words}", fontsize=11)
            axes.set_xlabel(AXES[belief] if row else "", fontsize=9)
            axes.set_ylabel("honest c at alpha = 1 [-]" if column == 0 else "", fontsize=9)
    legend_below(figure, panels[0][0], columns=len(SHOWN), size_pt=10)
    figure.suptitle(
        f"What a wrong belief costs, {result.plan.world} world; dashed: never stopping", fontsize=12
    )
    write_figure(figure, path)


def _panel(axes: Axes, result: RobustnessResult, belief: Belief, when: When) -> None:
    right = UNDISTURBED[belief]
    for place, (name, colour) in enumerate(zip(SHOWN, COLOURS, strict=False)):
        points = [point for point in result.points if point.detector == name]
        curve = {point.disturbance.size: point for point in points if point.disturbance.belief == belief}
        start = next(point for point in points if point.disturbance == NOTHING)
        if right is None:
            axes.axhline(getattr(start, when).cost.value, color=colour, lw=0.8, ls=":")
        else:
            curve[right] = start
        _curve(axes, curve, when, name, colour, place)
    plain_axes(axes)
    axes.set_ylim(-0.03, _TOP)
    axes.axhline(1, color="#888888", lw=0.8, ls="--")
    if belief in _LOGARITHMIC:
        axes.set_xscale("log")
        axes.set_xticks(list(SIZES[belief]), [f"{size:g}" for size in SIZES[belief]])
        axes.minorticks_off()
    if belief == "table noise":
        axes.invert_xaxis()
        axes.text(
            0.98,
            0.93,
            "dotted: exact tables",
            transform=axes.transAxes,
            ha="right",
            fontsize=8,
            color="#555555",
        )
    axes.tick_params(labelsize=8)
    if len(SIZES[belief]) > 4 and belief in _LOGARITHMIC:
        axes.tick_params(axis="x", labelrotation=45)


def _curve(axes: Axes, curve: dict[float, Point], when: When, name: str, colour: str, place: int) -> None:
    sizes = sorted(curve)
    costs = [getattr(curve[size], when).cost for size in sizes]
    value, low, high = (
        np.array([getattr(cost, part) for cost in costs]) for part in ("value", "low", "high")
    )
    drawn = np.array(sizes)
    axes.errorbar(
        drawn,
        value,
        yerr=np.maximum([value - low, high - value], 0),
        color=colour,
        marker="o",
        markersize=3,
        lw=1.4,
        elinewidth=0.7,
        capsize=1.5,
        label=name,
        zorder=3 + place / 10,
    )
