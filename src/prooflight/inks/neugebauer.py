"""Yule-Nielsen spectral Neugebauer model: a mosaic of paper, solids and overprints, blurred by light spread in paper.

    R(lambda) = ( sum_p w_p(e) P_p(lambda)^(1/n) )^n,   w_p = product over inks of e_i or 1 - e_i (Demichel),

with effective dot areas e_i = a_i + 4 a_i (1 - a_i) (t_i + s_i (2 a_i - 1)): tone value increase t at 50 %,
skewed by s. Source: Yule and Nielsen (1951) for n, Viggiano (1985) for the spectral form, as in Wyble and
Berns, "A critical review of spectral models applied to binary color printing", Color Research and Application
25 (2000). Heuberger, Jing and Persiev (1992) cut the ink cube into cells, so that w becomes multilinear
interpolation between measured nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Final, Self

import numpy as np
from scipy.optimize import least_squares

from prooflight.cmyk import INK_LETTERS, INKS
from prooflight.inks.reflectance import BRIGHTEST, DARKEST, LogLinear, in_chunks
from prooflight.spectra import BANDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Levels = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

_TVI: Final = (-0.10, 0.18)  # of t; with _SKEW every curve in these bounds rises from 0 to 1
_SKEW: Final = (-0.06, 0.06)
_YULE_NIELSEN: Final = (1.0, 10.0)  # n: 1 no spread of light; beyond 10 the model hardly changes
# Patches' worth of belief in the log-linear model, for overprints never measured
_TOWARDS_LOG_LINEAR: Final = 1e-3
_TOWARDS_PRIMARIES: Final = 0.1  # patches' worth of belief in the 16-primary model, for nodes never measured
_TOWARDS_STRAIGHT: Final = 1e-2  # keeps curves straight where no tint says otherwise
_NODES_MEASURED: Final = 0.6  # assumed: with more of the nodes missing, cells only copy the 16-primary model
_SOLIDS: Final = np.array([0.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Neugebauer:
    """Yule-Nielsen spectral Neugebauer model with 16 primaries or with the nodes of cells."""

    n: float
    """Yule-Nielsen factor. [-]"""
    curves: NDArray[np.float64]
    """Tone value increase t and skew s (4, 2) of C, M, Y, K. [-]"""
    levels: Levels
    """Nominal dot areas of the nodes of each ink, from 0 to 1; (0, 1) without cells. [-]"""
    roots: NDArray[np.float64]
    """Values of reflectance^(1/n) (nodes, 36) at every combination of levels, K varying fastest. [-]"""

    @property
    def name(self) -> str:
        """Return ``neugebauer`` or ``cellular-neugebauer``."""
        return "neugebauer" if max(map(len, self.levels)) == 2 else "cellular-neugebauer"

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
        belief = LogLinear.fit(cmyk, reflectance, count).reflectance(_nodes((_SOLIDS,) * 4))
        measured = np.maximum(reflectance, DARKEST)
        root = np.sqrt(measured)

        def primaries(values: NDArray[np.float64]) -> Neugebauer:
            n = float(np.exp(values[-1]))
            curves = values[:-1].reshape(INKS, 2)
            share = _shares(cmyk, curves, (_SOLIDS,) * 4)
            roots = _towards(
                belief ** (1 / n), weight * share, weight * measured ** (1 / n), _TOWARDS_LOG_LINEAR
            )
            return Neugebauer(n=n, curves=curves, levels=(_SOLIDS,) * 4, roots=roots)

        def residual(values: NDArray[np.float64]) -> NDArray[np.float64]:
            misfit = np.sqrt(primaries(values).reflectance(cmyk)) - root
            return np.concatenate([(weight * misfit).ravel(), _TOWARDS_STRAIGHT * values[:-1]])

        low, high = (
            np.array([_TVI[side], _SKEW[side]] * 4 + [np.log(_YULE_NIELSEN[side])]) for side in (0, 1)
        )
        start = np.array([0.1, 0.0] * 4 + [np.log(2.0)])
        best = primaries(least_squares(residual, start, bounds=(low, high), diff_step=1e-3).x)
        return cls(n=best.n, curves=best.curves, levels=best.levels, roots=best.roots)

    def reflectance(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the reflectance factor of recipes (..., 4) -> (..., 36), see ``ReflectanceModel``."""

        def mixed(recipes: NDArray[np.float64]) -> NDArray[np.float64]:
            power = _shares(recipes, self.curves, self.levels) @ self.roots
            return np.clip(np.maximum(power, 0.0) ** self.n, DARKEST, BRIGHTEST)

        return in_chunks(mixed, cmyk, BANDS)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the arrays that ``from_arrays`` needs."""
        levels = {f"levels.{ink}": level for ink, level in zip(INK_LETTERS, self.levels, strict=True)}
        return {"n": np.array([self.n]), "curves": self.curves, "roots": self.roots, **levels}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the model that gave ``arrays``."""
        cyan, magenta, yellow, black = (arrays[f"levels.{ink}"] for ink in INK_LETTERS)
        levels = (cyan, magenta, yellow, black)
        return cls(n=float(arrays["n"][0]), curves=arrays["curves"], levels=levels, roots=arrays["roots"])


class CellularNeugebauer(Neugebauer):
    """Cellular form of the model, for charts that measure most combinations of 0, one level between, and 100 %."""

    __slots__ = ()

    @classmethod
    def fit(
        cls,
        cmyk: NDArray[np.float64],
        reflectance: NDArray[np.float64],
        count: NDArray[np.int64] | None = None,
    ) -> Self:
        """Keep n and curves of the 16-primary model and fit the nodes.

        ValueError if too few of them are measured.
        """
        levels = cell_levels(cmyk)
        primaries = Neugebauer.fit(cmyk, reflectance, count)
        weight = np.sqrt(np.ones(len(cmyk)) if count is None else count)[:, None]
        belief = primaries.reflectance(_nodes(levels)) ** (1 / primaries.n)
        share = _shares(cmyk, primaries.curves, levels)
        wanted = np.maximum(reflectance, DARKEST) ** (1 / primaries.n)
        roots = _towards(belief, weight * share, weight * wanted, _TOWARDS_PRIMARIES)
        return cls(n=primaries.n, curves=primaries.curves, levels=levels, roots=roots)


def cell_levels(cmyk: NDArray[np.float64]) -> Levels:
    """Return the levels 0, x, 1 of each ink, x its most frequent tint between 25 and 75 %.

    ValueError if fewer than 60 % of the 81 combinations are among the recipes (n, 4), within 2 %.
    """
    levels = []
    for ink in cmyk.T:
        tints, times = np.unique(ink[(ink > 0.25) & (ink < 0.75)], return_counts=True)
        levels.append(np.array([0.0, tints[times.argmax()] if tints.size else 0.5, 1.0]))
    cyan, magenta, yellow, black = levels
    nodes = _nodes((cyan, magenta, yellow, black))
    there = (np.abs(cmyk[:, None] - nodes).max(axis=2) < 0.02).any(axis=0)
    if there.mean() < _NODES_MEASURED:
        message = f"cells need {_NODES_MEASURED:.0%} of the {len(nodes)} combinations of 0, about 50 and 100 % ink, "
        message += f"{there.sum()} are measured"
        raise ValueError(message)
    return cyan, magenta, yellow, black


def _nodes(levels: Levels) -> NDArray[np.float64]:
    """Return the recipes (nodes, 4) of every combination of levels."""
    return np.array(list(product(*(level.tolist() for level in levels))))


def effective_area(area: NDArray[np.float64], curves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the effective dot areas of nominal ones, (m, 4) -> (m, 4).

    curves (4, 2) as in ``Neugebauer.curves``.
    """
    gain = curves[:, 0] + curves[:, 1] * (2 * area - 1)
    return np.asarray(area + 4 * area * (1 - area) * gain, dtype=np.float64)


def _shares(cmyk: NDArray[np.float64], curves: NDArray[np.float64], levels: Levels) -> NDArray[np.float64]:
    """Return the share of the page that each node covers, (m, nodes).

    The shares are multilinear between nodes and sum to 1.
    """
    area = effective_area(cmyk, curves)
    share = np.ones((len(cmyk), 1))
    for ink, level in enumerate(levels):
        stops = effective_area(np.repeat(level[:, None], INKS, axis=1), curves)[:, ink]
        cell = np.clip(np.searchsorted(stops, area[:, ink], side="right") - 1, 0, len(stops) - 2)
        part = (area[:, ink] - stops[cell]) / (stops[cell + 1] - stops[cell])
        hat = np.zeros((len(cmyk), len(stops)))
        rows = np.arange(len(cmyk))
        hat[rows, cell] = 1 - part
        hat[rows, cell + 1] = part
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
