"""Yule-Nielsen spectral Neugebauer model: a mosaic of paper, solids and overprints, blurred by light spread in paper.

    R(lambda) = ( sum_p w_p(e) P_p(lambda)^(1/n) )^n,   w_p = product over inks of e_i or 1 - e_i (Demichel),

with effective dot areas e_i = a_i + 4 a_i (1 - a_i) (t_i + s_i (2 a_i - 1)): tone value increase t at 50 %,
skewed by s. Source: Yule and Nielsen (1951) for n, Viggiano (1985) for the spectral form, as in Wyble and
Berns, "A critical review of spectral models applied to binary color printing", Color Research and Application
25 (2000).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from prooflight.cmyk import INK_LETTERS, INKS
from prooflight.inks.reflectance import BRIGHTEST, DARKEST, LogLinear, in_chunks
from prooflight.spectra import BANDS

_TVI: Final = (-0.10, 0.18)  # of t; with _SKEW every curve in these bounds rises from 0 to 1
_SKEW: Final = (-0.06, 0.06)
_YULE_NIELSEN: Final = (1.0, 10.0)  # n: 1 no spread of light; beyond 10 the model hardly changes
# Patches' worth of belief in the log-linear model, for overprints never measured
_TOWARDS_LOG_LINEAR: Final = 1e-3
_TOWARDS_STRAIGHT: Final = 1e-2  # keeps curves straight where no tint says otherwise
_PRIMARIES: Final = np.array(
    list(product((0.0, 1.0), repeat=INKS))
)  # paper, solids, overprints; K varies fastest


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Neugebauer:
    """Yule-Nielsen spectral Neugebauer model with 16 primaries."""

    n: float
    """Yule-Nielsen factor. [-]"""
    curves: NDArray[np.float64]
    """Tone value increase t and skew s (4, 2) of C, M, Y, K. [-]"""
    roots: NDArray[np.float64]
    """Values of reflectance^(1/n) (16, 36) of the primaries, K varying fastest. [-]"""

    @property
    def name(self) -> str:
        """Return ``neugebauer``."""
        return "neugebauer"

    @classmethod
    def fit(
        cls,
        cmyk: NDArray[np.float64],
        reflectance: NDArray[np.float64],
        count: NDArray[np.int64] | None = None,
    ) -> Self:
        """Fit n, curves and the 16 primaries in one fit, by least squares in the square root of reflectance.

        The primaries are linear given n and curves and are solved for inside (variable projection).
        """
        weight = np.sqrt(np.ones(len(cmyk)) if count is None else count)[:, None]
        belief = LogLinear.fit(cmyk, reflectance, count).reflectance(_PRIMARIES)
        measured = np.maximum(reflectance, DARKEST)
        root = np.sqrt(measured)

        def primaries(values: NDArray[np.float64]) -> Neugebauer:
            n = float(np.exp(values[-1]))
            curves = values[:-1].reshape(INKS, 2)
            share = _shares(cmyk, curves)
            roots = _towards(
                belief ** (1 / n), weight * share, weight * measured ** (1 / n), _TOWARDS_LOG_LINEAR
            )
            return Neugebauer(n=n, curves=curves, roots=roots)

        def residual(values: NDArray[np.float64]) -> NDArray[np.float64]:
            misfit = np.sqrt(primaries(values).reflectance(cmyk)) - root
            return np.concatenate([(weight * misfit).ravel(), _TOWARDS_STRAIGHT * values[:-1]])

        low, high = (
            np.array([_TVI[side], _SKEW[side]] * 4 + [np.log(_YULE_NIELSEN[side])]) for side in (0, 1)
        )
        start = np.array([0.1, 0.0] * 4 + [np.log(2.0)])
        best = primaries(least_squares(residual, start, bounds=(low, high), diff_step=1e-3).x)
        return cls(n=best.n, curves=best.curves, roots=best.roots)

    def reflectance(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the reflectance factor of recipes (..., 4) -> (..., 36), see ``ReflectanceModel``."""

        def mixed(recipes: NDArray[np.float64]) -> NDArray[np.float64]:
            power = _shares(recipes, self.curves) @ self.roots
            return np.clip(np.maximum(power, 0.0) ** self.n, DARKEST, BRIGHTEST)

        return in_chunks(mixed, cmyk, BANDS)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the arrays that ``from_arrays`` needs."""
        levels = {f"levels.{ink}": np.array([0.0, 1.0]) for ink in INK_LETTERS}  # part of the file's format
        return {"n": np.array([self.n]), "curves": self.curves, "roots": self.roots, **levels}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the model that gave ``arrays``."""
        return cls(n=float(arrays["n"][0]), curves=arrays["curves"], roots=arrays["roots"])


def effective_area(area: NDArray[np.float64], curves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the effective dot areas of nominal ones, (m, 4) -> (m, 4).

    curves (4, 2) as in ``Neugebauer.curves``.
    """
    gain = curves[:, 0] + curves[:, 1] * (2 * area - 1)
    return np.asarray(area + 4 * area * (1 - area) * gain, dtype=np.float64)


def _shares(cmyk: NDArray[np.float64], curves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of the page that each primary covers, (m, 16); the shares sum to 1 (Demichel)."""
    share = np.ones((len(cmyk), 1))
    for area in effective_area(cmyk, curves).T:
        hat = np.stack([1 - area, area], axis=1)
        share = (share[:, :, None] * hat[:, None, :]).reshape(len(cmyk), -1)
    return share


def _towards(
    belief: NDArray[np.float64], design: NDArray[np.float64], wanted: NDArray[np.float64], patches: float
) -> NDArray[np.float64]:
    """Solve design @ x = wanted by least squares with the prior x = belief; the result is at least DARKEST.

    The prior has the weight of ``patches`` patches.
    """
    normal = design.T @ design + patches * np.eye(design.shape[1])
    solution = belief + np.linalg.solve(normal, design.T @ (wanted - design @ belief))
    return np.maximum(solution, DARKEST)
