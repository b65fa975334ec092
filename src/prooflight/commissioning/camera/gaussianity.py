"""Where temporal noise is Gaussian: everywhere but near the converter's two ends (paper, section 3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from prooflight.camera.sensor import FixedPattern, read_out
from prooflight.commissioning.characterise import ROUNDING_DN2, signal_dn, variance_dn2
from prooflight.press.artefact import ClippedShare

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.camera.sensor import LineSensor

CLEAR_SIGMA = 4.0
"""A Gaussian has 3e-5 of its weight beyond four sigma: clipping it there changes its variance by 0.03 %."""


def near_the_ends(
    sensor: LineSensor, electrons: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether the noise of photo-electrons (...) is cut off at 0 DN, and at the top code; two (...) arrays.

    Closed form: the digital number's mean with dark signal and black level lies within ``CLEAR_SIGMA`` temporal
    sigma of that end, in a column of gain 1 without DSNU.
    """
    mean = signal_dn(sensor, electrons + sensor.dark_e) + sensor.black_level_dn
    reach = CLEAR_SIGMA * np.sqrt(variance_dn2(sensor, electrons) - ROUNDING_DN2)
    return mean < reach, mean > sensor.top_code_dn - reach


def clipped_share(sensor: LineSensor, mean_dn: NDArray[np.float32]) -> ClippedShare:
    """Shares of the nodes of a mean table (33, 33, 33, 33) [DN above dark] whose noise is cut off."""
    electrons = mean_dn.astype(np.float64) / sensor.dn_per_e
    black, saturation = near_the_ends(sensor, electrons)
    return ClippedShare(black=float(black.mean()), saturation=float(saturation.mean()))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape:
    """How far repeated exposures of some colours are from a Gaussian; every array (colours,)."""

    skewness: NDArray[np.float64]
    excess_kurtosis: NDArray[np.float64]
    skewness_allowed: NDArray[np.float64]
    """Greatest size by which a Gaussian's (rounded, plus shot noise) differs from 0 in so few exposures. [-]"""
    excess_kurtosis_allowed: NDArray[np.float64]

    @property
    def gaussian(self) -> NDArray[np.bool_]:
        """Whether both stay within what is allowed."""
        within: NDArray[np.bool_] = np.abs(self.skewness) <= self.skewness_allowed
        return within & (np.abs(self.excess_kurtosis) <= self.excess_kurtosis_allowed)


STANDARD_ERRORS = 5.0


def exposed_shape(
    sensor: LineSensor, electrons: NDArray[np.float64], *, lines: int, rng: np.random.Generator
) -> Shape:
    """Skewness and excess kurtosis of ``lines`` simulated exposures of each of electrons (colours,) [e-].

    Allowed is five standard errors of a Gaussian's, sqrt(6 / n) and sqrt(24 / n) (Joanes and Gill 1998), plus what is
    there before clipping: a Poisson of mean m has third and fourth cumulant m, a code of rounding the fourth cumulant
    -1 / 120 DN^4, and of its third at most a like size where sigma is about a code (Sheppard's corrections).
    """
    count = electrons.size
    pattern = FixedPattern(gain=np.ones(count), offset_e=np.zeros(count))
    dn = read_out(sensor, np.broadcast_to(electrons, (lines, count)), pattern=pattern, rng=rng).astype(
        np.float64
    )
    away = dn - dn.mean(axis=0)
    variance = (away**2).mean(axis=0)
    moved = np.maximum(variance, 1e-12)
    want = variance_dn2(sensor, electrons)
    shot_dn = (electrons + sensor.dark_e) * sensor.dn_per_e**3
    rounding = 1 / 120
    return Shape(
        skewness=(away**3).mean(axis=0) / moved**1.5,
        excess_kurtosis=(away**4).mean(axis=0) / moved**2 - 3,
        skewness_allowed=STANDARD_ERRORS * np.sqrt(6 / lines) + (shot_dn + rounding) / want**1.5,
        excess_kurtosis_allowed=STANDARD_ERRORS * np.sqrt(24 / lines)
        + (shot_dn * sensor.dn_per_e + rounding) / want**2,
    )
