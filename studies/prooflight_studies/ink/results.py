"""Results of the ink study, and its learning curve as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from prooflight_studies.harness.picture import write_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from prooflight.inks.selection import Score

_COLOURS = {
    "log-linear": "#888888",
    "neighbours": "#b08030",
    "neugebauer": "#4878a8",
    "radial-basis": "#409060",
    "hybrid": "#c03030",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRow:
    """Results of one model on the whole chart."""

    model: str
    score: Score
    fit_cpu_s: float
    predict_17_cpu_s: float
    """CPU time for 17^4 = 83,521 recipes."""
    predict_33_cpu_s: float
    """CPU time for 33^4 = 1,185,921 recipes."""
    lowest: float
    highest: float
    """Highest reflectance on the 17^4 grid; ``lowest``: the lowest. [-]"""
    rise: float
    """Greatest rise of any band from one grid node to the next with more of one ink. [-]"""
    beyond_limit_delta_e00: float
    """Largest error on recipes beyond 300 % ink when none of them was used in the fit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningRow:
    """Results of one model fitted to some well-chosen patches and evaluated on all others."""

    model: str
    patches: int
    noise_delta_e00: float
    median_delta_e00: float
    p95_delta_e00: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SpreadRow:
    """Check of the predicted standard deviations: errors on unseen recipes relative to them."""

    patches: int
    rms: float
    within_1: float
    within_2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class InkStudy:
    """All results that the page shows."""

    chart: str
    digest: str
    patches: int
    recipes: int
    folds: int
    measured_rise: float
    """Greatest rise between measured recipes that differ in more of one ink alone. [-]"""
    models: tuple[ModelRow, ...]
    learning: tuple[LearningRow, ...]
    noise_median_delta_e00: float
    """Median of the added noise; its mean is ``LearningRow.noise_delta_e00``."""
    spread: tuple[SpreadRow, ...]


def draw_learning(path: Path, learning: Sequence[LearningRow], noise_median_delta_e00: float) -> None:
    """Draw the median error on unseen recipes against patches printed, clean on the left, with noise on the right."""
    figure = Figure(figsize=(9.0, 4.0), dpi=110, layout="constrained")
    noises = sorted({row.noise_delta_e00 for row in learning})
    first = None
    for place, noise in enumerate(noises, start=1):
        axes = figure.add_subplot(1, len(noises), place, sharey=first)
        first = first or axes
        for model in dict.fromkeys(row.model for row in learning):
            rows = [row for row in learning if row.model == model and row.noise_delta_e00 == noise]
            patches = [row.patches for row in rows]
            colour = _COLOURS.get(model, "#222222")
            axes.plot(
                patches, [row.median_delta_e00 for row in rows], "o-", color=colour, markersize=4, label=model
            )
        if noise:
            axes.axhline(noise_median_delta_e00, color="#222222", linewidth=0.8, linestyle=":")
            axes.text(patches[0], noise_median_delta_e00 * 0.95, "the noise itself", va="top", fontsize=8)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(patches, [str(size) for size in patches])
        axes.minorticks_off()
        axes.set_yticks(
            [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5], ["0.02", "0.05", "0.1", "0.2", "0.5", "1", "2", "5"]
        )
        axes.set_xlabel("patches printed and measured")
        axes.set_title(
            f"with measurement noise of {noise:g} CIEDE2000 (mean)" if noise else "as measured", fontsize=10
        )
        axes.grid(visible=True, color="#dddddd", linewidth=0.5)
        axes.spines[["top", "right"]].set_visible(False)
        if place == 1:
            axes.set_ylabel("median CIEDE2000 on all other recipes")
            axes.legend(fontsize=8, frameon=False, loc="lower left")
    write_figure(figure, path)
