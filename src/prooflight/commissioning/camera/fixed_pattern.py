"""Fixed-pattern noise: each column's own line of mean against level, and the spread over columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.errors import ScanError

if TYPE_CHECKING:
    from prooflight.commissioning.camera.exposures import Exposure

HIGH_PASS_COLUMNS = 25
"""Width of the high-pass window: as many columns as the 5 x 5 box of EMVA 1288's high-pass filter holds."""
HIGH_PASS_DEGREE = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """Measured value and its standard error."""

    value: float
    standard_error: float

    def times(self, factor: float) -> Measured:
        """Return the value in another unit, or of something proportional."""
        return Measured(value=self.value * factor, standard_error=self.standard_error * factor)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ColumnLines:
    """Straight line of each column's mean against the mean of all columns."""

    slope: NDArray[np.float64]
    """Slopes (pixels,), 1 on average. [-]"""
    intercept: NDArray[np.float64]
    """Means (pixels,) of the columns at the centre. [DN]"""
    centre_dn: float
    error2: float
    """Variance of an intercept from temporal noise, mean over columns. [DN^2]"""
    slope_error2: float

    @classmethod
    def fit(cls, exposures: Sequence[Exposure], variance_dn2: NDArray[np.float64]) -> ColumnLines:
        """Fit every column by weighted least squares; weights are lines over temporal variance."""
        means = np.stack([exposure.column_mean_dn for exposure in exposures])
        level = means.mean(axis=1)
        weight = np.array([exposure.lines for exposure in exposures]) / variance_dn2
        centre = float(np.average(level, weights=weight))
        moment = float(weight @ (level - centre) ** 2)
        return cls(
            slope=(weight * (level - centre)) @ means / moment,
            intercept=np.average(means, axis=0, weights=weight),
            centre_dn=centre,
            error2=float(1 / weight.sum()),
            slope_error2=1 / moment,
        )

    def at(self, level_dn: float) -> NDArray[np.float64]:
        """Return the means of the columns at a mean of all. (pixels,) [DN]"""
        return self.intercept + self.slope * (level_dn - self.centre_dn)

    def error2_at(self, level_dn: float) -> float:
        """Return the variance of ``at`` from temporal noise. [DN^2]"""
        return self.error2 + self.slope_error2 * (level_dn - self.centre_dn) ** 2


def level_of_clipped(
    dark: Sequence[Exposure], columns: ColumnLines, *, constant: float, gain: float
) -> Measured:
    """Return the mean level, before clipping, at which columns would have the mean of clipped dark exposures.

    ScanError if those are code 0 throughout.
    """
    lines = np.array([exposure.lines for exposure in dark], dtype=np.float64)
    shown = float(np.average([exposure.mean_dn for exposure in dark], weights=lines))
    highest = max(exposure.highest_dn for exposure in dark) + 1.0
    if shown == 0:
        remedy = "raise the camera's black level by a few codes and record again"
        raise ScanError("dark exposures", "are code 0 throughout", remedy=remedy)

    def excess(level_dn: float) -> float:
        sigma = np.sqrt(max(constant + gain * level_dn - ROUNDING_DN2, 1e-6))
        return float(_shown_mean(columns.at(level_dn), sigma).mean()) - shown

    lowest = -1.0
    while excess(lowest) > 0:
        lowest *= 2
    level = float(optimize.brentq(excess, lowest, highest))
    slope = (excess(level + 1e-3) - excess(level - 1e-3)) / 2e-3
    variance = float(np.average([exposure.variance_dn2 for exposure in dark], weights=lines))
    shown_error2 = variance / lines.sum() / columns.slope.size
    # Where columns are clipped their own lines stand in, whose errors are independent from column to column.
    error2 = shown_error2 / max(slope, 1e-6) ** 2 + columns.error2_at(level) / columns.slope.size
    return Measured(value=level, standard_error=float(np.sqrt(error2)))


def _shown_mean(mean_dn: NDArray[np.float64], sigma_dn: float) -> NDArray[np.float64]:
    """Return the mean of a Gaussian rounded to integers and clipped at 0: sum over k >= 1 of P(x >= k - 1/2).

    Shapes (n,).
    """
    last = int(np.ceil(max(float(mean_dn.max()), 0.0) + 8 * sigma_dn)) + 1
    codes = np.arange(1, last + 1)
    return special.ndtr((mean_dn[:, None] - codes + 0.5) / sigma_dn).sum(axis=1)


def prnu_percent(columns: ColumnLines) -> Measured:
    """Return the standard deviation of the columns' gains about a running parabola, temporal noise removed. [%]

    A high-pass filter with coefficients h leaves sum(h^2) of the variance of independent columns; EMVA 1288
    corrects its own box filter alike. Half a window at each end is left out.
    """
    half = HIGH_PASS_COLUMNS // 2
    # The parabola's value in the middle is a weighted mean of the window (Savitzky and Golay 1964).
    smoothing = np.linalg.pinv(np.vander(np.arange(-half, half + 1.0), HIGH_PASS_DEGREE + 1))[-1]
    smooth = np.convolve(columns.slope, smoothing, mode="valid")
    left = columns.slope[half:-half] / smooth - 1
    passed_share = 1 - 2 * smoothing[half] + float(smoothing @ smoothing)
    noise = columns.slope_error2 * float(np.mean(1 / smooth**2))
    return spread(left / np.sqrt(passed_share), error2=noise, freedom=passed_share * left.size).times(100)


def spread(values: NDArray[np.float64], *, error2: float, freedom: float) -> Measured:
    """Return the standard deviation of true values from measured ones (n,) and the variance of their errors.

    It is 0 where the errors exceed it. Its standard error is the one of a Gaussian population's from a sample
    of this size.
    """
    total = float(values.var(ddof=1))
    error = total * np.sqrt(2 / freedom)
    value = float(np.sqrt(max(total - error2, 0.0)))
    return Measured(value=value, standard_error=float(error / (2 * value) if value > 0 else np.sqrt(error)))
