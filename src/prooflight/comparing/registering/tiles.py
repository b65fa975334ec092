"""Tiles measured: by how much each lies off where it is thought to lie, and what that is worth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.comparing.registering.kernels import SUMS, measure_tiles
from prooflight.comparing.registering.landmarks import GRADIENT_NOISE, SIGNAL_NOISE, TILE_PIXELS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.comparing.registering.landmarks import Landmarks

LEAST_GAIN: Final = 0.4
"""A tile with less of its contrast is missing ink, a plane or all; where it lies cannot be told."""
MOST_GAIN_SD: Final = 0.15
"""A tile whose contrast is less surely the design's than this is not counted."""
HALFTONE: Final = 0.07
"""Contrast of halftones as the camera sees them (worlds.toml: 0.03 at 0.254 mm, here 0.105 mm)."""
MISFIT: Final = 1.5
"""Of the variance expected, from which a tile's rest is more than noise: some of its ink is missing, or too much."""
LEAST_EXPLAINED: Final = 0.7
"""Share of such a tile's variance that the design must explain all the same."""
STRUCTURE_PIXELS: Final = 16.0
"""Pixels that err together at most (assumed: a letter's stem, 4 x 4)."""
FOREIGN: Final = 0.5
"""Share of the design's contrast that a tile shows which is not simply empty."""
LEAST_NOISE: Final = 0.05
GAIN_SD: Final = 0.3
"""Of a tile's contrast before it is measured. [-]"""
UNKNOWN_PIXELS: Final = 10.0
STEP_SHARE: Final = 0.25
"""What one linear step leaves of a displacement, near enough, so that no tile is lost for it."""
TILE_SD_PIXELS: Final = 0.03
"""Of a tile's displacement beyond its noise: what the page does within a tile, planes off register (assumed)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TileMoves:
    """What n tiles of all sensors together say."""

    moves: NDArray[np.float64]
    """(n, 2) by how much each lies too far right and down of where it was rendered. [pixels]"""
    precision: NDArray[np.float64]
    """(n, 2, 2) inverse covariance; zero where a tile tells nothing. [1/pixel^2]"""
    seen: NDArray[np.bool_]
    """(n,) inside the scan."""
    good: NDArray[np.bool_]
    """(n,) seen, and looking like the design."""
    foreign: NDArray[np.bool_]
    """(n,) seen, not looking like the design, and not empty either."""
    gain: NDArray[np.float64]
    """(n,) contrast, 1 for the design's."""
    noise: NDArray[np.float64]
    """(n,) variance that is left over what was expected; at least ``LEAST_NOISE``."""


def measured(
    landmarks: Landmarks,
    scan: NDArray[np.uint16],
    tiles: NDArray[np.int64],
    moves: NDArray[np.float64],
    *,
    unsure_pixels: float,
) -> TileMoves:
    """Measure ``tiles`` (n,) of a scan, rendered where ``moves`` (n, 2) says the page lies off its place [pixels].

    unsure_pixels: standard deviation of these; edges weigh less by it.
    """
    gathered = [np.zeros((tiles.size, SUMS + 1), np.float32) for _ in landmarks.sensors]
    for index, (sensor, taps) in enumerate(zip(landmarks.sensors, landmarks.taps, strict=True)):
        dark = sensor.dark_variance_dn2
        per_dn = (float(sensor.variance_dn2[0, 0, 0, 0]) - dark) / sensor.white_dn
        edges = GRADIENT_NOISE + unsure_pixels**2
        measure_tiles(
            scan[index],
            sensor.column_offset_dn,
            1 / sensor.column_gain,
            landmarks.windows[index],
            landmarks.origins[:, 0],
            landmarks.origins[:, 1],
            *landmarks.ratio,
            taps.across,
            taps.across_slope,
            taps.along,
            taps.along_slope,
            landmarks.lines,
            landmarks.columns,
            tiles,
            moves,
            TILE_PIXELS,
            np.array(
                [
                    2 * dark + 1,
                    2 * per_dn + HALFTONE**2 * sensor.white_dn,
                    SIGNAL_NOISE**2 - HALFTONE**2,
                    edges,
                ],
                np.float32,
            ),
            gathered[index],
        )
    return _judged([sums.astype(np.float64) for sums in gathered], STEP_SHARE * unsure_pixels)


def _judged(gathered: list[NDArray[np.float64]], step_sd: float) -> TileMoves:
    """Sums of ``weigh`` (sensors) (n, SUMS + 1) -> moves; level and gain are each sensor's own and drop out."""
    n = gathered[0].shape[0]
    rows, columns = np.triu_indices(4)
    information, push = np.zeros((n, 2, 2)), np.zeros((n, 2))
    left, variance, pixels, contrast, kept = (np.zeros(n) for _ in range(5))
    for sums in gathered:
        normal = np.zeros((n, 4, 4))
        normal[:, rows, columns] = normal[:, columns, rows] = sums[:, :10]
        asked = sums[:, 10:14]
        nuisance = normal[:, :2, :2].copy()
        nuisance[:, 0, 0] += 1e-12
        nuisance[:, 1, 1] += 1 / GAIN_SD**2
        carried = np.linalg.solve(nuisance, normal[:, :2, 2:])
        known = np.linalg.solve(nuisance, asked[:, :2, None])[..., 0]
        information += normal[:, 2:, 2:] - np.einsum("nij,nik->njk", normal[:, :2, 2:], carried)
        own_push = asked[:, 2:] - np.einsum("nij,ni->nj", normal[:, :2, 2:], known)
        push += own_push
        own = information_inverse(normal[:, 2:, 2:] - np.einsum("nij,nik->njk", normal[:, :2, 2:], carried))
        step = np.einsum("nij,nj->ni", own, own_push)
        levels = known - np.einsum("nij,nj->ni", carried, step)
        left += sums[:, 14] - (asked[:, :2] * levels).sum(1) - (asked[:, 2:] * step).sum(1)
        light = asked[:, 0] + sums[:, 1]
        variance += sums[:, 14] + 2 * asked[:, 1] + sums[:, 4] - light**2 / np.maximum(sums[:, 0], 1e-12)
        contrast += sums[:, 4]
        kept += sums[:, 4] * (1 + levels[:, 1])
        pixels += sums[:, 15]
    seen = pixels > 0
    gain = kept / np.maximum(contrast, 1e-12)
    noise = np.maximum(left / np.maximum(pixels, 1), LEAST_NOISE)
    moves = (
        np.einsum("nij,nj->ni", information_inverse(information), push)
        / np.maximum(gain, LEAST_GAIN)[:, None]
    )
    gain_sd = np.sqrt(noise / np.maximum(contrast, 1e-12))
    explained = 1 - left / np.maximum(variance, 1e-12)
    good = seen & (gain > LEAST_GAIN) & (gain < 1 / LEAST_GAIN) & (gain_sd < MOST_GAIN_SD)
    misfit = noise > MISFIT
    good &= ~misfit | (explained > LEAST_EXPLAINED)
    # What is left beyond the noise has structure, so that pixels do not err by themselves.
    noise = noise * np.clip(noise, 1, STRUCTURE_PIXELS)
    covariance = information_inverse(information * (np.minimum(gain, 1) ** 2 / noise)[:, None, None])
    # Ink that is missing from a tile takes edges along that only seem to move: by a pixel, were all of it missing.
    least = TILE_SD_PIXELS**2 + step_sd**2 + np.where(misfit, 1 - explained, 0) ** 2
    precision = np.asarray(np.linalg.inv(covariance + least[:, None, None] * np.eye(2)), np.float64)
    precision[~good] = 0
    foreign = seen & ~good & (variance > FOREIGN * contrast) & (gain_sd < MOST_GAIN_SD)
    return TileMoves(
        moves=moves, precision=precision, seen=seen, good=good, foreign=foreign, gain=gain, noise=noise
    )


def information_inverse(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariances (n, 2, 2); where a direction tells nothing its standard deviation is ``UNKNOWN_PIXELS``."""
    return np.asarray(np.linalg.inv(information + np.eye(2) / UNKNOWN_PIXELS**2), np.float64)
