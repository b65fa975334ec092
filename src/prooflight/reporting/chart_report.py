"""Report of a model's accuracy on a chart: one HTML file with its figures inside."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from prooflight.files.atomic import whole_file
from prooflight.reporting.html import data_uri, template
from prooflight.spectra import WAVE_NM, delta_e00, lab, srgb_encoded, xyz

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from prooflight.inks.chart import Chart, Recipes
    from prooflight.inks.selection import CrossValidation, Score

_SHOWN: Final = {
    "paper": (0, 0, 0, 0),
    "cyan": (1, 0, 0, 0),
    "magenta": (0, 1, 0, 0),
    "yellow": (0, 0, 1, 0),
    "black": (0, 0, 0, 1),
    "red": (0, 1, 1, 0),
    "green": (1, 0, 1, 0),
    "blue": (1, 1, 0, 0),
    "half tone C M Y": (0.5, 0.4, 0.4, 0),
    "quarter tone C": (0.25, 0, 0, 0),
    "C M Y": (1, 1, 1, 0),
    "all four": (1, 1, 1, 1),
}
_WORST: Final = 12
_COLUMNS: Final = 4

# Linear sRGB from XYZ under D50: IEC 61966-2-1 with Bradford adaptation, as in the sRGB ICC profile.
_SRGB: Final = np.array(
    [
        [3.1338561, -1.6168667, -0.4906146],
        [-0.9787684, 1.9161415, 0.0334540],
        [0.0719453, -0.2289914, 1.4052427],
    ]
)


def write_chart_report(
    path: Path,
    chart: Chart,
    trial: CrossValidation,
    *,
    scores: Mapping[str, Score],
    why: str,
) -> None:
    """Write the report of one cross-validation, self-contained and atomic.

    ``scores`` lists models to compare, ``why`` is the sentence at the top.
    """
    recipes = chart.recipes()
    difference = delta_e00(lab(trial.predicted), lab(recipes.reflectance))
    worst = np.argsort(-difference, kind="stable")[:_WORST]
    scatter = chart.scatter()
    html = template("chart_report").render(
        title=f"Ink model {trial.model}",
        why=why,
        patches=len(chart),
        recipes=len(recipes.cmyk),
        folds=trial.folds,
        repeats=""
        if scatter is None
        else f" Repeated patches are {scatter.median_delta_e00:.2f} from their mean (median).",
        scores=_score_rows(scores, trial.model),
        histogram=_embedded(histogram(difference[recipes.of_patch])),
        spectra=_embedded(_spectra_figure(recipes, trial.predicted, difference)),
        worst=_embedded(
            _small_multiples(
                recipes, trial.predicted, difference, {_percent(recipes.cmyk[i]): i for i in worst}
            )
        ),
        worst_rows=[
            {
                "recipe": _percent(recipes.cmyk[row]),
                "measured": _css(recipes.reflectance[row]),
                "predicted": _css(trial.predicted[row]),
                "difference": f"{difference[row]:.2f}",
            }
            for row in worst
        ],
    )
    with whole_file(path) as unfinished:
        unfinished.write_text(html, encoding="utf-8")


def histogram(difference: NDArray[np.float64]) -> Figure:
    """Plot the share of patches by colour difference (n,), on a logarithmic axis, with median and 95 % marked."""
    figure = Figure(figsize=(9.0, 3.2), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    low = max(float(np.percentile(difference, 0.5)), 1e-3)
    bins = np.geomspace(low, max(float(difference.max()), 2 * low) * 1.01, 41)
    share = np.full(len(difference), 100.0 / len(difference))
    axes.hist(
        np.maximum(difference, low),
        bins=list(bins),
        weights=share,
        color="#4878a8",
        edgecolor="white",
        linewidth=0.4,
    )
    for percentile, label in ((50, "median"), (95, "95 %")):
        value = float(np.percentile(difference, percentile))
        axes.axvline(value, color="#c03030", linewidth=1.2)
        note = f" {label}: {value:.3f}"
        axes.text(value, 0.97, note, color="#c03030", va="top", transform=axes.get_xaxis_transform())
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("CIEDE2000, predicted against measured")
    axes.set_ylabel("patches, %")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _spectra_figure(
    recipes: Recipes, predicted: NDArray[np.float64], difference: NDArray[np.float64]
) -> Figure:
    """Plot solids, overprints and tints, or the measured recipes nearest to them."""
    distance = [np.abs(recipes.cmyk - np.array(wanted)).sum(axis=1) for wanted in _SHOWN.values()]
    nearest = [int(away.argmin()) for away in distance]
    return _small_multiples(recipes, predicted, difference, dict(zip(_SHOWN, nearest, strict=True)))


def _small_multiples(
    recipes: Recipes,
    predicted: NDArray[np.float64],
    difference: NDArray[np.float64],
    shown: Mapping[str, int],
) -> Figure:
    """Plot one small pair of axes for each recipe: measured as dots, predicted as a line."""
    lines = -(-len(shown) // _COLUMNS)
    figure = Figure(figsize=(9.0, 2.1 * lines + 0.3), dpi=110, layout="constrained")
    for place, (label, row) in enumerate(shown.items(), start=1):
        axes = figure.add_subplot(lines, _COLUMNS, place)
        _spectrum(axes, recipes.reflectance[row], predicted[row])
        recipe = _percent(recipes.cmyk[row])
        head = recipe if label == recipe else f"{label} ({recipe})"
        axes.set_title(f"{head}\nCIEDE2000 {difference[row]:.2f}", fontsize=8)
        if place > len(shown) - _COLUMNS:
            axes.set_xlabel("nm", fontsize=8)
        if place % _COLUMNS == 1:
            axes.set_ylabel("reflectance", fontsize=8)
        if place == 1:
            axes.legend(fontsize=7, frameon=False)
    return figure


def _spectrum(axes: Axes, measured: NDArray[np.float64], predicted: NDArray[np.float64]) -> None:
    axes.plot(WAVE_NM, predicted, color="#c03030", linewidth=1.2, label="predicted")
    axes.plot(WAVE_NM, measured, ".", color="#222222", markersize=2.6, label="measured")
    axes.set_ylim(0.0, 1.08 * max(float(measured.max()), float(predicted.max())))
    axes.set_xlim(WAVE_NM[0], WAVE_NM[-1])
    axes.set_xticks([400, 500, 600, 700])
    axes.tick_params(labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)


def _score_rows(scores: Mapping[str, Score], chosen: str) -> list[dict[str, object]]:
    return [
        {
            "name": name,
            "chosen": name == chosen,
            "median": f"{score.median_delta_e00:.3f}",
            "p95": f"{score.p95_delta_e00:.3f}",
            "max": f"{score.max_delta_e00:.2f}",
            "rms": f"{score.rms_reflectance:.5f}",
        }
        for name, score in scores.items()
    ]


def _percent(recipe: NDArray[np.float64]) -> str:
    return " ".join(f"{100 * ink:.0f}" for ink in recipe)


def _css(reflectance: NDArray[np.float64]) -> str:
    """Return the colour under D50 as CSS, clipped to sRGB."""
    red, green, blue = np.round(255 * srgb_encoded(_SRGB @ xyz(reflectance))).astype(int).tolist()
    return f"rgb({red}, {green}, {blue})"


def _embedded(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return data_uri(buffer.getvalue(), "png")
