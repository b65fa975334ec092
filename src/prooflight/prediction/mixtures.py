"""Mixtures of the process inks that give a camera the light of some other ink, from a press's tables alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INKS
from prooflight.kernels.prediction.lookup import NODE_STEP, NODES
from prooflight.prediction.tables import node_fractions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from prooflight.prediction.tables import SensorModel

COST: Final = 1e-3 * np.array([1.0, 1.0, 1.0, 3.0])
"""Light, as a share of white, that a whole ink costs: of mixtures with the same light, that of the least ink is taken.

It moves the light by less than 1e-5. Assumed: black costs as much as three inks, so that colours are mixed without it,
and the mixture varies as a coloured ink does.
"""
COARSE: Final = 4
"""Nodes between those at which a mixture is looked for first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mixtures:
    """Mixtures for several lights."""

    cmyk: NDArray[np.float64]
    """Shares (n, 4) of C, M, Y and K, 0 to 1."""
    off: NDArray[np.float64]
    """Light (n, sensors) of each mixture less the one that was asked for, as a share of paper white."""


def mixtures(sensors: Sequence[SensorModel], light_dn: NDArray[np.float64]) -> Mixtures:
    """Return the mixture whose light is nearest to each of ``light_dn`` (n, sensors), above dark, column gain 1. [DN]

    Least squares over the sensors, in shares of paper white, with the least ink among equals (``COST``). With up to
    three sensors, light that process inks can give is met but for rounding; light beyond them is met as nearly as
    they can.
    """
    from scipy.optimize import least_squares  # imported late: it takes 0.1 s, and few jobs have spot inks

    white = np.array([sensor.white_dn for sensor in sensors])
    step = slice(None, None, COARSE)
    axis = np.minimum(node_fractions()[step], 1.0)
    coarse = np.stack(np.meshgrid(*[axis] * INKS, indexing="ij"), axis=-1).reshape(-1, INKS)
    lights = (
        np.stack([sensor.mean_dn[step, step, step, step].reshape(-1) for sensor in sensors], axis=1) / white
    )
    cost = ((COST * coarse) ** 2).sum(axis=1)

    def misfit(recipe: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([_light(sensors, recipe) / white - wanted, COST * recipe])

    recipes = []
    for wanted in light_dn / white:
        nearest = coarse[np.argmin(((lights - wanted) ** 2).sum(axis=1) + cost)]
        best = least_squares(misfit, nearest, bounds=(0.0, 1.0), args=(wanted,))
        recipes.append(best.x)
    cmyk = np.array(recipes)
    light = np.array([_light(sensors, recipe) for recipe in cmyk])
    return Mixtures(cmyk=cmyk, off=(light - light_dn) / white)


def _light(sensors: Sequence[SensorModel], recipe: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the light (sensors,) of a recipe (4,), 0 to 1, between the nodes of the tables. [DN]"""
    place = recipe * (255 / NODE_STEP)
    low = np.minimum(place.astype(int), NODES - 2)
    part = place - low
    around = tuple(slice(start, start + 2) for start in low)
    cells = np.stack([sensor.mean_dn[around].astype(np.float64) for sensor in sensors], axis=-1)
    for share in part:
        cells = cells[0] * (1 - share) + cells[1] * share
    return cells
