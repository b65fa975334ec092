"""Model from CMYK to light in each sensor, fitted to patches as the sensors saw them; no spectra.

    sqrt y_s(x) = sqrt y_trend,s(x) + f_s(x),   y over bare paper's,

f a Gaussian process over recipes. Two trends are tried and the one that predicts left-out patches better is
taken:

- *bands*: equation 1 of the paper in a few bands of each sensor's own, y = sum_b p_b exp(-sum_i D_ib amount_i(x_i)),
  with a tone curve for each ink; a broad sensor behind strong inks is no single band;
- *neugebauer*: ``inks.neugebauer`` with the sensors as its bands; halftones on paper that blurs.

f's covariance is the ANOVA kernel prod_i (1 + theta k(x_i, x_i')), k Gaussian (Stitson et al., "Support
vector regression with ANOVA decomposition kernels", 1999): the effect of one ink is smoother than the
interaction of four.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import least_squares

from prooflight.cmyk import INKS
from prooflight.inks.neugebauer import Neugebauer, effective_area
from prooflight.inks.reflectance import in_chunks
from prooflight.spectra import BANDS

FEWEST_RECIPES: Final = 24
"""assumed: solids and overprints of four inks, and some tints of each; fewer leave tone curves open."""
_DARKEST: Final = 1e-5
_KERNELS: Final = ((0.5, 0.5), (0.7, 1.0), (1.0, 1.0), (1.5, 3.0))  # width of k in ink fractions, and theta
_SMOOTHING: Final = 10.0 ** np.arange(-7.0, 2.1, 0.5)
_TVI, _SKEW = (-0.10, 0.24), (-0.06, 0.06)
_VALUES_A_PARAMETER: Final = 2.5  # a trend of bands needs so many readings for each of its parameters
_MOST_BANDS: Final = 3  # on four inks of known spectra a fourth changes the error by less than 0.02 sigma
_CHUNK: Final = 2048
_SLOPE_STEP: Final = 0.02
"""Step of ink by which slopes are differenced. [-]"""


class Trend(Protocol):
    """Approximate light of a recipe, to which the Gaussian process is added."""

    @property
    def name(self) -> str:
        """Return the trend's name for people, one word."""
        ...

    def light(self, cmyk: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the light over bare paper's, (m, 4) -> (m, sensors). [-]"""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandTrend:
    """Equation 1 in several bands of each sensor."""

    curves: NDArray[np.float64]
    """Tone value increase and skew (4, 2) of each ink. [-]"""
    depth: NDArray[np.float64]
    """Natural density (4,) of each ink in the band where its tints follow Murray and Davies. [-]"""
    weights: NDArray[np.float64]
    """Share (sensors, bands) of paper's light. [-]"""
    densities: NDArray[np.float64]
    """Natural density (sensors, bands, 4) of each solid. [-]"""

    @property
    def name(self) -> str:
        """Return ``bands``."""
        return "bands"

    @classmethod
    def fit(cls, cmyk: NDArray[np.float64], light: NDArray[np.float64], bands: int) -> BandTrend:
        """Fit by least squares in the square root of light, (n, 4) and (n, sensors)."""
        sensors = light.shape[1]
        design = np.column_stack([np.ones(len(cmyk)), -cmyk])
        v = np.linalg.lstsq(design, np.log(np.maximum(light, 1e-4)), rcond=None)[0]
        spread = np.linspace(0.6, 1.5, bands) if bands > 1 else np.ones(1)
        start = np.empty((sensors, bands, 5))
        start[..., 0] = v[0][:, None] - np.log(bands)
        for ink in range(INKS):
            way = spread[::-1] if ink % 2 else spread
            start[..., 1 + ink] = np.sqrt(np.maximum(v[1 + ink], 0.02)[:, None] * way)
        depth = np.log(np.clip(v[1:].max(axis=1), 0.3, 6.0))
        values = np.concatenate([np.tile([0.13, 0.0], 4), depth, start.ravel()])
        low, high = (
            np.concatenate([np.tile([tvi, skew], 4), np.full(4, depth_end), np.full(start.size, end)])
            for tvi, skew, depth_end, end in zip(_TVI, _SKEW, (-2, 2), (-12, 5), strict=True)
        )
        root = np.sqrt(np.maximum(light, _DARKEST))

        def model(values: NDArray[np.float64]) -> BandTrend:
            bands_of = values[12:].reshape(sensors, bands, 5)
            return BandTrend(
                curves=values[:8].reshape(4, 2),
                depth=np.exp(values[8:12]),
                weights=np.exp(bands_of[..., 0]),
                densities=bands_of[..., 1:] ** 2,
            )

        def residual(values: NDArray[np.float64]) -> NDArray[np.float64]:
            return (np.sqrt(model(values).light(cmyk)) - root).ravel()

        start_inside = np.clip(values, low + 1e-6, high - 1e-6)
        return model(least_squares(residual, start_inside, bounds=(low, high), max_nfev=60).x)

    def light(self, cmyk: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return light as ``Trend`` does; beyond a solid the solid's."""
        within = np.minimum(cmyk, 1.0)
        area = effective_area(within, self.curves)
        clear = np.exp(-self.depth)
        amount = -np.log(np.maximum(1 - area * (1 - clear), 1e-6)) / self.depth
        sensors, bands = self.weights.shape
        passed = np.exp(-amount @ self.densities.reshape(-1, INKS).T).reshape(-1, sensors, bands)
        return np.asarray((passed * self.weights).sum(axis=2))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NeugebauerTrend:
    """Neugebauer model with the sensors, repeated, in the place of its bands."""

    model: Neugebauer
    sensors: int

    @property
    def name(self) -> str:
        """Return ``neugebauer``."""
        return "neugebauer"

    @classmethod
    def fit(cls, cmyk: NDArray[np.float64], light: NDArray[np.float64]) -> Self:
        """Fit to (n, 4) and (n, sensors); ValueError as ``Neugebauer.fit``."""
        sensors = light.shape[1]
        repeated = np.tile(light, -(-BANDS // sensors))[:, :BANDS]
        return cls(model=Neugebauer.fit(cmyk, repeated), sensors=sensors)

    def light(self, cmyk: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return light as ``Trend`` does."""
        return self.model.reflectance(cmyk)[:, : self.sensors]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalModel:
    """Light of any recipe in every sensor, over bare paper's."""

    trend: Trend
    cmyk: NDArray[np.float64]
    """Recipes (n, 4) that the model was fitted to. [-]"""
    coefficients: NDArray[np.float64]
    """Coefficients (n, sensors) of the kernel."""
    width: float
    """Width of the kernel, in ink fractions. [-]"""
    theta: float
    left_out: NDArray[np.float64]
    """Leave-one-out residual (n, sensors) of the square root of light: measured minus predicted from all others. [-]"""

    @property
    def name(self) -> str:
        """Return the model's components for people."""
        return f"{self.trend.name} and a Gaussian process"

    @classmethod
    def fit(cls, cmyk: NDArray[np.float64], light: NDArray[np.float64], noise: NDArray[np.float64]) -> Self:
        """Fit distinct recipes (n, 4), light (n, sensors) and the relative variance (n,) of its square root.

        Trend, kernel and smoothing are those with the least squared error at left-out patches (Rippa's rule).
        """
        candidates = (
            cls._about(trend, cmyk, light, noise, width=width, theta=theta)
            for trend in _trends(cmyk, light)
            for width, theta in _KERNELS
        )
        return min(candidates, key=lambda model: float((model.left_out**2 / noise[:, None]).sum()))

    def refit(self, light: NDArray[np.float64], noise: NDArray[np.float64]) -> Self:
        """Fit the same trend and kernel to slightly different light of the same recipes."""
        return self._about(self.trend, self.cmyk, light, noise, width=self.width, theta=self.theta)

    @classmethod
    def _about(
        cls,
        trend: Trend,
        cmyk: NDArray[np.float64],
        light: NDArray[np.float64],
        noise: NDArray[np.float64],
        *,
        width: float,
        theta: float,
    ) -> Self:
        """Fit a process of one kernel about one trend."""
        rest = np.sqrt(np.maximum(light, _DARKEST)) - np.sqrt(np.maximum(trend.light(cmyk), _DARKEST))
        coefficients, left_out = _smoothed(_kernel(cmyk, cmyk, width, theta), noise, rest)
        return cls(
            trend=trend, cmyk=cmyk, coefficients=coefficients, width=width, theta=theta, left_out=left_out
        )

    def root(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the square root of light, (..., 4) -> (..., sensors)."""

        def summed(recipes: NDArray[np.float64]) -> NDArray[np.float64]:
            trend = np.sqrt(np.maximum(self.trend.light(recipes), _DARKEST))
            rest = _kernel(recipes, self.cmyk, self.width, self.theta) @ self.coefficients
            return np.maximum(trend + rest, _DARKEST**0.5)

        return in_chunks(summed, cmyk, self.coefficients.shape[1], chunk=_CHUNK)

    def light(self, cmyk: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return light, (..., 4) ink fractions -> (..., sensors) [-]."""
        return self.root(cmyk) ** 2

    def root_slopes(self, cmyk: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the change of ``root`` with each ink, (n, 4) -> (n, sensors, 4).

        The difference is one-sided at no and at full ink.
        """
        slopes = np.empty((len(cmyk), self.coefficients.shape[1], INKS))
        for ink in range(INKS):
            low, high = cmyk.copy(), cmyk.copy()
            low[:, ink] = np.maximum(cmyk[:, ink] - _SLOPE_STEP, 0)
            high[:, ink] = np.minimum(cmyk[:, ink] + _SLOPE_STEP, 1)
            slopes[:, :, ink] = (self.root(high) - self.root(low)) / (high - low)[:, ink, None]
        return slopes


def _trends(cmyk: NDArray[np.float64], light: NDArray[np.float64]) -> list[Trend]:
    sensors = light.shape[1]
    bands = (light.size / _VALUES_A_PARAMETER - 12) / (5 * sensors)
    return [
        BandTrend.fit(cmyk, light, int(np.clip(bands, 1, _MOST_BANDS))),
        NeugebauerTrend.fit(cmyk, light),
    ]


def _kernel(
    cmyk: NDArray[np.float64], others: NDArray[np.float64], width: float, theta: float
) -> NDArray[np.float64]:
    """Return the ANOVA kernel, (m, 4) and (n, 4) -> (m, n)."""
    product = np.ones((len(cmyk), len(others)))
    for ink in range(INKS):
        levels, which = np.unique(others[:, ink], return_inverse=True)
        away = (cmyk[:, ink, None] - levels) / width
        product *= (1 + theta * np.exp(-0.5 * away**2))[:, which]
    return product


def _smoothed(
    kernel: NDArray[np.float64], noise: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return coefficients (n, sensors) and leave-one-out errors at each sensor's own best smoothing."""
    precision = 1 / np.sqrt(noise)[:, None]
    weights, vectors = eigh(precision * kernel * precision.T)
    weights = np.maximum(weights, 1e-13 * weights[-1])
    vectors = precision * vectors
    squares, projected = vectors**2, vectors.T @ values
    scale = float(np.trace(kernel)) / len(kernel)
    coefficients, errors = np.empty_like(values), np.empty_like(values)
    for sensor in range(values.shape[1]):
        least = np.inf
        for smoothing in _SMOOTHING * scale:
            candidate = vectors @ (projected[:, sensor] / (weights + smoothing))
            error = candidate / (squares @ (1 / (weights + smoothing)))
            score = float((error**2 / noise).sum())
            if score < least:
                least, coefficients[:, sensor], errors[:, sensor] = score, candidate, error
    return coefficients, errors
