"""Accuracy of predicted spectra of a printed page: all models on one chart, and the number of patches needed."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.figure import Figure

from prooflight.inks.chart import read_chart
from prooflight.inks.ink_model import Spread
from prooflight.inks.recipes import choose_recipes
from prooflight.inks.selection import MODELS, cross_validate, fit_model, fold_of_recipe
from prooflight.rng import stream
from prooflight.spectra import WAVE_NM, delta_e00, lab
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.picture import write_figure

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.inks.chart import Chart, Recipes
    from prooflight.inks.selection import Score

BEST: Final = "hybrid"
_STUDIED: Final = tuple(MODELS)
LEARNERS: Final = ("log-linear", "neighbours", "neugebauer", "radial-basis", BEST)
SIZES: Final = (25, 50, 100, 200, 400, 800, 1338)
NOISE_DELTA_E00: Final = 0.3
"""Mean colour difference due to the added measurement noise."""
NOISE_DRAWS: Final = 3
INK_LIMIT: Final = 3.0
_NOISE_CENTRES_NM: Final = np.array([430.0, 530.0, 630.0])
_NOISE_WIDTH_NM: Final = 60.0


def run_ink_study(
    chart_path: Path,
    results: Path,
    *,
    folds: int = 10,
    seed: int = 0,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
) -> list[dict[str, Any]]:
    """Study a chart; write ``ink.md`` and ``ink-learning.png`` into ``results``; return the rows of the model table.

    ``quick`` takes fewer sizes, one draw of noise and no 33^4 grid. ChartError: the chart cannot be used.
    """
    chart = read_chart(chart_path)
    study = InkStudy(
        chart=dict(chart.keywords).get("DESCRIPTOR", chart_path.name),
        digest=chart.digest,
        patches=len(chart),
        recipes=len(chart.recipes().cmyk),
        folds=folds,
        measured_rise=measured_rise(chart.recipes()),
        models=tuple(_model_row(chart, name, folds, seed, quick, progress) for name in _STUDIED),
        learning=tuple(learning_curves(chart, seed=seed, quick=quick, progress=progress)),
        noise_median_delta_e00=_noise_median(chart, seed),
        spread=tuple(
            spread_check(chart, patches, seed) for patches in _sizes(chart, quick) if patches >= 100
        ),
    )
    draw_learning(results / "ink-learning.png", study.learning, study.noise_median_delta_e00)
    write_page(results / "ink.md", "ink", study)
    return [{"model": row.model, **row.score.as_json()} for row in study.models]


def learning_curves(
    chart: Chart, *, seed: int = 0, quick: bool = False, progress: Callable[[str], None] = lambda _step: None
) -> list[LearningRow]:
    """Return the error on the recipes not chosen, by number of chosen patches, with clean and with noisy measurements.

    Models are fitted to noisy spectra and evaluated on the chart as measured.
    """
    recipes = chart.recipes()
    order = choose_recipes(recipes.cmyk, max(_sizes(chart, quick)))
    draws = stream(seed, "ink-noise").spawn(1 if quick else NOISE_DRAWS)
    noisy = [with_noise(recipes.reflectance, NOISE_DELTA_E00, rng) for rng in draws]
    rows = []
    for size in _sizes(chart, quick):
        progress(f"{size} patches")
        for noise, training in ((0.0, [recipes.reflectance]), (NOISE_DELTA_E00, noisy)):
            for model in LEARNERS:
                error = np.concatenate(
                    [_error_on_rest(recipes, spectra, order[:size], model) for spectra in training]
                )
                rows.append(
                    LearningRow(
                        model=model,
                        patches=size,
                        noise_delta_e00=noise,
                        median_delta_e00=float(np.median(error)),
                        p95_delta_e00=float(np.percentile(error, 95)),
                    )
                )
    return rows


def with_noise(
    reflectance: NDArray[np.float64], mean_delta_e00: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Add noise to measured spectra (n, 36) that makes ``mean_delta_e00`` on average.

    Half of it (in log reflectance) varies smoothly, as ink film and paper do from print to print: three bumps 60 nm
    wide; half is white, as an instrument's. Assumed: no user's scatter is known.
    """
    bumps = np.exp(-0.5 * ((WAVE_NM - _NOISE_CENTRES_NM[:, None]) / _NOISE_WIDTH_NM) ** 2)
    pattern = rng.normal(size=(len(reflectance), len(bumps))) @ bumps + rng.normal(size=reflectance.shape)
    clean = lab(reflectance)
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        difference = delta_e00(lab(reflectance * np.exp(middle * pattern)), clean).mean()
        low, high = (low, middle) if difference > mean_delta_e00 else (middle, high)
    return np.asarray(reflectance * np.exp(low * pattern), dtype=np.float64)


def spread_check(chart: Chart, patches: int, seed: int) -> SpreadRow:
    """Fit the best model to ``patches`` well-chosen recipes and check its standard deviations on the others."""
    recipes = chart.recipes()
    chosen = choose_recipes(recipes.cmyk, patches)
    rest = np.setdiff1d(np.arange(len(recipes.cmyk)), chosen)
    known, spectra = recipes.cmyk[chosen], recipes.reflectance[chosen]
    fold = fold_of_recipe(patches, 10, seed)
    estimated = np.empty_like(spectra)
    for left_out in range(10):
        seen = fold != left_out
        estimated[~seen] = MODELS[BEST].fit(known[seen], spectra[seen]).reflectance(known[~seen])
    spread = Spread.of(known, spectra, estimated)
    root = np.sqrt(MODELS[BEST].fit(known, spectra).reflectance(recipes.cmyk[rest]))
    z = (root - np.sqrt(recipes.reflectance[rest])) / spread.of_root(recipes.cmyk[rest])
    return SpreadRow(
        patches=patches,
        rms=float(np.sqrt((z**2).mean())),
        within_1=float((np.abs(z) < 1).mean()),
        within_2=float((np.abs(z) < 2).mean()),
    )


def measured_rise(recipes: Recipes) -> float:
    """Return the greatest rise of any band between neighbouring measured recipes that differ by more of one ink."""
    greatest = 0.0
    for ink in range(4):
        others = np.delete(recipes.cmyk, ink, axis=1)
        order = np.lexsort((recipes.cmyk[:, ink], *others.T))
        alike = (others[order][1:] == others[order][:-1]).all(axis=1)
        rise = np.diff(recipes.reflectance[order], axis=0)[alike]
        greatest = max(greatest, float(rise.max(initial=0.0)))
    return greatest


def ink_grid(nodes: int) -> NDArray[np.float64]:
    """Return recipes (nodes, nodes, nodes, nodes, 4) at even steps of each ink."""
    return np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, nodes)] * 4, indexing="ij"), axis=-1)


def _model_row(
    chart: Chart, model: str, folds: int, seed: int, quick: bool, progress: Callable[[str], None]
) -> ModelRow:
    progress(model)
    score = cross_validate(chart, model, folds=folds, seed=seed).score
    started = time.process_time()
    fitted = fit_model(chart, model)
    fit_s = time.process_time() - started
    seconds = {}
    for nodes in (17,) if quick else (33, 17):
        started = time.process_time()
        grid = fitted.reflectance(ink_grid(nodes))
        seconds[nodes] = time.process_time() - started
    recipes = chart.recipes()
    heavy = recipes.cmyk.sum(axis=1) > INK_LIMIT
    beyond = np.zeros(1)
    if heavy.any():
        limited = fit_model(chart, model, ~heavy).reflectance(recipes.cmyk[heavy])
        beyond = delta_e00(lab(limited), lab(recipes.reflectance[heavy]))
    return ModelRow(
        model=model,
        score=score,
        fit_cpu_s=fit_s,
        predict_17_cpu_s=seconds[17],
        predict_33_cpu_s=seconds.get(33, float("nan")),
        lowest=float(grid.min()),
        highest=float(grid.max()),
        rise=max(float(np.diff(grid, axis=ink).max()) for ink in range(4)),
        beyond_limit_delta_e00=float(beyond.max()),
    )


def _noise_median(chart: Chart, seed: int) -> float:
    clean = chart.recipes().reflectance
    noisy = with_noise(clean, NOISE_DELTA_E00, stream(seed, "ink-noise-median"))
    return float(np.median(delta_e00(lab(noisy), lab(clean))))


def _error_on_rest(
    recipes: Recipes, spectra: NDArray[np.float64], chosen: NDArray[np.int64], model: str
) -> NDArray[np.float64]:
    """Return colour differences on all recipes that were not chosen."""
    rest = np.setdiff1d(np.arange(len(recipes.cmyk)), chosen)
    fitted = MODELS[model].fit(recipes.cmyk[chosen], spectra[chosen])
    return delta_e00(lab(fitted.reflectance(recipes.cmyk[rest])), lab(recipes.reflectance[rest]))


def _sizes(chart: Chart, quick: bool) -> list[int]:
    sizes = SIZES[:4] if quick else SIZES
    return [size for size in sizes if size < len(chart.recipes().cmyk)]


# --- results, and the learning curve as a picture ---

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
