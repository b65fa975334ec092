"""Prediction in 16-bit integers, as the compiled comparison reads it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from prooflight.kernels.comparison.one_pass import ROUNDING_VARIANCE_DN2
from prooflight.kernels.compiled import inner_kernel, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST = 65535
MOST_BITS = 25
"""Greatest number of bits of mean and inverse together: their product, shifted by 16, must still hold z to a
1024th."""
ALONG_X = np.float32(0.7548776662466927)
ALONG_Y = np.float32(0.5698402909980532)
"""Two powers of 1 / 1.3247..., whose multiples fill the unit interval most evenly in both directions (Roberts
2018, "The unreasonable effectiveness of quasirandom sequences", R2)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """Fixed-point scales of one sensor's prediction."""

    mean_bits: int
    """Bits of the mean below 1 DN: 4 for a 12-bit camera, 0 for 16 bits."""
    inverse_bits: int
    """Exponent of the scale 2^inverse_bits of the stored 1/sigma. [DN]"""
    top_code_dn: int

    @classmethod
    def of(cls, *, top_code_dn: int, least_variance_dn2: float) -> Scale:
        """Return the finest scales at which no mean up to the top code and no sigma down to the least overflows."""
        least_sigma = math.sqrt(max(least_variance_dn2, ROUNDING_VARIANCE_DN2))
        mean_bits = 16 - int(top_code_dn).bit_length()
        return cls(
            mean_bits=mean_bits,
            inverse_bits=min(math.floor(math.log2((MOST - 1) * least_sigma)), MOST_BITS - mean_bits),
            top_code_dn=int(top_code_dn),
        )


class Lines(NamedTuple):
    """An image by its memory layout, so that compiled loops read parts of a scan without a copy."""

    values: NDArray[Any]
    """Pixels from the first to the last, (n,)."""
    step: int
    """Distance between the starts of consecutive lines."""

    @classmethod
    def of(cls, image: NDArray[Any]) -> Self:
        """Return the layout of (lines, pixels), not empty; copied only if the pixels of a line are not adjacent."""
        each = image.itemsize
        if image.strides[1] != each or image.strides[0] % each or image.strides[0] < 0:
            image = np.ascontiguousarray(image)
        step = image.strides[0] // each
        size = (image.shape[0] - 1) * step + image.shape[1]
        return cls(values=np.lib.stride_tricks.as_strided(image, (size,), (each,)), step=step)


@inner_kernel(error_model="numpy")
def compact_row(mean, variance, line, mean_bits, inverse_bits, mean_out, inverse_out):  # type: ignore[no-untyped-def]
    """Encode one line of one sensor: mean [DN], variance [DN^2] (pixels,) float32 -> codes (pixels,) uint16.

    line: of the page, 0 at its top; the pattern of rounding depends on it and on the pixel alone. All arrays
    are (pixels,) and contiguous. ``compact`` defines the codes.
    """
    scale = np.float32(1 << mean_bits)
    of_rounding = np.float32(1) / (scale * scale)
    one = np.float32(1 << inverse_bits)
    down_x = np.float32((line * 0.5698402909980532) % 1.0)
    down_y = np.float32((line * 0.7548776662466927) % 1.0)
    for i in range(mean.size):
        x = np.float32(np.int32(i & 4095))
        u = x * ALONG_X + down_x
        v = x * ALONG_Y + down_y
        u -= np.float32(np.int32(u))
        v -= np.float32(np.int32(v))
        scaled = mean[i] * scale
        low = np.float32(np.int32(scaled))
        f = scaled - low
        sure = one / np.sqrt(variance[i] + f * (np.float32(1) - f) * of_rounding)
        mean_out[i] = np.uint16(np.int32(scaled + u))
        inverse_out[i] = np.uint16(np.int32(min(sure + v, np.float32(65535))))


@kernel(
    "mean.values (_), variance.values (_), first_line, mean_bits, inverse_bits, mean_out (L, P), "
    "inverse_out (L, P)"
)
def compact_lines(mean, variance, first_line, mean_bits, inverse_bits, mean_out, inverse_out):  # type: ignore[no-untyped-def]
    """Run ``compact_row`` on each line of a band, ``Lines`` -> (lines, pixels); its first is first_line of the page."""
    pixels = mean_out.shape[1]
    for line in range(mean_out.shape[0]):
        compact_row(
            mean.values[line * mean.step : line * mean.step + pixels],
            variance.values[line * variance.step : line * variance.step + pixels],
            first_line + line,
            mean_bits,
            inverse_bits,
            mean_out[line],
            inverse_out[line],
        )


def compact(
    expected_dn: NDArray[np.float32],
    variance_dn2: NDArray[np.float32],
    scale: Scale,
    *,
    first_line: int = 0,
) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """Encode some lines of one sensor's prediction as integers; return mean and inverse, (lines, pixels) each.

    expected_dn, variance_dn2: (lines, pixels), the former between 0 and the top code [DN, DN^2]; first_line:
    of the page, 0 at its top.

    Both codes are rounded up or down by an even pattern over the page, so that rounding is unbiased
    everywhere: mean = floor(2^mean_bits expected + u), inverse = floor(2^inverse_bits / sigma + v), at most
    65535, with u and v in [0, 1). A mean is less than 2^-mean_bits DN off and an inverse less than 1, in both
    directions; over 8 x 8 equal pixels the mean of the means is less than a fourth of that off. sigma^2 is
    the prediction's variance plus the variance that this rounding of the mean adds to a pixel, f (1 - f) /
    4^mean_bits, with f the fraction rounded away.
    """
    mean, inverse = np.empty((2, *expected_dn.shape), np.uint16)
    expected, variance = Lines.of(expected_dn), Lines.of(variance_dn2)
    compact_lines(expected, variance, first_line, scale.mean_bits, scale.inverse_bits, mean, inverse)
    return mean, inverse
