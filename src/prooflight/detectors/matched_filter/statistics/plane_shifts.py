"""Planes far out of register: the share of a residual that each ink's plane, printed elsewhere, explains.

Registration follows a plane by its slopes, over a few tenths of a millimetre; further off, edges are beyond
the range of the linear model. Here every shift within reach is tried. With P the effect of a plane's ink, r
the residual and V its variance, N(d) = sum (P(x - d) - P(x)) r / V and D(d) = sum (P(x - d) - P(x))^2 / V,
and N / D is the share of the plane at that shift: 1 for the whole plane. For so few shifts, direct summation
takes a tenth of the time of transforms.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.detectors.matched_filter.fit.binning import binned
from prooflight.kernels.statistics.misplaced_planes import shift_sums

CELL_MM: Final = 0.5
REACH_MM: Final = 2.0
NEAR_MM: Final = 0.2
"""Minimum shift: registration and the fit measure smaller ones better."""
DOUBT: Final = 0.05
"""Standard deviation of a plane's displaced share on good prints, from what edges leave. assumed: press
world, 5 %."""


def plane_shifts(
    left: NDArray[np.float32], weight: NDArray[np.float32], gain: NDArray[np.float32], *, pixel_mm: float
) -> NDArray[np.float64]:
    """Test each plane for a displacement: (inks, 4) significance [sd], share [-], right and down [mm].

    left, weight (sensors, lines, pixels): residuals, darker is more [DN], and 1 / V; gain (sensors, inks,
    lines, pixels): darkening by a whole plane [DN].
    """
    side = max(int(CELL_MM / pixel_mm + 0.5), 1)
    reach = round(REACH_MM / (side * pixel_mm))
    weights, pushes = _means(weight, side) * side**2, _means(left * weight, side) * side**2
    steps = np.arange(-reach, reach + 1) * side * pixel_mm
    away_mm = np.hypot(*np.meshgrid(steps, steps))
    wanted = (away_mm >= NEAR_MM) & (away_mm <= REACH_MM)
    result = np.zeros((gain.shape[1], 4))
    for ink in range(gain.shape[1]):
        explained, power = np.zeros((2, *wanted.shape))
        for sensor, push in enumerate(pushes):
            plane = np.pad(_means(gain[sensor, ink], side), reach)
            shift_sums(push, weights[sensor], plane, wanted, explained, power)
        doubt = np.sqrt(power + (DOUBT * power) ** 2 + 1)
        sure = (explained / doubt).clip(min=0)
        share = (explained / (power + 1 / DOUBT**2)).clip(min=0)
        down, right = np.unravel_index(sure.argmax(), sure.shape)
        result[ink] = sure.max(), share.max(), steps[right], steps[down]
    return result


def _means(images: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Return means over whole squares of side x side pixels: (..., lines // side, pixels // side)."""
    return binned(images, side)[..., : images.shape[-2] // side, :]
