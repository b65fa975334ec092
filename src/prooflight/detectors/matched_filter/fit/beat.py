"""Beat of a press's screen against the camera's pixels, as variance of flat places (decision 47).

A tint of a screen is dots, and each camera pixel sees a few of them, never the same part: its light varies from
pixel to pixel with the beat between both lattices. Patches of every ink are screened and seen through lens and
pixel, and what is left of them is stated relative to a halftone's variance at unit contrast,
as ``ResidualVariance.contrast`` is.

A beat is correlated, so that a box, line or column of pixels that it fits sums it up where noise would average
out. What the sums of patches vary more than sums of noise would is a factor on the variance: the greatest of all sizes.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.cmyk import INKS
from prooflight.pages.raster import MM_PER_INCH
from prooflight.pages.screen import screened

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.fit.modes import Modes
    from prooflight.detectors.matched_filter.fit.nuisance import ResidualVariance
    from prooflight.pages.pdf.area_averages import InkLight
    from prooflight.pages.sampling import Footprint
    from prooflight.pages.screen import Screen

LEVELS: Final = (26, 64, 128, 191, 230)
"""Bytes of the tints that are tried: 10, 25, 50, 75 and 90 %."""
PATCH_PIXELS: Final = 96
"""Side of a patch. [camera pixels]"""
BOXES: Final = (2, 4, 8, 16)
"""Sides of boxes, and lengths of pieces of lines and columns, whose sums are compared with sums of noise. Twelve
to a side remain of the largest, so that its variance is known within a tenth."""
LEAST_SHARE: Final = 1e-9


@lru_cache(maxsize=8)
def beat_contrasts(
    screen: Screen,
    light: InkLight,
    footprint: Footprint,
    pitch_mm: tuple[float, float],
    bins: int = 1,
    *,
    correlated: bool = True,
) -> NDArray[np.float64]:
    """Return the variance of a screen's beat relative to a halftone's at unit contrast, by ink and tint.

    Parameters
    ----------
    screen
        The press's.
    light
        Light that tints take (``Press.ink_light``).
    footprint
        What one camera pixel sees.
    pitch_mm
        Pitch of the camera's pixels, across and along. [mm]
    bins
        Camera pixels that are taken together, each way.
    correlated
        Whether the variance is that of sums of pixels a pixel, or of single pixels.

    Returns
    -------
    NDArray
        Variance over J^2 a (1 - a), times the factor of correlation if ``correlated``, (4, LEVELS). [-]
    """
    across, along = (
        _seen_by(edges, footprint.reach_mm, pitch, MM_PER_INCH / screen.dpi)
        for edges, pitch in zip((footprint.across, footprint.along), pitch_mm, strict=True)
    )
    contrasts = np.empty((INKS, len(LEVELS)))
    for at, level in enumerate(LEVELS):
        plates = np.full((along.shape[1], across.shape[1], INKS), level, np.uint8)
        dots = screened(plates, screen, tone=light)
        for ink, curve in enumerate(light):
            steps, amount = np.linspace(0, 1, len(curve)), level / 255
            taken = np.interp(dots[..., ink] / 255, steps, curve)
            seen = along @ taken @ across.T
            rows, columns = (side // bins for side in seen.shape)
            seen = seen[: rows * bins, : columns * bins].reshape(rows, bins, columns, bins).mean(axis=(1, 3))
            slope = float(np.interp(amount, steps, np.gradient(np.asarray(curve), steps)))
            halftone = max(slope**2 * amount * (1 - amount), LEAST_SHARE)
            beat = seen - seen.mean()
            largest = _largest_mean_square(beat) if correlated else float((beat**2).mean())
            contrasts[ink, at] = largest / halftone
    return contrasts


def add_beat(modes: Modes, contrasts: NDArray[np.float64], residual_variance: ResidualVariance) -> None:
    """Add the beat's variance to ``modes.texture``, which is multiplied by ``residual_variance.contrast``.

    J^2 a (1 - a) of an ink is its gain's effect J a times a quarter of its dot gain's, 4 J a (1 - a): of solids and of
    their edges it is 0.
    """
    levels = np.array(LEVELS) / 255
    for ink, of_ink in enumerate(contrasts / residual_variance.contrast):
        if not modes.dot[:, ink].any():
            continue
        factor = np.interp(modes.cover[ink], levels, of_ink).astype(np.float32) / 4
        for index in range(modes.sensors):
            modes.texture[index] += factor * modes.gain[index, ink] * modes.dot[index, ink]


def _seen_by(
    edges: NDArray[np.float64], reach_mm: float, pitch_mm: float, device_mm: float
) -> NDArray[np.float64]:
    """Return the weights of device pixels in camera pixels, (PATCH_PIXELS, device pixels); each row sums to 1."""
    count = int(np.ceil((PATCH_PIXELS * pitch_mm + 2 * reach_mm) / device_mm)) + 1
    centres = reach_mm + (np.arange(PATCH_PIXELS) + 0.5) * pitch_mm
    borders = np.arange(count + 1) * device_mm
    places = np.linspace(-reach_mm, reach_mm, edges.size)
    return np.asarray(np.diff(np.interp(borders - centres[:, None], places, edges), axis=1))


def _largest_mean_square(seen: NDArray[np.float64]) -> float:
    """Return the mean square of boxes' sums a pixel, the greatest of all sizes and of pieces of lines and columns."""
    most = float((seen**2).mean())
    for side in BOXES:
        for high, wide in ((side, side), (side, 1), (1, side)):
            rows, columns = seen.shape[0] // high, seen.shape[1] // wide
            if min(rows, columns) < 2:
                continue
            cut = seen[: rows * high, : columns * wide].reshape(rows, high, columns, wide)
            most = max(most, float((cut.sum(axis=(1, 3)) ** 2).mean()) / (high * wide))
    return most
