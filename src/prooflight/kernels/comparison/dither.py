"""Compiled loops that undo a converter's rounding: draws of the unrounded signal, given its digital number."""

from __future__ import annotations

import math

import numpy as np

from prooflight.kernels.comparison.int16_simd import add, high, left, right, right_unsigned, sub
from prooflight.kernels.compiled import inner_kernel

ROUNDING_VARIANCE_DN2 = 1 / 12
"""Variance of a digital number's rounding; no pixel has less. [DN^2]"""
TILE = 64
"""Side of a tile. [pixel]"""
CODE_STEPS = 64
"""Steps of the histograms per sigma."""
LOWEST_CODE = np.int8(-128)
"""Least code: histograms are cut off at 2 sigma, and all their edges are above this."""
HALVES = 22
"""Correction of the bias of rounding down in ``dither_row``, the mean over pixels, measured. [sigma /
32768]"""


@inner_kernel()
def dither_row(z, inverse, inverse_drop, noise, codes):  # type: ignore[no-untyped-def]
    """Draw z before the converter's rounding, given the rounded value, in steps of sigma / 64, cut off at 2: int8.

    z as from ``normalise_row``; noise uint16: 2^16 times a number w + 1/2 uniform in [0, 1), one a pixel;
    inverse_drop: inverse_bits - 14. With r = 1 / sigma [1/DN], sigma with rounding's 1/12 DN^2 in it, the
    distribution of the signal within one digital number is that of

      z + r w + r^2 z (w^2/2 - 1/12) + r^3 (w^3/6 + z^2 (w^3/3 - w/12))
      + r^4 (z^3 (w^4/4 - w^2/12 + 1/192) + z (7 w^4/24 - w^2/24 - 1/192)),

    the series in r of Phi^-1 of a number uniform between Phi at that digital number's two ends. Numbers after
    the code lines are bits after the binary point.
    """
    one = np.int16(np.int16(right_unsigned(inverse_drop, 15)) + np.int16(1))  # counts unknown to the compiler
    two, three, five = np.int16(one + 1), np.int16(one + 2), np.int16(one + 4)
    for i in range(z.size):
        w = np.int16(noise[i] ^ np.uint16(0x8000))  # 16
        r = left(min(np.int16(right_unsigned(inverse[i], inverse_drop)), np.int16(16383)), 1)  # 15
        near = min(max(z[i], np.int16(-4095)), np.int16(4095))  # 10
        rw = high(w, r)  # 15
        rr = high(r, ~r)  # -r^2, 14
        ww = high(w, ~w)  # -w^2, 16
        wwww = high(ww, ~ww)  # -w^4, 16
        sixth = add(high(ww, 10923), 2731)  # 1/24 - w^2/6, 16
        zz = high(left(near, 3), ~left(near, 3))  # -z^2, 10
        rrz = high(left(near, 3), rr)  # -r^2 z, 11
        second = high(rrz, left(add(ww, 10923), one))  # 13
        tilt = sub(
            right(sixth, 2), add(left(high(zz, left(sixth, three)), two), 683)
        )  # -(..) of r^3 w (..), 14
        third = high(rr, left(high(rw, tilt), two))  # 13
        cubic = sub(right(add(wwww, 4096), 2), right(sixth, 1))  # -(..) of r^4 z^3 (..), 16
        linear = sub(sub(right(sixth, 2), high(wwww, 19115)), 1024)  # (..) of r^4 z (..), 16
        both = add(high(zz, left(cubic, five)), right(linear, 1))  # 15
        fourth = high(rr, left(high(rrz, left(both, three)), two))  # 13
        y = add(left(near, 2), right(add(rw, HALVES), 3))  # 12
        y = add(y, right(add(add(second, third), fourth), 1))
        codes[i] = np.int8(min(max(right(y, 6), np.int16(-128)), np.int16(127)))


@inner_kernel()
def dither_soft_row(z, inverse, inverse_drop, noise, codes):  # type: ignore[no-untyped-def]
    """Draw the same to order r^2, which is enough where sigma is 4 DN or more."""
    one = np.int16(np.int16(right_unsigned(inverse_drop, 15)) + np.int16(1))
    for i in range(z.size):
        w = np.int16(noise[i] ^ np.uint16(0x8000))
        r = left(min(np.int16(right_unsigned(inverse[i], inverse_drop)), np.int16(16383)), 1)
        near = min(max(z[i], np.int16(-4095)), np.int16(4095))
        second = high(high(left(near, 3), high(r, ~r)), left(add(high(w, ~w), 10923), one))
        y = add(add(left(near, 2), right(add(high(w, r), HALVES), 3)), right(add(second, 1), 1))
        codes[i] = np.int8(min(max(right(y, 6), np.int16(-128)), np.int16(127)))


@inner_kernel()
def plain_row(z, codes):  # type: ignore[no-untyped-def]
    """Encode z itself in steps of sigma / 64, cut off at 2, as if digital numbers were not integers: int8."""
    for i in range(z.size):
        codes[i] = np.int8(min(max(right(z[i], 4), np.int16(-128)), np.int16(127)))


@inner_kernel()
def settle_row(measured, mean, inverse, camera, noise, edges, reach, codes):  # type: ignore[no-untyped-def]
    """Compute the codes of pixels for which the series of ``dither_row`` is not valid, one by one.

    These are pixels at either end of the converter's range and those with an inverse above camera.unsure.
    reach: the probability below each edge.
    """
    for start in range(0, codes.size, TILE):
        end = min(start + TILE, codes.size)
        farthest, surest = np.uint16(0), np.uint16(0)
        for i in range(start, end):
            farthest = max(farthest, np.uint16(measured[i] - np.uint16(1)))
            surest = max(surest, inverse[i])
        if farthest < np.uint16(camera.top_code - np.uint16(1)) and surest <= camera.unsure:
            continue
        for i in range(start, end):
            bottom, top = measured[i] == 0, measured[i] >= camera.top_code
            if bottom or top or inverse[i] > camera.unsure:
                sigma = (1 << camera.inverse_bits) / (inverse[i] + 0.5)
                sharpness = 1 / math.sqrt(2 * max(sigma * sigma - ROUNDING_VARIANCE_DN2, 1e-6))
                error = measured[i] - mean[i] / (1 << camera.mean_bits)
                low = 0.0 if bottom else 0.5 * math.erfc((0.5 - error) * sharpness)
                up = 1.0 if top else 0.5 * math.erfc((-0.5 - error) * sharpness)
                u = low + (up - low) * ((noise[i] + 0.5) / 65536)
                interval = 0
                for j in range(reach.size):
                    interval += u >= reach[j]
                codes[i] = edges[interval - 1] if interval else LOWEST_CODE
