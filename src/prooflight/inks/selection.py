"""Selection of the ink model that a chart supports: cross-validation by recipe, and the choice called ``auto``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import ChartError, RequestError
from prooflight.inks.neighbours import Neighbours
from prooflight.inks.neugebauer import Neugebauer
from prooflight.inks.radial_basis import Hybrid, RadialBasis
from prooflight.inks.reflectance import ChartModel, LogLinear
from prooflight.rng import stream
from prooflight.spectra import delta_e00, lab

if TYPE_CHECKING:
    from prooflight.inks.chart import Chart

MODELS: Final[Mapping[str, type[ChartModel]]] = MappingProxyType(
    {
        "log-linear": LogLinear,
        "neighbours": Neighbours,
        "neugebauer": Neugebauer,
        "radial-basis": RadialBasis,
        "hybrid": Hybrid,
    }
)
"""Models by name, the simpler first; ``auto`` chooses among them."""
AUTO: Final = "auto"
FOLDS: Final = 10
_FEWEST_RECIPES: Final = 16  # assumed: the solids and overprints of four inks; below, nothing can be left out
_AS_GOOD: Final = 1.02  # a simpler model within 2 % of the best is preferred


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Error over the patches of a chart, each predicted by a model that has not seen its recipe (D50, 2 degrees)."""

    mean_delta_e00: float
    median_delta_e00: float
    p95_delta_e00: float
    max_delta_e00: float
    rms_reflectance: float
    """Root of the mean square over patches and bands. [-]"""
    patches: int

    @classmethod
    def of(cls, predicted: NDArray[np.float64], measured: NDArray[np.float64]) -> Score:
        """Compute the score of spectra (n, 36) against measured ones."""
        difference = delta_e00(lab(predicted), lab(measured))
        return cls(
            mean_delta_e00=float(difference.mean()),
            median_delta_e00=float(np.median(difference)),
            p95_delta_e00=float(np.percentile(difference, 95)),
            max_delta_e00=float(difference.max()),
            rms_reflectance=float(np.sqrt(((predicted - measured) ** 2).mean())),
            patches=len(measured),
        )

    def as_json(self) -> dict[str, object]:
        """Return the object that ``chart score`` prints."""
        delta = {"median": self.median_delta_e00, "p95": self.p95_delta_e00, "max": self.max_delta_e00}
        return {"delta_e00": delta, "rms_reflectance": self.rms_reflectance, "patches": self.patches}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CrossValidation:
    """Predictions of one model for recipes that it was not fitted to."""

    model: str
    folds: int
    predicted: NDArray[np.float64]
    """Predicted reflectance factors (recipes, 36), in the order of ``Chart.recipes``. [-]"""
    score: Score


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Choice:
    """Result of ``auto``."""

    best: CrossValidation
    scores: Mapping[str, Score]
    """Scores of every model that could be fitted."""
    why: str
    """Reason for the choice, one sentence."""


def fold_of_recipe(recipes: int, folds: int, seed: int) -> NDArray[np.int64]:
    """Return the fold (recipes,) of each recipe, 0..folds-1, equally many in each up to one."""
    return stream(seed, "recipe-folds").permutation(recipes) % folds


def fit_model(chart: Chart, model: str, rows: NDArray[np.bool_] | None = None) -> ChartModel:
    """Fit one model of ``MODELS`` to a chart's recipes, or to those of ``rows`` (recipes,).

    RequestError: no such model. ChartError: the chart does not determine it.
    """
    if model not in MODELS:
        what = f"there is no ink model {model}"
        raise RequestError("--model", what, remedy=f"take {AUTO}, {', '.join(MODELS)}")
    recipes = chart.recipes()
    rows = np.ones(len(recipes.cmyk), dtype=bool) if rows is None else rows
    if rows.sum() < _FEWEST_RECIPES:
        what = f"{rows.sum()} different recipes to learn from"
        raise ChartError(
            chart.where, what, remedy=f"measure at least {_FEWEST_RECIPES}; `chart make` chooses them"
        )
    try:
        return MODELS[model].fit(recipes.cmyk[rows], recipes.reflectance[rows], recipes.count[rows])
    except ValueError as error:
        what = f"the model {model} cannot be fitted: {error}"
        raise ChartError(
            chart.where, what, remedy="take another model, or print a chart of `chart make`"
        ) from None


def cross_validate(chart: Chart, model: str, *, folds: int = FOLDS, seed: int = 0) -> CrossValidation:
    """Predict every recipe by a model fitted without its fold; folds go by recipe, so repeats never straddle them.

    RequestError: no such model, or folds outside 2..recipes. ChartError: the chart does not determine it.
    """
    recipes = chart.recipes()
    if not 2 <= folds <= len(recipes.cmyk):
        what = f"{folds} folds of {len(recipes.cmyk)} recipes"
        raise RequestError("--folds", what, remedy="take 2 folds up to as many as there are recipes")
    fold = fold_of_recipe(len(recipes.cmyk), folds, seed)
    predicted = np.empty_like(recipes.reflectance)
    for left_out in range(folds):
        seen = fold != left_out
        predicted[~seen] = fit_model(chart, model, seen).reflectance(recipes.cmyk[~seen])
    score = Score.of(predicted[recipes.of_patch], chart.reflectance)
    return CrossValidation(model=model, folds=folds, predicted=predicted, score=score)


def choose(
    chart: Chart, *, folds: int = FOLDS, seed: int = 0, progress: Callable[[str], None] | None = None
) -> Choice:
    """Cross-validate every model and choose the one of least mean CIEDE2000, or a simpler one within 2 % of it.

    ``progress`` is called with each model's name before it is tried. Models that the chart does not determine
    are passed over; ChartError if none is left.
    """
    tried: dict[str, CrossValidation] = {}
    refused: ChartError | None = None
    for name in MODELS:
        if progress:
            progress(name)
        try:
            tried[name] = cross_validate(chart, name, folds=folds, seed=seed)
        except ChartError as error:
            refused = error
    if not tried:
        raise refused or ChartError(chart.where, "no ink model fits", remedy="print a chart of `chart make`")
    least = min(trial.score.mean_delta_e00 for trial in tried.values())
    best = next(trial for trial in tried.values() if trial.score.mean_delta_e00 <= _AS_GOOD * least)
    others = sorted((trial.score.mean_delta_e00, name) for name, trial in tried.items() if name != best.model)
    why = (
        f"{best.model}: mean CIEDE2000 {best.score.mean_delta_e00:.3f} over {best.score.patches} patches left out"
        f" in {folds} folds"
    )
    if others:
        why += f"; next {others[0][1]} with {others[0][0]:.3f}"
    return Choice(best=best, scores={name: trial.score for name, trial in tried.items()}, why=why)


def learn(
    chart: Chart,
    model: str = AUTO,
    *,
    folds: int = FOLDS,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> ChartModel:
    """Fit a model, or the one that ``auto`` chooses, to all of a chart, as ``chart predict`` does."""
    if model == AUTO:
        model = choose(chart, folds=folds, seed=seed, progress=progress).best.model
    return fit_model(chart, model)
