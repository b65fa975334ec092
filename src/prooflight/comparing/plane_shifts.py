"""Planes far out of register: what each ink's plane, printed elsewhere, would explain of a residual.

Registration follows a plane by its slopes, a few tenths of a millimetre; further off, edges lie beyond what slopes
foresee. Here every shift within reach is tried at once: with P the effect of a plane's ink, r the residual and V its
variance, N(d) = sum (P(x - d) - P(x)) r / V and D(d) = sum (P(x - d) - P(x))^2 / V are correlations, and N / D is the
share of the plane that lies there: 1 where all of it does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy import fft

if TYPE_CHECKING:
    from numpy.typing import NDArray

CELL_MM: Final = 0.5
REACH_MM: Final = 2.0
NEAR_MM: Final = 0.2
"""Closer, registration and the fit see it better."""
DOUBT: Final = 0.05
"""Share of a plane that seems to lie elsewhere on good prints, from what edges leave. assumed: press world, 5 %."""


def plane_shifts(
    left: NDArray[np.float32], weight: NDArray[np.float32], gain: NDArray[np.float32], *, pixel_mm: float
) -> NDArray[np.float64]:
    """Whether each plane lies elsewhere: (inks, 4) how sure that is [sd], what share does [-], right and down [mm].

    left, weight (sensors, lines, pixels): residuals, darker is more [DN], and 1 / V; gain (sensors, inks, lines,
    pixels) what a whole plane darkens [DN].
    """
    side = max(int(CELL_MM / pixel_mm + 0.5), 1)
    reach = round(REACH_MM / (side * pixel_mm))
    weights = _cells(weight, side)
    pushes = _cells(left * weight, side)
    lines, pixels = weights.shape[-2:]
    shape = (fft.next_fast_len(lines + reach, real=True), fft.next_fast_len(pixels + reach, real=True))
    steps = np.arange(-reach, reach + 1) * side * pixel_mm
    away_mm = np.hypot(*np.meshgrid(steps, steps))
    wanted = (away_mm >= NEAR_MM) & (away_mm <= REACH_MM)

    def spectrum(image: NDArray[np.floating]) -> NDArray[np.complexfloating]:
        return np.asarray(fft.rfft2(image.astype(np.float32), s=shape, workers=1))

    of_pushes, of_weights = [spectrum(one) for one in pushes], [spectrum(one) for one in weights]
    found = np.zeros((gain.shape[1], 4))
    for ink in range(gain.shape[1]):
        crossed = np.zeros((3, *of_weights[0].shape), of_weights[0].dtype)
        for sensor, of_weight in enumerate(of_weights):
            plane = _cells(gain[sensor, ink], side) / side**2
            of_plane = spectrum(plane).conj()
            crossed[0] += of_pushes[sensor] * of_plane
            crossed[1] += of_weight * spectrum(plane**2).conj()
            crossed[2] += spectrum(weights[sensor] * plane) * of_plane
        push, there, both = (_lags(one, shape, reach) for one in crossed)
        here = reach, reach
        explained = push - push[here]
        power = np.maximum(there + there[here] - 2 * both, 0)
        doubt = np.sqrt(power + (DOUBT * power) ** 2 + 1)
        sure = np.where(wanted, explained / doubt, 0).clip(min=0)
        share = np.where(wanted, explained / (power + 1 / DOUBT**2), 0).clip(min=0)
        down, right = np.unravel_index(sure.argmax(), sure.shape)
        found[ink] = sure.max(), share.max(), steps[right], steps[down]
    return found


def _cells(image: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Sums over squares of so many pixels: (..., lines // side, pixels // side)."""
    lines, pixels = (size // side for size in image.shape[-2:])
    whole = image[..., : lines * side, : pixels * side]
    return np.asarray(whole.reshape(*image.shape[:-2], lines, side, pixels, side).sum(axis=(-3, -1)))


def _lags(crossed: NDArray[np.complexfloating], shape: tuple[int, int], reach: int) -> NDArray[np.float64]:
    """Correlation at shifts of up to ``reach`` cells: (2 reach + 1, 2 reach + 1), no shift in the middle."""
    every = fft.irfft2(crossed, s=shape, workers=1)
    return np.roll(every, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1].astype(np.float64)
