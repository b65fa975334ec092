"""Prediction from the nearest measured recipes: the paper's interpolation.

It fits, for each wanted recipe, a plane over its nearest recipes in CMYK by weighted least squares and read it there;
the plane's value is a weighted sum of the neighbours' spectra with weights that reproduce any linear function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from prooflight.inks.reflectance import BRIGHTEST, DARKEST, in_chunks
from prooflight.spectra import BANDS

Weighting = Callable[[NDArray[np.float64]], NDArray[np.float64]]

_NEAREST: Final = 8  # of 6, 8, 12, 16, 24, 32 the one with the least median error on an offset chart, with 6
# Slopes that the neighbours do not determine are taken as 0; others stay what they are
_FLATTEST: Final = 1e-6


def inverse_square(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 1 / d^2, (queries, k) -> the same; at a measured recipe the plane goes through its value."""
    return np.asarray(1.0 / np.maximum(distance, 1e-6) ** 2, dtype=np.float64)


def tricube(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (1 - (d / d_k)^3)^3: the farthest neighbour has weight 0, so the surface has no steps."""
    relative = distance / np.maximum(distance[:, -1:], 1e-9)
    return np.asarray((1.0 - np.minimum(relative, 1.0) ** 3) ** 3 + 1e-9, dtype=np.float64)


def plane_weights(
    measured: NDArray[np.float64], wanted: NDArray[np.float64], neighbours: int, weighting: Weighting
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return indices (queries, k) of the nearest recipes and the weights that give the plane's value from theirs.

    measured (n, 4), wanted (queries, 4) ink fractions. The weights (queries, k) sum to 1.
    """
    nearest_of = cKDTree(measured).query(wanted, k=min(neighbours, len(measured)))
    distance, nearest = (
        of_each.reshape(len(wanted), -1) for of_each in nearest_of
    )  # one neighbour comes without its axis
    offset = measured[nearest] - wanted[:, None]
    design = np.concatenate([np.ones((*offset.shape[:2], 1)), offset], axis=2)
    weighted = design * weighting(distance)[..., None]
    normal = weighted.transpose(0, 2, 1) @ design
    slopes = np.arange(1, design.shape[2])
    normal[:, slopes, slopes] += _FLATTEST * normal[:, slopes, slopes].sum(axis=1)[:, None] + 1e-12
    at_wanted = np.zeros((len(wanted), design.shape[2], 1))
    at_wanted[:, 0] = 1.0
    return nearest, (weighted @ np.linalg.solve(normal, at_wanted))[..., 0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Neighbours:
    """The paper's model: linear interpolation of reflectance between the N nearest patches (section 3.3).

    Reading chosen: a plane through the N = 8 nearest recipes, weights 1 / distance^2.
    """

    cmyk: NDArray[np.float64]
    """Measured recipes (n, 4), ink fractions. [-]"""
    measured: NDArray[np.float64]
    """Reflectance factors (n, 36) of the measured recipes. [-]"""

    @property
    def name(self) -> str:
        """Return ``neighbours``."""
        return "neighbours"

    @classmethod
    def fit(
        cls,
        cmyk: NDArray[np.float64],
        reflectance: NDArray[np.float64],
        count: NDArray[np.int64] | None = None,
    ) -> Self:
        """Store the measurements; ``count`` of repeats makes no difference here."""
        return cls(cmyk=cmyk, measured=reflectance)

    def reflectance(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the reflectance factor of recipes (..., 4) -> (..., 36), see ``ReflectanceModel``."""

        def plane(wanted: NDArray[np.float64]) -> NDArray[np.float64]:
            nearest, weight = plane_weights(self.cmyk, wanted, _NEAREST, inverse_square)
            summed = (weight[:, None, :] @ self.measured[nearest])[:, 0]
            return np.clip(summed, DARKEST, BRIGHTEST)

        return in_chunks(plane, cmyk, BANDS)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the arrays that ``from_arrays`` needs."""
        return {"cmyk": self.cmyk, "measured": self.measured}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the model that gave ``arrays``."""
        return cls(cmyk=arrays["cmyk"], measured=arrays["measured"])
