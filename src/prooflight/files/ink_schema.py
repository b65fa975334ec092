"""Array schema of every kind of ink model in a press artefact."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.cmyk import INK_LETTERS, INKS
from prooflight.files.schema import (
    ArraySpec,
    Block,
    Count,
    Misfit,
    NotNegative,
    check_arrays,
    checked,
    parsed,
    part_of,
)
from prooflight.spectra import BANDS

OF_MODEL, OF_SPREAD = "model.", "spread."
MOST_RECIPES: Final = 20_000
"""Greatest number of recipes. assumed: charts have 2,000 patches; each costs a kilobyte of every chunk of
recipes predicted."""
MOST_FACTOR: Final = 10.0
"""Greatest reflectance factor: brightened paper has 1.2."""
STEEPEST: Final = 0.25
"""Limit of tone value increase and skew together, below which curves rise."""


class ScoreFacts(Block):
    """Schema of ``selection.Score``."""

    mean_delta_e00: NotNegative
    median_delta_e00: NotNegative
    p95_delta_e00: NotNegative
    max_delta_e00: NotNegative
    rms_reflectance: NotNegative
    patches: Count


def _too_steep(curves: NDArray[np.floating]) -> str:
    steep = np.abs(curves).sum(axis=1).max()
    return "" if steep < STEEPEST else f"must stay below {STEEPEST}, tone value increase and skew together"


def _not_solids(levels: NDArray[np.floating]) -> str:
    return "" if levels.tolist() == [0.0, 1.0] else "must be 0 and 1"


def _too_many(recipes: NDArray[np.floating]) -> str:
    return "" if len(recipes) <= MOST_RECIPES else f"holds more than {MOST_RECIPES} recipes"


def _array(*shape: int | str, **how: Any) -> ArraySpec:
    return ArraySpec(dtype="float64", shape=shape, **how)


_RECIPES: Final = _array("recipes", INKS, low=-0.01, high=1.01, rule=_too_many)
_OF_RECIPES: Final = _array("recipes", BANDS, low=-MOST_FACTOR, high=MOST_FACTOR)
_NEUGEBAUER: Final = {
    "n": _array(1, low=1, high=10.001),
    "curves": _array(INKS, 2, rule=_too_steep),
    "roots": _array(2**INKS, BANDS, low=0, high=MOST_FACTOR),
    **{f"levels.{ink}": _array(2, rule=_not_solids) for ink in INK_LETTERS},
}
_RADIAL: Final = {
    "cmyk": _RECIPES,
    "coefficients": _array("recipes", BANDS),
    "tail": _array(1 + INKS, BANDS),
    "smoothing": _array(1, low=0),
}
MODELS: Final[Mapping[str, Mapping[str, ArraySpec]]] = {
    "log-linear": {
        "paper": _array(BANDS, above=0, high=MOST_FACTOR),
        "density": _array(INKS, BANDS, low=-100, high=100),
        "tvi": _array(INKS, low=0, high=0.2499999, absent=True),
    },
    "neighbours": {"cmyk": _RECIPES, "measured": _OF_RECIPES},
    "neugebauer": _NEUGEBAUER,
    "radial-basis": _RADIAL,
    "hybrid": _RADIAL | {f"trend.{name}": spec for name, spec in _NEUGEBAUER.items()},
}
"""Arrays of each model by its name; ``inks.selection.MODELS`` constructs models from them."""
SPREAD: Final = {
    "cmyk": _RECIPES,
    "squared": _array("recipes", BANDS, low=0),
    "reach": _array("recipes", above=0),
}


def check_inks(model: str, arrays: Mapping[str, NDArray[Any]], *, spread: bool, under: str = "") -> None:
    """Raise Misfit unless ``arrays`` are those of such a model.

    spread: whether those of its uncertainty must be there as well. under: prefix of their names in messages.
    """
    if model not in MODELS:
        raise Misfit(f"{under}model", f"is {model!r}, which is unknown")
    table = {OF_MODEL + name: spec for name, spec in MODELS[model].items()}
    check_arrays(
        {name: array for name, array in arrays.items() if not name.startswith(OF_SPREAD)},
        table,
        {},
        under=under,
    )
    check_arrays(part_of(arrays, OF_SPREAD), SPREAD if spread else {}, {}, under=under + OF_SPREAD)


def check_score(text: str, *, under: str = "") -> None:
    """Raise Misfit unless a text is a score, as JSON."""
    checked(ScoreFacts, parsed(text), under=f"{under}score.")
