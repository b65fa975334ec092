"""Ink model of one press, fitted to a chart, with its cross-validation score and the spread of its predictions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from prooflight.inks.neighbours import tricube
from prooflight.inks.reflectance import DARKEST, ChartModel
from prooflight.inks.selection import AUTO, FOLDS, Score, choose, cross_validate, fit_model

if TYPE_CHECKING:
    from prooflight.inks.chart import Chart

# With 12 the spread is noisy (rms z 1.11 on an offset chart), with 48 it blurs; 24: 1.03
_NEIGHBOURS: Final = 24


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spread:
    """Standard deviation of predictions, from the cross-validation residuals of nearby recipes.

    Residuals are stored on the square root of reflectance, where they are of one size in light and dark; a
    wanted recipe takes the tricube-weighted mean square of its 24 nearest. Where it lies farther from
    measured recipes than these lie from each other, the standard deviation grows in proportion (assumed:
    extrapolation errs at least linearly).
    """

    cmyk: NDArray[np.float64]
    """Recipes (n, 4), ink fractions. [-]"""
    squared: NDArray[np.float64]
    """Squared residuals (n, 36) of the square root of reflectance. [-]"""
    reach: NDArray[np.float64]
    """Mean distance (n,) from each recipe to its nearest ones. [-]"""

    @classmethod
    def of(
        cls, cmyk: NDArray[np.float64], measured: NDArray[np.float64], predicted: NDArray[np.float64]
    ) -> Self:
        """Compute the spread from recipes (n, 4) and their measured and cross-validated reflectances, (n, 36)."""
        residual = np.sqrt(np.maximum(measured, DARKEST)) - np.sqrt(np.maximum(predicted, DARKEST))
        distance, _ = cKDTree(cmyk).query(cmyk, k=min(_NEIGHBOURS + 1, len(cmyk)))
        return cls(cmyk=cmyk, squared=residual**2, reach=distance[:, 1:].mean(axis=1))

    def of_root(self, cmyk: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviation of the square root of reflectance, (m, 4) -> (m, 36)."""
        distance, nearest = cKDTree(self.cmyk).query(cmyk, k=min(_NEIGHBOURS, len(self.cmyk)))
        weight = tricube(distance)
        weight /= weight.sum(axis=1, keepdims=True)
        usual = (weight * self.reach[nearest]).sum(axis=1)
        growth = np.maximum(distance.mean(axis=1) / usual, 1.0)
        variance = (weight[:, None, :] @ self.squared[nearest])[:, 0]
        return np.asarray(np.sqrt(variance) * growth[:, None], dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InkModel:
    """Fitted reflectance model with its score, its spread and its origin."""

    model: ChartModel
    spread: Spread
    score: Score
    """Score of the cross-validation."""
    why: str
    """Reason for the choice of this model, one sentence."""
    chart_digest: str
    """``Chart.digest`` of the chart that it was fitted to."""

    @property
    def name(self) -> str:
        """Return the name of the model inside."""
        return self.model.name

    @classmethod
    def fit(
        cls,
        chart: Chart,
        model: str = AUTO,
        *,
        folds: int = FOLDS,
        seed: int = 0,
        progress: Callable[[str], None] | None = None,
    ) -> Self:
        """Fit a model of ``MODELS``, or the one that cross-validation prefers, to all of a chart.

        RequestError: no such model or folds. ChartError: the chart does not determine it.
        """
        if model == AUTO:
            choice = choose(chart, folds=folds, seed=seed, progress=progress)
            trial, why = choice.best, choice.why
        else:
            trial, why = cross_validate(chart, model, folds=folds, seed=seed), f"{model}: as requested"
        recipes = chart.recipes()
        return cls(
            model=fit_model(chart, trial.model),
            spread=Spread.of(recipes.cmyk, recipes.reflectance, trial.predicted),
            score=trial.score,
            why=why,
            chart_digest=chart.digest,
        )

    def reflectance(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the reflectance factor of recipes (..., 4) -> (..., 36), see ``ReflectanceModel``."""
        return self.model.reflectance(cmyk)
