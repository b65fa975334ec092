"""Cubic radial basis functions on the square root of reflectance, bare or on top of a Neugebauer model.

    sqrt R(x) = sqrt R_trend(x) + sum_i c_i |x - x_i|^3 + b . (1, x),   sum_i c_i (1, x_i) = 0,

x being the recipe, as in Wendland, "Scattered Data Approximation" (2005), chapter 8. Measurement noise is
allowed for by smoothing: K + lambda / count on the diagonal (repeats count), lambda by exact leave-one-out
(Rippa's rule: the error at a left-out recipe is c_i divided by the diagonal of the inverse). The score it
minimises is the mean CIEDE2000, not the rms of the spectrum: charts have noise in dim bands that no camera
sees, and that would call for blurring what it does see.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from prooflight.inks.neugebauer import Neugebauer
from prooflight.inks.reflectance import BRIGHTEST, DARKEST, in_chunks
from prooflight.spectra import BANDS, delta_e00, lab

_SMOOTHING: Final = 10.0 ** np.arange(-9.0, 1.6, 0.5)
_FEWEST: Final = 12  # assumed: 5 of the tail, and some left to see a curvature
_CHUNK: Final = 1024


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RadialBasis:
    """Cubic radial basis functions on the square root of reflectance."""

    cmyk: NDArray[np.float64]
    """Measured recipes (n, 4), ink fractions. [-]"""
    coefficients: NDArray[np.float64]
    """Coefficients c (n, 36) of the functions. [-]"""
    tail: NDArray[np.float64]
    """Coefficients b (5, 36) of the linear part. [-]"""
    smoothing: float
    """Smoothing parameter lambda. [-]"""
    trend: Neugebauer | None = None
    """Model that the functions are added to."""

    @property
    def name(self) -> str:
        """Return ``radial-basis``, or ``hybrid`` with a trend."""
        return "radial-basis" if self.trend is None else "hybrid"

    @classmethod
    def fit(
        cls,
        cmyk: NDArray[np.float64],
        reflectance: NDArray[np.float64],
        count: NDArray[np.int64] | None = None,
    ) -> Self:
        """Interpolate or smooth the spectra as such.

        ValueError for fewer than 12 recipes or an ink never varied.
        """
        return cls._on(None, cmyk, reflectance, count)

    @classmethod
    def _on(
        cls,
        trend: Neugebauer | None,
        cmyk: NDArray[np.float64],
        reflectance: NDArray[np.float64],
        count: NDArray[np.int64] | None,
    ) -> Self:
        plane = _plane(cmyk)
        if len(cmyk) < _FEWEST or np.linalg.matrix_rank(plane) < plane.shape[1]:
            message = f"{len(cmyk)} recipes do not determine it: at least {_FEWEST}, and every ink varied on its own"
            raise ValueError(message)
        base = np.zeros((len(cmyk), BANDS)) if trend is None else np.sqrt(trend.reflectance(cmyk))
        wanted = np.sqrt(np.maximum(reflectance, DARKEST))
        noise = 1.0 / (np.ones(len(cmyk)) if count is None else count)
        system = _System(cmyk, plane, noise, wanted - base)
        wanted_lab = lab(reflectance)

        def left_out(smoothing: float) -> float:
            predicted = np.maximum(wanted - system.left_out(smoothing), 0.0) ** 2
            return float(delta_e00(lab(predicted), wanted_lab).mean())

        smoothing = float(min(_SMOOTHING, key=left_out))
        coefficients, tail = system.solve(smoothing)
        return cls(cmyk=cmyk, coefficients=coefficients, tail=tail, smoothing=smoothing, trend=trend)

    def reflectance(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the reflectance factor of recipes (..., 4) -> (..., 36), see ``ReflectanceModel``."""

        def summed(recipes: NDArray[np.float64]) -> NDArray[np.float64]:
            root = _cubes(recipes, self.cmyk) @ self.coefficients + _plane(recipes) @ self.tail
            if self.trend is not None:
                root += np.sqrt(self.trend.reflectance(recipes))
            return np.clip(root, DARKEST**0.5, BRIGHTEST**0.5) ** 2

        return in_chunks(summed, cmyk, BANDS, chunk=_CHUNK)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the arrays that ``from_arrays`` needs."""
        trend = (
            {}
            if self.trend is None
            else {f"trend.{key}": value for key, value in self.trend.arrays().items()}
        )
        own = {"cmyk": self.cmyk, "coefficients": self.coefficients, "tail": self.tail}
        return {**own, "smoothing": np.array([self.smoothing]), **trend}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.float64]]) -> Self:
        """Return the model that gave ``arrays``."""
        below = {
            key.removeprefix("trend."): value for key, value in arrays.items() if key.startswith("trend.")
        }
        return cls(
            cmyk=arrays["cmyk"],
            coefficients=arrays["coefficients"],
            tail=arrays["tail"],
            smoothing=float(arrays["smoothing"][0]),
            trend=Neugebauer.from_arrays(below) if below else None,
        )


class Hybrid(RadialBasis):
    """Radial basis functions of a Neugebauer model's residuals: physics far from patches, measurements near them."""

    __slots__ = ()

    @classmethod
    def fit(
        cls,
        cmyk: NDArray[np.float64],
        reflectance: NDArray[np.float64],
        count: NDArray[np.int64] | None = None,
    ) -> Self:
        """Fit the Neugebauer model, then its residuals; ValueError as ``RadialBasis.fit``."""
        return cls._on(Neugebauer.fit(cmyk, reflectance, count), cmyk, reflectance, count)


class _System:
    """Linear system of one chart, decomposed once so that each smoothing costs a matrix product."""

    def __init__(
        self,
        cmyk: NDArray[np.float64],
        plane: NDArray[np.float64],
        noise: NDArray[np.float64],
        values: NDArray[np.float64],
    ) -> None:
        self.cubes, self.plane, self.noise, self.values = _cubes(cmyk, cmyk), plane, noise[:, None], values
        # With c = u / sqrt(noise) the noise is the same for all, and sum c_i (1, x_i) = 0 says that u is at
        # right angles to five known vectors; those are moved to the top of the spectrum, where they can be
        # dropped.
        precision = 1.0 / np.sqrt(self.noise)
        barred, _ = np.linalg.qr(precision * plane)
        stiffness = precision * self.cubes * precision.T
        stiffness -= barred @ (barred.T @ stiffness)
        stiffness -= (stiffness @ barred) @ barred.T
        above = 2.0 * np.linalg.norm(stiffness)
        weights, vectors = eigh((stiffness + stiffness.T) / 2 + above * (barred @ barred.T), overwrite_a=True)
        rank = len(cmyk) - plane.shape[1]
        self.weights = np.maximum(weights[:rank], 1e-14 * weights[rank - 1])
        self.vectors = precision * vectors[:, :rank]
        self.squares = self.vectors**2
        self.projected = self.vectors.T @ values

    def coefficients(self, smoothing: float) -> NDArray[np.float64]:
        """Return c for one smoothing, (n, bands)."""
        return np.asarray(
            self.vectors @ (self.projected / (self.weights + smoothing)[:, None]), dtype=np.float64
        )

    def left_out(self, smoothing: float) -> NDArray[np.float64]:
        """Return the leave-one-out residuals, measured minus predicted from all others, (n, bands)."""
        diagonal = self.squares @ (1.0 / (self.weights + smoothing))
        return self.coefficients(smoothing) / diagonal[:, None]

    def solve(self, smoothing: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return c (n, bands) and b (5, bands)."""
        c = self.coefficients(smoothing)
        rest = self.values - self.cubes @ c - smoothing * self.noise * c
        tail = np.linalg.lstsq(self.plane, rest, rcond=None)[0]
        return c, np.asarray(tail, dtype=np.float64)


def _plane(cmyk: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (1, x) about the middle of the cube, (m, 5)."""
    return np.concatenate([np.ones((len(cmyk), 1)), cmyk - 0.5], axis=1)


def _cubes(cmyk: NDArray[np.float64], centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return |x - x_i|^3, (m, 4) and (n, 4) -> (m, n)."""
    squared = cmyk @ (-2.0 * centres.T)
    squared += (cmyk**2).sum(axis=1)[:, None]
    squared += (centres**2).sum(axis=1)
    np.maximum(squared, 0.0, out=squared)
    return squared * np.sqrt(squared)
