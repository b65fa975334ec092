"""Noise as a function of signal from flat patches: variance = constant + gain x signal + halftone's variance.

Shot noise rises with the signal alone; the grain of a halftone also depends on the inks that give the signal.
Paper has none and solids little, so patches of the same signal separate the two in a single scan.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import nnls

from prooflight.camera.sensor import ROUNDING_DN2

if TYPE_CHECKING:
    from numpy.typing import NDArray

_ROUNDS = 8
_OUTLIER = 4.0
_AREA_ERROR = 0.03  # assumed: how far a solid's ink may be from closed; a few per cent of gaps are grain too
_GRAIN_ERROR = 0.2  # assumed: relative error of the law of a halftone's grain, which hides the noise under it


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalNoise:
    """Temporal noise of one sensor."""

    constant_dn2: float
    """Variance at 0 DN, rounding included. [DN^2]"""
    gain_dn: float
    """Increase of variance for each digital number of signal. [DN]"""
    grain: float
    """Variance of halftone, over sum_i (d signal / d ink_i)^2 a_i (1 - a_i). [-]"""

    def variance_dn2(self, dn: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the temporal variance at digital numbers (...). [DN^2]"""
        return np.asarray(self.constant_dn2 + self.gain_dn * np.maximum(dn, 0.0), dtype=np.float64)


def fit_noise(
    dn: NDArray[np.float64],
    variance_dn2: NDArray[np.float64],
    halftone_dn2: NDArray[np.float64],
    inked_dn2: NDArray[np.float64],
    pixels: NDArray[np.float64],
) -> SignalNoise:
    """Fit the noise by weighted least squares with no term below 0; all arrays (patches,).

    halftone_dn2: sum over inks of (d signal / d ink)^2 a (1 - a); inked_dn2: the same sum without a (1 - a),
    over inks that are there.

    Weights come from the fitted variances (a sample variance of n pixels errs by sqrt(2 / n) of itself) and
    from how well the law of grain is known; outliers are left out in turn. The constant is at least that of
    rounding.
    """
    design = np.column_stack([np.ones_like(dn), np.maximum(dn, 0.0), halftone_dn2])
    used = np.ones(dn.size, dtype=bool)
    fitted = np.maximum(variance_dn2, ROUNDING_DN2)
    coarse = halftone_dn2 >= max(float(np.median(halftone_dn2)), 1e-12)
    grain = float(np.median(variance_dn2[coarse] / halftone_dn2[coarse])) if coarse.any() else 0.0
    terms = np.array([0.0, 0.0, grain])
    size = np.maximum(np.abs(design).max(axis=0), 1e-12)
    for _ in range(_ROUNDS):
        doubt = terms[2] * (_GRAIN_ERROR * halftone_dn2 + _AREA_ERROR * inked_dn2)
        error = np.hypot(fitted * np.sqrt(2 / np.maximum(pixels, 2)), doubt)
        weight = used / error
        terms = nnls(design / size * weight[:, None], variance_dn2 * weight)[0] / size
        fitted = np.maximum(design @ terms, ROUNDING_DN2)
        away = np.abs(variance_dn2 - fitted) / error
        used = away <= _OUTLIER * max(1.48 * float(np.median(away)), 1.0)
    return SignalNoise(
        constant_dn2=max(float(terms[0]), ROUNDING_DN2), gain_dn=float(terms[1]), grain=float(terms[2])
    )
