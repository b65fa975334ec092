"""Compiled evaluation of tiles: from their sums to their displacements, with precision, and their content."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel

LEAST_GAIN = 0.4
"""Least contrast of a tile; one with less lacks ink, a plane or all, and its place cannot be determined."""
MOST_GAIN_SD = 0.15
"""Greatest standard deviation of the contrast of a tile that is used."""
MISFIT = 1.5
"""Ratio of residual to expected variance above which a tile has missing or additional ink, not only noise."""
LEAST_EXPLAINED = 0.7
"""Least share of such a tile's variance that the design must explain."""
STRUCTURE_PIXELS = 16.0
"""Greatest number of pixels with a common error (assumed: a letter's stem, 4 x 4)."""
FOREIGN = 0.5
"""Share of the design's contrast above which a tile is not simply empty."""
LEAST_NOISE = 0.05
GAIN_SD = 0.3
"""Prior standard deviation of a tile's contrast. [-]"""
UNKNOWN_PIXELS = 10.0
"""Standard deviation of a displacement in a direction without information."""
_TINY = 1e-12


@inner_kernel(error_model="numpy")
def inverse(xx, xy, yy):  # type: ignore[no-untyped-def]
    """Return the inverse of a symmetric 2 x 2 matrix, as its three numbers."""
    determinant = xx * yy - xy * xy
    return yy / determinant, -xy / determinant, xx / determinant


@inner_kernel(error_model="numpy")
def without_levels(s):  # type: ignore[no-untyped-def]
    """Eliminate level and gain from the sums of one tile and sensor.

    Returns the information on its displacement (xx, xy, yy), the gradient (x, y), level and gain at no
    displacement, and their derivatives by one, (level by x, by y, gain by x, by y).
    """
    l00, l01, l11 = inverse(s[0] + _TINY, s[1], s[4] + 1 / GAIN_SD**2)
    level_x, level_y = l00 * s[2] + l01 * s[5], l00 * s[3] + l01 * s[6]
    gain_x, gain_y = l01 * s[2] + l11 * s[5], l01 * s[3] + l11 * s[6]
    level, gain = l00 * s[10] + l01 * s[11], l01 * s[10] + l11 * s[11]
    xx = s[7] - s[2] * level_x - s[5] * gain_x
    xy = s[8] - s[2] * level_y - s[5] * gain_y
    yy = s[9] - s[3] * level_y - s[6] * gain_y
    x, y = s[12] - s[2] * level - s[5] * gain, s[13] - s[3] * level - s[6] * gain
    return xx, xy, yy, x, y, level, gain, level_x, level_y, gain_x, gain_y


@kernel(
    "gathered (_, N, 16), beyond (N, 2), step_sd, moves (N, 2), precision (N, 2, 2), "
    "flags (N, 3), measures (N, 3)",
    error_model="numpy",
)
def solve_tiles(gathered, beyond, step_sd, moves, precision, flags, measures):  # type: ignore[no-untyped-def]
    """Solve sums of ``weighted_sums`` (sensors, n, 16) for moves (n, 2), precision (n, 2, 2), as in ``TileMoves``.

    Level and gain are each sensor's own and are eliminated. beyond (n, 2): ``Landmarks.beyond``; step_sd:
    standard deviation of the error of a linear step [pixels]. flags (n, 3): seen, good, foreign. measures (n, 3):
    gain, its standard deviation, noise.
    """
    unknown = 1 / UNKNOWN_PIXELS**2
    for n in range(gathered.shape[1]):
        xx, xy, yy, push_x, push_y = 0.0, 0.0, 0.0, 0.0, 0.0
        left, variance, contrast, retained, pixels = 0.0, 0.0, 0.0, 0.0, 0.0
        for sensor in range(gathered.shape[0]):
            s = gathered[sensor, n].astype(np.float64)
            own = without_levels(s)
            xx, xy, yy = xx + own[0], xy + own[1], yy + own[2]
            push_x, push_y = push_x + own[3], push_y + own[4]
            c00, c01, c11 = inverse(own[0] + unknown, own[1], own[2] + unknown)
            x, y = c00 * own[3] + c01 * own[4], c01 * own[3] + c11 * own[4]
            level, gain = own[5] - own[7] * x - own[8] * y, own[6] - own[9] * x - own[10] * y
            left += s[14] - s[10] * level - s[11] * gain - s[12] * x - s[13] * y
            light = s[10] + s[1]
            variance += s[14] + 2 * s[11] + s[4] - light * light / max(s[0], _TINY)
            contrast += s[4]
            retained += s[4] * (1 + gain)
            pixels += s[15]
        gain = retained / max(contrast, _TINY)
        noise = max(left / max(pixels, 1.0), LEAST_NOISE)
        gain_sd = np.sqrt(noise / max(contrast, _TINY))
        explained = 1 - left / max(variance, _TINY)
        misfit = noise > MISFIT
        seen = pixels > 0
        good = seen and LEAST_GAIN < gain < 1 / LEAST_GAIN and gain_sd < MOST_GAIN_SD
        good = good and (not misfit or explained > LEAST_EXPLAINED)
        c00, c01, c11 = inverse(xx + unknown, xy, yy + unknown)
        moves[n, 0] = (c00 * push_x + c01 * push_y) / max(gain, LEAST_GAIN)
        moves[n, 1] = (c01 * push_x + c11 * push_y) / max(gain, LEAST_GAIN)
        precision[n] = 0
        if good:
            # Residuals beyond the noise have structure, so that errors of pixels are not independent.
            information = min(gain, 1.0) ** 2 / (noise * min(max(noise, 1.0), STRUCTURE_PIXELS))
            c00, c01, c11 = inverse(xx * information + unknown, xy * information, yy * information + unknown)
            # Ink missing from a tile removes edges, which looks like a displacement: a pixel if all is missing.
            least = step_sd**2 + ((1 - explained) ** 2 if misfit else 0.0)
            c00, c01, c11 = inverse(c00 + least + beyond[n, 0], c01, c11 + least + beyond[n, 1])
            precision[n, 0, 0], precision[n, 1, 1] = c00, c11
            precision[n, 0, 1] = precision[n, 1, 0] = c01
        flags[n, 0], flags[n, 1] = seen, good
        flags[n, 2] = seen and not good and variance > FOREIGN * contrast and gain_sd < MOST_GAIN_SD
        measures[n, 0], measures[n, 1], measures[n, 2] = gain, gain_sd, noise
