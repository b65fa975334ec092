"""Photon transfer: a sensor's own parameters from dark and flat exposures alone (EMVA 1288, Release 4.0 Linear).

Where light is uniform, the temporal variance of the digital number rises with its mean as

    variance = K mean + constant,   K the system gain [DN/e-],

because shot noise is Poisson. K, and from the line's value without charge the read noise, follow without
knowing the light. Fixed differences between columns follow from each column's own line of mean against level.

Three departures from the standard, for line cameras as they are used here:

- One weighted line is fitted to all levels (weights by each variance's own standard error), not K from differences to
  the dark variance: it holds where dark exposures are clipped at code 0, as with a black level of 0, or where their
  noise is too small for the converter.
- Such dark exposures are not averaged as they are. The level without light is where the columns' own lines, with
  Gaussian noise of the fitted variance, rounded and clipped at 0, have the mean of the dark exposures.
- PRNU is the residual of the columns' gains after a running parabola over 25 columns, the number of pixels in the
  5 x 5 box of the standard's high-pass filter: lamp profile and cos^4 are smooth, and no property of the sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.commissioning.camera.fixed_pattern import (
    ColumnLines,
    Measured,
    level_of_clipped,
    prnu_percent,
    spread,
)
from prooflight.errors import ScanError

if TYPE_CHECKING:
    from prooflight.commissioning.camera.exposures import Exposure

CLIPPED_SHARE = 0.001
"""Share of samples at an end of the range above which an exposure is clipped.

EMVA 1288 lets 0.5 % of a dark image underflow; that lowers the variance of Gaussian noise by 2 %, 0.1 % by
0.4 %.
"""
LINEAR_SHARE = 0.7
"""Share of the saturation level up to which photon transfer is fitted (EMVA 1288)."""
LEAST_LEVELS = 3
LEAST_VARIANCE_DN2 = 0.35
"""Least variance at which rounding does not hide the noise. [DN^2]

Below it rounding no longer adds 1/12 but an amount that depends on the mean's place between two codes, by 2 %
of the variance here, by 14 % at EMVA 1288's own limit of 0.24.
"""
_ROUNDS = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PhotonTransfer:
    """Fitted line and columns; everything in digital numbers but for ``gain``."""

    gain: Measured
    """System gain K. [DN/e-]"""
    constant_dn2: float
    """Variance at mean 0, rounding included. [DN^2]"""
    covariance: NDArray[np.float64]
    """Covariance (2, 2) of constant and K."""
    no_light_dn: Measured
    """Mean over columns without light, before clipping: black level and dark signal. [DN]"""
    dark_clipped: bool
    dark_hidden: bool
    """Whether rounding hides the dark exposures' noise."""
    offset_dn: NDArray[np.float64]
    """Mean of each column (pixels,) without light, before clipping. [DN]"""
    column_gain: NDArray[np.float64]
    """Signal of each column (pixels,) over the mean of all: lamp, cos^4 and PRNU. [-]"""
    dsnu_dn: Measured
    prnu_percent: Measured
    saturation_dn: float | None
    """Mean at which the variance is greatest; None: the exposures do not reach it. [DN]"""
    line_noise_dn: float
    """Standard deviation from line to line in the dark that all columns share. [DN]"""
    level_dn: NDArray[np.float64]
    """Means (exposures,) of dark and flat exposures, rising. [DN]"""
    variance_dn2: NDArray[np.float64]
    used: NDArray[np.bool_]
    """Whether the line was fitted to each of them."""
    worst_residual: float
    """Largest distance of a fitted variance from the line over its standard error. [-]"""

    def variance_at(self, mean_dn: float) -> Measured:
        """Return the variance of shot and read noise, without rounding, at a mean. [DN^2]"""
        direction = np.array([1.0, mean_dn])
        value = self.constant_dn2 + self.gain.value * mean_dn - ROUNDING_DN2
        return Measured(value=value, standard_error=float(np.sqrt(direction @ self.covariance @ direction)))

    def read_noise_e(self, mean_dn: float) -> Measured:
        """Return the temporal noise at a mean; 0 where rounding hides it. At the black level: one read's. [e-]

        Standard error by the delta method, with the covariance of constant and K.
        """
        variance = self.variance_at(mean_dn).value
        gain = self.gain.value
        slope = np.array([1 / gain**2, mean_dn / gain**2 - 2 * variance / gain**3])
        error_e2 = float(np.sqrt(slope @ self.covariance @ slope))
        noise = np.sqrt(max(variance, 0.0)) / gain
        return Measured(
            value=float(noise), standard_error=error_e2 / (2 * noise) if noise > 0 else error_e2**0.5
        )


def photon_transfer(
    dark: Sequence[Exposure], flat: Sequence[Exposure], *, top_code_dn: int | None = None
) -> PhotonTransfer:
    """Fit the photon transfer of one sensor.

    dark, flat: of one line rate; any number of lines each. top_code_dn: 2^bits - 1; None: the highest code
    seen counts as the top where more than 0.1 % of an exposure's samples have it. ScanError where levels are
    too few for a line.
    """
    used, saturation = _usable(dark, flat, top_code_dn)
    clipped = any(exposure.lowest_share > CLIPPED_SHARE for exposure in dark)
    hidden = any(exposure.variance_dn2 < LEAST_VARIANCE_DN2 for exposure in dark)
    fitted = list(used) if clipped or hidden else [*dark, *used]
    constant, gain, covariance, worst = _fit_line(fitted)
    columns = ColumnLines.fit(fitted, constant + gain * np.array([e.mean_dn for e in fitted]))
    if clipped or hidden:
        no_light = level_of_clipped(dark, columns, constant=constant, gain=gain)
        offset = columns.at(no_light.value)
        offset_error2 = columns.error2_at(no_light.value)
    else:
        lines = np.array([exposure.lines for exposure in dark], dtype=np.float64)
        offset = np.average([exposure.column_mean_dn for exposure in dark], axis=0, weights=lines)
        variance = float(np.average([exposure.variance_dn2 for exposure in dark], weights=lines))
        offset_error2 = variance / lines.sum()
        no_light = Measured(
            value=float(offset.mean()), standard_error=float(np.sqrt(offset_error2 / offset.size))
        )
    everything = sorted([*dark, *flat], key=lambda exposure: exposure.mean_dn)
    return PhotonTransfer(
        gain=Measured(value=gain, standard_error=float(np.sqrt(covariance[1, 1]))),
        constant_dn2=constant,
        covariance=covariance,
        no_light_dn=no_light,
        dark_clipped=clipped,
        dark_hidden=hidden,
        offset_dn=offset,
        column_gain=columns.slope,
        dsnu_dn=spread(offset, error2=offset_error2, freedom=offset.size - 1),
        prnu_percent=prnu_percent(columns),
        saturation_dn=saturation,
        line_noise_dn=float(np.sqrt(np.mean([exposure.line_variance_dn2 for exposure in dark]))),
        level_dn=np.array([exposure.mean_dn for exposure in everything]),
        variance_dn2=np.array([exposure.variance_dn2 for exposure in everything]),
        used=np.array([exposure in fitted for exposure in everything]),
        worst_residual=worst,
    )


def dark_level(transfer: PhotonTransfer, dark: Exposure) -> Measured:
    """Return the mean over columns of a dark exposure of any duration, before clipping. [DN]"""
    if dark.lowest_share <= CLIPPED_SHARE and dark.variance_dn2 >= LEAST_VARIANCE_DN2:
        error2 = dark.variance_dn2 / dark.lines / dark.column_mean_dn.size
        return Measured(value=dark.mean_dn, standard_error=float(np.sqrt(error2)))
    columns = ColumnLines(
        slope=np.ones(transfer.offset_dn.size),
        intercept=transfer.offset_dn - transfer.no_light_dn.value,
        centre_dn=0.0,
        error2=0.0,
        slope_error2=0.0,
    )
    level = level_of_clipped([dark], columns, constant=transfer.constant_dn2, gain=transfer.gain.value)
    shared = transfer.no_light_dn.standard_error
    return Measured(value=level.value, standard_error=float(np.hypot(level.standard_error, shared)))


def _usable(
    dark: Sequence[Exposure], flat: Sequence[Exposure], top_code_dn: int | None
) -> tuple[list[Exposure], float | None]:
    """Select flat exposures between black and 70 % of saturation, by level.

    Return the saturation level if it is reached.
    """
    if not dark or not flat:
        what, which = f"{len(dark)} dark and {len(flat)} flat exposures", "dark" if not dark else "flat"
        remedy = f"record {which} exposures too: lens covered, and uniform light at 8 or more levels"
        raise ScanError(f"{which} exposures", what, remedy=remedy)
    flat = sorted(flat, key=lambda exposure: exposure.mean_dn)
    highest = max(exposure.highest_dn for exposure in flat)
    top = highest if top_code_dn is None else top_code_dn
    if highest > top:
        brightest = max(flat, key=lambda exposure: exposure.highest_dn)
        what = f"holds code {highest}, more than {top}"
        raise ScanError(brightest.name, what, remedy="give the number of bits that the camera has")
    at_top = [e.highest_dn == top and e.highest_share > CLIPPED_SHARE for e in flat]
    peak = int(np.argmax([exposure.variance_dn2 for exposure in flat]))
    reached = any(at_top) or (peak < len(flat) - 1 and _falls(flat[peak], flat[peak + 1 :]))
    saturation = flat[peak].mean_dn if reached else None
    ceiling = flat[peak].mean_dn if reached or top_code_dn is None else float(top)
    floor = min(exposure.mean_dn for exposure in dark)
    limit = floor + LINEAR_SHARE * (ceiling - floor) if reached or top_code_dn is not None else np.inf
    used = [
        exposure
        for exposure, topped in zip(flat, at_top, strict=True)
        if not topped and exposure.lowest_share <= CLIPPED_SHARE and exposure.mean_dn <= limit
    ]
    loud = [exposure for exposure in used if exposure.variance_dn2 >= LEAST_VARIANCE_DN2]
    if _levels(loud, floor) < LEAST_LEVELS <= _levels(used, floor):
        what = f"rounding hides the noise: their variance is below {LEAST_VARIANCE_DN2:g} DN^2"
        raise ScanError("flat exposures", what, remedy="record with more bits or a higher gain of the camera")
    if _levels(loud, floor) < LEAST_LEVELS:
        what = f"only {_levels(loud, floor)} levels of light are between {floor:.0f} and {min(limit, ceiling):.0f} DN"
        remedy = (
            "record uniform light at 8 or more levels, from just above dark to saturation, without clipping"
        )
        raise ScanError("flat exposures", what, remedy=remedy)
    return loud, saturation


def _falls(peak: Exposure, later: Sequence[Exposure]) -> bool:
    """Return whether variance after the peak falls by more than chance allows, 5 standard errors."""
    least = min(later, key=lambda exposure: exposure.variance_dn2)
    error = np.hypot(_standard_error(peak), _standard_error(least))
    return peak.variance_dn2 - least.variance_dn2 > 5 * error


def _standard_error(exposure: Exposure) -> float:
    return float(exposure.variance_dn2 * np.sqrt(2 / exposure.degrees_of_freedom))


def _levels(exposures: Sequence[Exposure], floor: float) -> int:
    """Count the levels, a twentieth of their range apart or more, of exposures in rising order."""
    levels: list[float] = []
    for exposure in exposures:
        if not levels or exposure.mean_dn > levels[-1] + (exposures[-1].mean_dn - floor) / 20:
            levels.append(exposure.mean_dn)
    return len(levels)


def _fit_line(exposures: Sequence[Exposure]) -> tuple[float, float, NDArray[np.float64], float]:
    """Fit variance against mean by weighted least squares: constant, slope, their covariance, worst residual.

    Weights come from the fitted variances: the measured ones would favour exposures whose variance chance
    made small.
    """
    mean = np.array([exposure.mean_dn for exposure in exposures])
    variance = np.array([exposure.variance_dn2 for exposure in exposures])
    share = np.sqrt(2 / np.array([exposure.degrees_of_freedom for exposure in exposures]))
    design = np.stack([np.ones_like(mean), mean], axis=1)
    fitted = variance
    for _ in range(_ROUNDS):
        error = share * np.maximum(fitted, ROUNDING_DN2)
        coefficients, *_ = np.linalg.lstsq(design / error[:, None], variance / error, rcond=None)
        fitted = design @ coefficients
    weighted = design / error[:, None]
    covariance = np.linalg.inv(weighted.T @ weighted)
    if coefficients[1] <= 0:
        what = "their temporal variance does not rise with their mean"
        remedy = (
            "record raw digital numbers of a lamp that does not flicker, without processing in the camera"
        )
        raise ScanError("flat exposures", what, remedy=remedy)
    worst = float(np.abs((variance - fitted) / error).max())
    return float(coefficients[0]), float(coefficients[1]), covariance, worst
