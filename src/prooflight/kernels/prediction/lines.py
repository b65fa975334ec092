"""Compiled loops of prediction: look up, filter and area-sample a page line by line, in constant memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.aiming import aim, aim_each, place_row, whole_eights
from prooflight.kernels.prediction.filtering import (
    copy_row,
    deal_row,
    dealt_count,
    filter_across,
    filter_along,
    filter_row,
)
from prooflight.kernels.prediction.lookup import AT_ONCE, lookup_light

if TYPE_CHECKING:
    from numpy.typing import NDArray

COMPARED = 256


class ColumnLevels(NamedTuple):
    """Parameters of one sensor's columns, by which light becomes digital numbers."""

    column_offset: NDArray[np.float32]
    """Offset of each column, (pixels,). [DN]"""
    column_gain: NDArray[np.float32]
    backing: np.float32
    """Light of the backing. [DN]"""
    backing_variance: np.float32
    dark_variance: np.float32
    """Variance without light. [DN^2]"""
    shot_slope: np.float32
    """Ratio of variance to light; 0 if variance is looked up, above the backing's. [DN]"""
    top_code: np.float32


@inner_kernel()
def same_row(one, other):  # type: ignore[no-untyped-def]
    """Return whether two rows (n,) are equal; compared in pieces, because most that differ do so early."""
    for start in range(0, one.size, COMPARED):
        a, b = one[start : start + COMPARED], other[start : start + COMPARED]
        differs = np.uint32(0)
        for i in range(a.size):  # from 0 on, so that the compiler knows that no index is negative
            differs |= a[i] ^ b[i]
        if differs:
            return False
    return True


@inner_kernel()
def lookup_dealt(dealt, columns, place, table, backing, split):  # type: ignore[no-untyped-def]
    """Run ``lookup_light`` on a row dealt by ``deal_row``; pixels off the page stay 0."""
    stride = dealt.shape[0]
    for phase in range(stride):
        count = dealt_count(columns, stride, phase)
        if count:
            end = place + (count + AT_ONCE - 1) // AT_ONCE * AT_ONCE
            lookup_light(dealt[phase, place:end], table, backing, split[phase, place:end])
            split[phase, place + count : end] = 0


@inner_kernel()
def lookup_packed(packed, quantised, backing, few, light):  # type: ignore[no-untyped-def]
    """Run ``lookup_light`` on a packed row (columns,) of any length; few (2, 8): working space; light (columns,)."""
    whole = packed.size // AT_ONCE * AT_ONCE
    if whole:
        lookup_light(packed[:whole], quantised, backing, light[:whole])
    if whole < packed.size:
        last, seen = few[0], few[1].view(np.float32)
        for i in range(packed.size - whole):
            last[i] = packed[whole + i]
        lookup_light(last, quantised, backing, seen)
        for i in range(packed.size - whole):
            light[whole + i] = seen[i]


@inner_kernel()
def sign_row(row, sign):  # type: ignore[no-untyped-def]
    """Clip a row at 0 and multiply it by a sign; a sign of 0 leaves it unchanged."""
    if sign != 0:
        for i in range(row.size):
            row[i] = sign * max(row[i], np.float32(0))


@kernel(
    "packed (_, _), tables[].codes (N, 65536, 16), tables[].bits (N, 4), backings (N), stride, "
    "across.places (I, J), across.segment, across.cumulative (_), along.places (K, M), along.pitch, "
    "along.cumulative (_), sign, line_from, line_to, lights[] (N, L, P)",
    where=(
        "0 < I, 0 < M, 0 <= line_from, line_to <= L, (J - 1) * across.segment >= P, "
        "(K - 1) * along.pitch >= line_to"
    ),
)
def filter_lines(  # type: ignore[no-untyped-def]
    packed, tables, backings, stride, across, along, sign, line_from, line_to, lights
):
    """Filter lines line_from .. line_to - 1 in tables of a page that is only shifted, above the backing's level.

    packed (rows, columns) uint32; tables: a tuple of n ``QuantisedTable``; backings (n,); lights: a tuple of
    n images (lines, pixels) float32, written at those lines only: bands may run in several threads. stride:
    raster pixels from one camera pixel to the next, 0 if not a whole number of them; across, along:
    ``FilterPass``, of which the first row and the first column of nodes are used; sign: as in ``sign_row``.
    Rows pass once through a ring of as many filtered rows as there are taps, and are dealt out and compared
    with the row above once for all tables. ``correct_light`` comes next.
    """
    rows, columns = packed.shape
    pixels = lights[0].shape[1]
    taps = int(np.ceil((across.cumulative.size - 1) / across.step)) + 1
    even = stride > 0
    begin = taps // max(stride, 1) + 2
    pad = begin * stride
    width = (columns + 2 * pad) // max(stride, 1) + AT_ONCE
    dealt = np.zeros((stride, width), np.uint32)
    split = np.zeros((stride, width), np.float32)
    wide = whole_eights(taps)
    source = np.zeros(columns + 3 * wide, np.float32)
    few = np.zeros((2, AT_ONCE), np.uint32)
    firsts, weights_at = np.empty(pixels, np.int32), np.empty(pixels, np.int32)
    ring = np.empty((len(tables), taps, pixels), np.float32)
    x_weights, y_weights = np.empty(taps, np.float32), np.empty(taps, np.float32)
    x_first = aim(across.places[0, 0], across.cumulative, across.step, x_weights)
    if not even:
        x_weights = aim_each(across, wide, columns, firsts, weights_at)
    y_place = np.empty(1)
    starts = np.empty(taps, np.int64)
    next_row = -1
    last_row = -2
    for line in range(line_from, line_to):
        place_row(along.places, along.pitch, line, y_place)
        y_first = aim(y_place[0], along.cumulative, along.step, y_weights)
        if next_row < 0:
            next_row = max(y_first, 0)
        while next_row < min(y_first + taps, rows):
            slot, row = next_row % taps, packed[next_row]
            alike = next_row - 1 == last_row and same_row(row, packed[last_row])
            if even and not alike:
                deal_row(row, begin, dealt)
            for n in range(len(tables)):
                if alike:
                    copy_row(ring[n, (next_row - 1) % taps], ring[n, slot])
                elif even:
                    lookup_dealt(dealt, columns, begin, tables[n], backings[n], split)
                    filter_across(split, pad, columns, x_first, x_weights, starts, ring[n, slot])
                else:
                    lookup_packed(row, tables[n], backings[n], few, source[wide : wide + columns])
                    filter_row(source, firsts, x_weights, weights_at, wide, ring[n, slot])
            last_row = next_row
            next_row += 1
        for n in range(len(tables)):
            filter_along(ring[n], rows, y_first, y_weights, starts, lights[n][line])
            sign_row(lights[n][line], sign)


@inner_kernel()
def level_row(sensor, mean, variance):  # type: ignore[no-untyped-def]
    """Run ``to_columns`` on one line (pixels,), in place."""
    column_offset, column_gain, shot_slope = sensor.column_offset, sensor.column_gain, sensor.shot_slope
    backing, dark_variance, top_code = sensor.backing, sensor.dark_variance, sensor.top_code
    above_dark = sensor.backing_variance - dark_variance
    if shot_slope > 0:
        for i in range(mean.size):
            variance[i] = shot_slope * mean[i]
    for i in range(mean.size):
        variance[i] = dark_variance + max(column_gain[i] * (variance[i] + above_dark), np.float32(0))
        level = column_offset[i] + column_gain[i] * (mean[i] + backing)
        mean[i] = min(max(level, np.float32(0)), top_code)


@kernel(
    "sensor.column_offset (P), sensor.column_gain (P), line_from, line_to, mean (L, P), variance (L, P)",
    where="0 <= line_from, line_to <= L",
)
def to_columns(sensor, line_from, line_to, mean, variance):  # type: ignore[no-untyped-def]
    """Convert light above the backing's to expected DN and variance, in place, in lines line_from .. line_to - 1.

    sensor: ``ColumnLevels``; mean, variance (lines, pixels).
    """
    for line in range(line_from, line_to):
        level_row(sensor, mean[line], variance[line])


@kernel(
    "column_offset (P), gain_ratio (P), dark_variance, top_code, mean (L, P), variance (L, P), "
    "mean_out (L, P), variance_out (L, P)"
)
def relight(column_offset, gain_ratio, dark_variance, top_code, mean, variance, mean_out, variance_out):  # type: ignore[no-untyped-def]
    """Rescale expected DN and variance (lines, pixels) to columns' gains of ``gain_ratio`` times theirs.

    Returns whether every mean was below the top code; the light of one that was not is unknown.
    """
    highest = np.float32(0)
    for line in range(mean.shape[0]):
        means, variances, to_mean, to_variance = (
            mean[line],
            variance[line],
            mean_out[line],
            variance_out[line],
        )
        for i in range(means.size):
            highest = max(highest, means[i])
            level = column_offset[i] + gain_ratio[i] * (means[i] - column_offset[i])
            to_mean[i] = min(max(level, np.float32(0)), top_code)
        for i in range(variances.size):
            to_variance[i] = dark_variance + gain_ratio[i] * (variances[i] - dark_variance)
    return highest < top_code
