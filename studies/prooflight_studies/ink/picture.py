"""The learning curve of the ink study as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from prooflight_studies.harness.picture import write_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from prooflight_studies.ink.results import LearningRow

_COLOURS = {
    "log-linear": "#888888",
    "neighbours": "#b08030",
    "neugebauer": "#4878a8",
    "radial-basis": "#409060",
    "hybrid": "#c03030",
}


def draw_learning(path: Path, learning: Sequence[LearningRow], noise_median_delta_e00: float) -> None:
    """Median error on unseen recipes against patches printed, clean on the left, with noise on the right."""
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
