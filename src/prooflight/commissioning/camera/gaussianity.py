"""Where temporal noise is Gaussian: everywhere but near the converter's two ends (paper, section 3.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight.camera.sensor import ROUNDING_DN2
from prooflight.commissioning.characterise import signal_dn, variance_dn2
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
