"""ROC and cost pictures (PNG) of the paper study."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.reporting.camera_pictures import COLOURS
from prooflight_studies.harness.picture import legend_below, new_figure, plain_axes, write_figure
from prooflight_studies.paper.results import ALPHAS, PRINTED

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from prooflight_studies.paper.results import DetectorRow, WorldResult

_SHOWN: Final = (
    "chi-square",
    "Bayesian network, as printed",
    "Bayesian network, tuned",
    "difference, 5 x 5",
    "SSIM, mean",
    "variation model",
)
_BANDED: Final = "Bayesian network, tuned"
"""Name of the row whose 95 % interval is drawn; seven overlapping bands could not be distinguished."""
_LEAST_SHOWN: Final = 0.005
_MARKED: Final = {"1 sensor": "s", "2 sensors": "o"}


def draw_roc(path: Path, results: Sequence[WorldResult]) -> None:
    """Draw misprints caught against false alarms on a log scale, one panel for each world and frame."""
    panels = [(result, frame) for result in results for frame in result.tables]
    figure, axes = _figure(len(panels))
    for axis, (result, frame) in zip(axes, panels, strict=True):
        least = 0.5 / result.good["test"]
        for row, colour in _of_frame(result, frame):
            false_alarms, caught = row.roc
            axis.step(
                np.maximum(false_alarms, least), caught, where="post", color=colour, label=row.name, lw=1.6
            )
        axis.axvline(0.01, color="#999999", lw=0.8, ls=":")
        axis.set(
            title=f"{result.plan.world} world, {frame}",
            xlabel="false alarms F [-]",
            ylabel="misprints caught, 1 - M [-]",
            xscale="log",
            xlim=(least, 1),
            ylim=(0, 1.02),
        )
    legend_below(figure, axes[0], columns=4, size_pt=9)
    write_figure(figure, path)


def draw_costs(path: Path, results: Sequence[WorldResult]) -> None:
    """Draw honest c over the cost of never or always stopping, against alpha, and the paper's own points.

    Values below the axis's range are drawn at its end.
    """
    panels = [(result, frame) for result in results for frame in result.tables]
    figure, axes = _figure(len(panels))
    alphas = np.array(ALPHAS)
    idle = np.minimum(1, alphas)
    for axis, (result, frame) in zip(axes, panels, strict=True):
        for row, colour in _of_frame(result, frame):
            values, low, high = (
                np.array([getattr(interval, part) for interval in row.honest]) / idle
                for part in ("value", "low", "high")
            )
            axis.plot(alphas, values.clip(_LEAST_SHOWN), color=colour, marker=".", lw=1.6, label=row.name)
            if row.name == _BANDED:
                axis.fill_between(alphas, low.clip(_LEAST_SHOWN), high, color=colour, alpha=0.18, lw=0)
        for name, marker in _MARKED.items():
            printed = _printed(name) / idle
            axis.plot(
                alphas, printed, marker, color="black", mfc="none", ls="", label=f"paper, {name} (oracle)"
            )
        axis.axhline(1, color="#555555", lw=1, ls=":")
        axis.annotate(
            "never or always stopping",
            (0.55, 1.08),
            xycoords=("axes fraction", "data"),
            ha="center",
            fontsize=8,
            color="#555555",
        )
        axis.set(
            title=f"{result.plan.world} world, {frame}",
            xlabel="relative cost of a miss, alpha [-]",
            ylabel="honest c over min(1, alpha) [-]",
            xscale="log",
            yscale="log",
            ylim=(_LEAST_SHOWN * 0.9, 20),
        )
    legend_below(figure, axes[0], columns=4, size_pt=9)
    write_figure(figure, path)


def _of_frame(result: WorldResult, frame: str) -> list[tuple[DetectorRow, str]]:
    rows = {row.name: row for row in result.detectors if row.frame == frame}
    return [(rows[name], colour) for name, colour in zip(_SHOWN, COLOURS, strict=False)]


def _printed(name: str) -> NDArray[np.float64]:
    return np.array([float(text) for text in PRINTED[name][1]])


def _figure(count: int) -> tuple[Figure, list[Axes]]:
    figure = new_figure(4.6 * count, 4.9)
    panels = [figure.add_subplot(1, count, place + 1) for place in range(count)]
    for axes in panels:
        plain_axes(axes)
    return figure, panels
