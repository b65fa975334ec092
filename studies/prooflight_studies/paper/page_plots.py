"""Pictures (PNG) like the paper's figures 7 and 8, of any press and page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.detectors.paper.bayes import SHARE_SIGMAS
from prooflight.reporting.camera_pictures import COLOURS
from prooflight_studies.harness.operating import area_under_roc, least_cost, roc
from prooflight_studies.harness.picture import new_figure, plain_axes, write_figure
from prooflight_studies.paper.page_samples import SIDE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from prooflight_studies.harness.operating import Scored
    from prooflight_studies.paper.page_samples import Samples

_NAMES: Final = ("mean", "minimum", f"share below {SHARE_SIGMAS:g}")
_BARS: Final = 28
_ALPHAS: Final = np.geomspace(1e-3, 1e2, 61)
_LINEAR: Final = 3.0
"""Range about the good copies in which the axis is linear, in spreads; misprints are up to thousands off."""


def draw_statistics(path: Path, samples: Samples) -> None:
    """Draw histograms of the three statistics, good copies and both types of misprint, a row a sensor; figure 7."""
    rows = len(samples.sensors)
    figure = new_figure(12.5, 3.1 * rows + 0.7, pads_inch=(0.08, 0.08))
    panels = figure.subplots(rows, 3, squeeze=False)
    for row, sensor in enumerate(samples.sensors):
        for column, name in enumerate(_NAMES):
            _histogram(panels[row][column], samples.statistics[:, row, column], samples)
            panels[row][column].set_xlabel(f"{name} of {SIDE} x {SIDE} window means, sensor {sensor} [sigma]")
        panels[row][2].set_xlabel(f"{_NAMES[2]} sigma, sensor {sensor} [-]")
        panels[row][0].set_ylabel("share of copies [-]")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=10)
    figure.suptitle(
        f"One page, ideal world, {samples.pitch_mm:.3g} mm a pixel; axes are logarithmic far from good copies",
        fontsize=11,
    )
    write_figure(figure, path)


def _histogram(axes: Axes, values: NDArray[np.float64], samples: Samples) -> None:
    good = values[samples.types == "correct"]
    spread = max(_LINEAR * float(good.std()), 1e-6)
    middle = float(good.mean())
    away = np.arcsinh((values - middle) / spread)  # even bars on an axis that is linear near good copies
    edges = middle + spread * np.sinh(np.linspace(away.min(), away.max() + 1e-9, _BARS + 1))
    for place, name in enumerate(("correct", "global", "local")):
        of_type = values[samples.types == name]
        if of_type.size == 0:
            continue
        share = np.histogram(of_type, edges)[0] / of_type.size
        label = f"{'good' if name == 'correct' else name + ' misprints'} ({of_type.size})"
        axes.stairs(
            share,
            np.arange(_BARS + 1),
            color=COLOURS[(2, 1, 0)[place]],
            fill=place == 0,
            alpha=0.35 if place == 0 else 1,
            lw=1.6,
            label=label,
        )
    ticks = np.linspace(0, _BARS, 7).round().astype(int)
    axes.set_xticks(ticks, [_short(float(edges[tick])) for tick in ticks])
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _short(value: float) -> str:
    """Format a number with two digits without an exponent.

    >>> [_short(value) for value in (-3123.4, -12.3, 0.0312, 0.497)]
    ['-3,123', '-12', '0.031', '0.5']
    """
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.2g}"


def draw_operating(path: Path, judged: Mapping[str, Scored]) -> None:
    """Draw the ROC, and least cost against alpha; figure 8. Thresholds are chosen on the same copies."""
    figure = new_figure(10.5, 4.4, pads_inch=(0.08, 0.08))
    left, right = figure.subplots(1, 2)
    first = next(iter(judged.values()))
    good, bad = int((~first.bad).sum()), int(first.bad.sum())
    for (name, pages), colour in zip(judged.items(), COLOURS, strict=False):
        false_alarms, caught = roc(pages)
        label = f"{name}, area {area_under_roc(pages):.3f}"
        left.step(false_alarms, caught, where="post", color=colour, lw=1.8, label=label)
        costs = [least_cost(pages, alpha).cost(alpha) for alpha in _ALPHAS.tolist()]
        right.plot(_ALPHAS, costs, color=colour, lw=1.8, label=name)
    left.set(
        xlabel="false alarms F [-]",
        ylabel="misprints caught, 1 - M [-]",
        title=f"{good} good copies, {bad} misprints",
        xlim=(-0.02, 1.02),
        ylim=(-0.02, 1.02),
    )
    right.plot(
        _ALPHAS, np.minimum(1, _ALPHAS), ":", color="#555555", lw=1.2, label="never or always stopping"
    )
    right.set(
        xlabel="relative cost of a miss, alpha [-]",
        ylabel="least cost c = F + alpha M [-]",
        title="Cost at the best threshold of these copies",
        xscale="log",
        ylim=(0, 1.05),
    )
    for axes in (left, right):
        plain_axes(axes)
        axes.legend(frameon=False, fontsize=9)
    write_figure(figure, path)
