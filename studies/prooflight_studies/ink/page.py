"""What the ink study found, and its page: tables as Markdown, the learning curve as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan
from typing import TYPE_CHECKING

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from collections.abc import Iterable
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
    """One model on the whole chart."""

    model: str
    score: Score
    fit_cpu_s: float
    predict_17_cpu_s: float
    """CPU time for 17^4 = 83,521 recipes."""
    predict_33_cpu_s: float
    """CPU time for 33^4 = 1,185,921 recipes."""
    lowest: float
    highest: float
    """Reflectance on the 17^4 grid. [-]"""
    rise: float
    """Greatest rise of any band from one grid node to the next with more of one ink. [-]"""
    beyond_limit_delta_e00: float
    """Largest error on recipes beyond 300 % ink when none of them was learned from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningRow:
    """One model taught by some well-chosen patches, judged on all others."""

    model: str
    patches: int
    noise_delta_e00: float
    median_delta_e00: float
    p95_delta_e00: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SpreadRow:
    """Are the standard deviations right? Errors on unseen recipes over their predicted standard deviation."""

    patches: int
    rms: float
    within_1: float
    within_2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class InkStudy:
    """Everything the result page shows."""

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


def write_ink_results(results: Path, study: InkStudy) -> None:
    """Write ``ink.md`` and ``ink-learning.png`` whole or not at all."""
    picture = results / "ink-learning.png"
    with whole_file(picture) as unfinished:
        learning_figure(study).savefig(unfinished, format="png", metadata={"Software": None})
    page = results / "ink.md"
    with whole_file(page) as unfinished:
        unfinished.write_text("\n".join(_page(study)) + "\n", encoding="utf-8")


def learning_figure(study: InkStudy) -> Figure:
    """Median error on unseen recipes against patches printed, clean on the left, with noise on the right."""
    figure = Figure(figsize=(9.0, 4.0), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    noises = sorted({row.noise_delta_e00 for row in study.learning})
    first = None
    for place, noise in enumerate(noises, start=1):
        axes = figure.add_subplot(1, len(noises), place, sharey=first)
        first = first or axes
        for model in dict.fromkeys(row.model for row in study.learning):
            rows = [row for row in study.learning if row.model == model and row.noise_delta_e00 == noise]
            patches = [row.patches for row in rows]
            colour = _COLOURS.get(model, "#222222")
            axes.plot(
                patches, [row.median_delta_e00 for row in rows], "o-", color=colour, markersize=4, label=model
            )
        if noise:
            axes.axhline(study.noise_median_delta_e00, color="#222222", linewidth=0.8, linestyle=":")
            axes.text(
                patches[0], study.noise_median_delta_e00 * 0.95, "the noise itself", va="top", fontsize=8
            )
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
    return figure


def _page(study: InkStudy) -> Iterable[str]:
    yield "# Ink: how well the printed page's spectrum is predicted"
    yield ""
    yield "Written by `prooflight study ink`; do not edit."
    yield ""
    yield (
        f"Chart: {study.chart}, {study.patches} patches of {study.recipes} recipes (digest `{study.digest[:16]}`). "
        "Colour differences are CIEDE2000 under D50 for the 2-degree observer. **Its makers averaged and smoothed this "
        "chart** (380 nm repeats 390 nm, repeated recipes are identical to the last digit), so errors of a few "
        "hundredths say that the models follow the makers' smoothing, not that a press repeats so well."
    )
    yield ""
    yield from _models(study)
    yield from _between(study)
    yield from _learning(study)
    yield from _spread(study)


def _models(study: InkStudy) -> Iterable[str]:
    yield f"## Models, {study.folds}-fold cross-validation by recipe"
    yield ""
    yield (
        "`log-linear` is the paper's equation 1, `neighbours` its interpolation of the nearest patches. CPU seconds on "
        "one core of the machine that wrote this page, for the fit and for predicting 17^4 and 33^4 recipes."
    )
    yield ""
    head = ("model", "median", "95 %", "largest", "rms reflectance", "fit", "17^4", "33^4")
    yield from _table(
        head,
        (
            (
                row.model,
                f"{row.score.median_delta_e00:.3f}",
                f"{row.score.p95_delta_e00:.3f}",
                f"{row.score.max_delta_e00:.2f}",
                f"{row.score.rms_reflectance:.5f}",
                f"{row.fit_cpu_s:.2f} s",
                f"{row.predict_17_cpu_s:.2f} s",
                "" if isnan(row.predict_33_cpu_s) else f"{row.predict_33_cpu_s:.1f} s",
            )
            for row in study.models
        ),
    )
    yield ""


def _between(study: InkStudy) -> Iterable[str]:
    yield "## Between and beyond the patches"
    yield ""
    yield (
        "Reflectance on a grid of 17 steps of each ink; the greatest rise of any band from one node to the next with "
        f"more of one ink (the chart itself rises by up to {study.measured_rise:.4f} from one measured recipe to the "
        "next); and the largest CIEDE2000 on recipes beyond 300 % ink when none of them was learned from."
    )
    yield ""
    yield from _table(
        ("model", "lowest", "highest", "greatest rise", "beyond 300 %"),
        (
            (
                row.model,
                f"{row.lowest:.4f}",
                f"{row.highest:.4f}",
                f"{row.rise:.4f}",
                f"{row.beyond_limit_delta_e00:.2f}",
            )
            for row in study.models
        ),
    )
    yield ""


def _learning(study: InkStudy) -> Iterable[str]:
    yield "## How many patches to print"
    yield ""
    yield (
        "Solids and overprints, then one by one the recipe that lowers the mean uncertainty over all recipes most, "
        "chosen without looking at a measurement. Median / 95 % of CIEDE2000 on all recipes not printed. Noise is "
        "added to what is learned from, half smooth in wavelength (ink film), half white (instrument); the judge "
        "stays the chart as measured."
    )
    yield ""
    yield "![Median error against number of patches, without and with measurement noise](ink-learning.png)"
    yield ""
    yield from _learning_tables(study)
    yield from _advice(study)


def _advice(study: InkStudy) -> Iterable[str]:
    """From how many patches on the best model is closer to the chart than one noisy measurement is."""
    noisy = [row for row in study.learning if row.noise_delta_e00]
    best = min(noisy, key=lambda row: row.median_delta_e00).model
    noise = study.noise_median_delta_e00
    enough = [row.patches for row in noisy if row.model == best and row.median_delta_e00 <= noise]
    if enough:
        yield (
            f"With {enough[0]} patches or more, `{best}` predicts unprinted recipes no worse than one such "
            f"measurement would tell them (median {noise:.3f})."
        )
        yield ""


def _spread(study: InkStudy) -> Iterable[str]:
    yield "## Does it know how sure it is?"
    yield ""
    yield (
        "The best model, taught well-chosen patches, predicts the others with a standard deviation from its own "
        "cross-validation. Error over standard deviation, all bands: rms should be 1, 68 % within 1, 95 % within 2; "
        "with few patches it is too modest, because each fold then misses patches that the final model has."
    )
    yield ""
    yield from _table(
        ("patches", "rms", "within 1", "within 2"),
        (
            (str(row.patches), f"{row.rms:.2f}", f"{100 * row.within_1:.0f} %", f"{100 * row.within_2:.0f} %")
            for row in study.spread
        ),
    )


def _learning_tables(study: InkStudy) -> Iterable[str]:
    models = list(dict.fromkeys(row.model for row in study.learning))
    for noise in sorted({row.noise_delta_e00 for row in study.learning}):
        cells = {(row.patches, row.model): row for row in study.learning if row.noise_delta_e00 == noise}
        yield f"With noise of {noise:g} CIEDE2000:" if noise else "As measured:"
        yield ""
        yield from _table(
            ("patches", *models),
            (
                (
                    str(size),
                    *(
                        f"{cells[size, model].median_delta_e00:.3f} / {cells[size, model].p95_delta_e00:.2f}"
                        for model in models
                    ),
                )
                for size in dict.fromkeys(row.patches for row in study.learning)
            ),
        )
        yield ""


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> Iterable[str]:
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(row) + " |"
