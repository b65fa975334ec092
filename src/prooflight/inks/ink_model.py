"""Ink model of one press, fitted to a chart, with its cross-validation score and the standard deviation of predictions.

File: safetensors; metadata carries kind, schema, model, digest of the chart, digest of the arrays. Schema
history: 1: arrays of the model under ``model.``, of the spread under ``spread.``.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from safetensors.numpy import save
from scipy.spatial import cKDTree

from prooflight.artefact import Damaged, Tensors
from prooflight.errors import ChartError
from prooflight.files.atomic import whole_file
from prooflight.files.ink_schema import OF_MODEL, OF_SPREAD, SPREAD, check_inks, check_score
from prooflight.files.schema import Block, Misfit, checked, part_of
from prooflight.inks.neighbours import tricube
from prooflight.inks.reflectance import DARKEST, in_chunks
from prooflight.inks.selection import AUTO, FOLDS, MODELS, Score, choose, cross_validate, fit_model
from prooflight.spectra import BANDS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from prooflight.inks.chart import Chart
    from prooflight.inks.reflectance import ChartModel

SCHEMA: Final = 1
KIND: Final = "prooflight ink model"
_AGAIN: Final = "fit it again from its chart"
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
            trial, why = cross_validate(chart, model, folds=folds, seed=seed), f"{model}: as asked"
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

    def standard_deviation(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the standard deviation of measurements about ``reflectance``, (..., 4) -> (..., 36) [-]."""

        def of_factor(recipes: NDArray[np.float64]) -> NDArray[np.float64]:
            root = np.sqrt(self.model.reflectance(recipes))
            return np.asarray(2.0 * root * self.spread.of_root(recipes), dtype=np.float64)

        return in_chunks(of_factor, cmyk, BANDS)

    def save(self, path: str | Path) -> str:
        """Write to ``path`` whole or not at all, and return the digest.

        ChartError: ``load`` would refuse it.
        """
        path = Path(path)
        arrays = {OF_MODEL + name: array for name, array in self.model.arrays().items()}
        arrays |= {OF_SPREAD + name: getattr(self.spread, name) for name in SPREAD}
        arrays = {
            name: np.array(array, dtype=np.float64, order="C") for name, array in sorted(arrays.items())
        }
        metadata = {
            "kind": KIND,
            "schema": str(SCHEMA),
            "model": self.name,
            "chart": self.chart_digest,
            "score": json.dumps(asdict(self.score)),
            "why": self.why,
        }
        _check(path, arrays, metadata)
        metadata["digest"] = _digest(arrays, metadata)
        with whole_file(path) as unfinished:
            unfinished.write_bytes(save(arrays, metadata))
        return metadata["digest"]

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file that ``save`` wrote.

        ChartError if it is something else, of another schema, or damaged.
        """
        path = Path(path)
        if not path.is_file():
            raise ChartError(path, "there is no such file", remedy=f"{_AGAIN} or give the right path")
        arrays, metadata = _read(path)
        return cls(
            model=MODELS[metadata["model"]].from_arrays(part_of(arrays, OF_MODEL)),
            spread=Spread(**part_of(arrays, OF_SPREAD)),
            score=Score(**json.loads(metadata["score"])),
            why=metadata["why"],
            chart_digest=metadata["chart"],
        )


class Texts(Block):
    """Text fields of a file's metadata, except its kind, schema and digest."""

    model: str
    chart: str
    score: str
    why: str


def _read(path: Path) -> tuple[dict[str, NDArray[np.float64]], dict[str, str]]:
    """Read arrays and metadata whose kind, schema and digest are right, and that make a model."""
    try:
        file = Tensors(path)
        metadata = file.texts
        if metadata.get("kind") != KIND:
            raise ChartError(path, "this is no ink model", remedy=_AGAIN)
        if metadata.get("schema") != str(SCHEMA):
            what = f"schema {metadata.get('schema')} of the ink model, this program reads {SCHEMA}"
            raise ChartError(path, what, remedy=_AGAIN)
        _refuse_unknown(metadata)
        arrays = file.arrays()
    except Damaged as error:
        raise ChartError(path, "the ink model is damaged, or this is none", remedy=_AGAIN) from error
    except Misfit as error:
        raise ChartError(path, f"the ink model is damaged: {error}", remedy=_AGAIN) from error
    if metadata.get("digest") != _digest(arrays, metadata):
        raise ChartError(path, "the ink model is damaged (its digest differs)", remedy=_AGAIN)
    _check(path, arrays, metadata)
    return arrays, metadata


def _refuse_unknown(metadata: Mapping[str, str]) -> None:
    if unknown := sorted(set(metadata) - {"kind", "schema", "digest", *Texts.model_fields}):
        raise Misfit(unknown[0], "is not known here")


def _check(path: Path, arrays: Mapping[str, NDArray[np.float64]], metadata: Mapping[str, str]) -> None:
    """Raise ChartError, with the field's name, unless these are an ink model."""
    try:
        texts = checked(Texts, {name: metadata.get(name) for name in Texts.model_fields})
        check_score(texts.score)
        check_inks(texts.model, arrays, spread=True)
    except Misfit as error:
        raise ChartError(path, f"the ink model cannot be used: {error}", remedy=_AGAIN) from error


def _digest(arrays: Mapping[str, NDArray[np.float64]], metadata: Mapping[str, str]) -> str:
    """Return the SHA-256 over the arrays with names and shapes, and the metadata."""
    sha = hashlib.sha256()
    for key in ("schema", "model", "chart", "score", "why"):
        sha.update(f"{key}={metadata.get(key)}\n".encode())
    for name in sorted(arrays):
        sha.update(f"{name} {arrays[name].dtype} {arrays[name].shape}\n".encode())
        sha.update(np.ascontiguousarray(arrays[name]).tobytes())
    return sha.hexdigest()
