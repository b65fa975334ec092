"""Compiled loops of prediction at any placement: every camera pixel has its own position on the raster.

Weights are tabulated at so many phases of a raster pixel that the nearest is accurate enough, and are stored
in the order of their raster pixels: a camera pixel is one product of two short vectors, independent of its
neighbours.
"""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.aiming import (
    begin_row,
    derivatives,
    place_row,
    weights_at_phases,
    whole_eights,
)
from prooflight.kernels.prediction.filtering import copy_row, filter_row
from prooflight.kernels.prediction.summing import GROUP, sum_tilted

BEYOND = 1
"""Rows before and after those that the middle of a group sees that its other columns may see."""
AT_ONCE = 16
"""Groups of which it is asked at once whether anything has changed."""
LINEAR_FOOTPRINTS = 0.008
"""Greatest displacement within a group, in footprints, at which weights change linearly: they are then off
by less than the nearest phase's."""


@inner_kernel(error_model="numpy")
def begin_groups(places, reach, bits, taps, beyond, most_tilt, first, weights_at, rests, tilts):  # type: ignore[no-untyped-def]
    """Compute where the middle of each group of raster columns sees the first row, and its weights.

    places (groups + 1,): of columns 0, GROUP, 2 GROUP, ..., linear between. reach, bits, taps, beyond, first,
    weights_at: as in ``begin_row``, (groups,). Written too: rests (groups,), phases by which a group lies beyond the
    nearest; tilts (groups,), phases by which a column sees another place than its neighbour. Return whether one is
    more than ``most_tilt``.
    """
    count, none, last, wide = float(1 << bits), np.int32(0), np.int32(beyond + taps), np.int32(taps)
    is_steep = none
    for group in range(first.size):
        step = (places[group + 1] - places[group]) / GROUP
        here = min(max(places[group] - reach + step * ((GROUP - 1) / 2), -1e6), 1e6)
        whole = np.floor(here)
        phases = (here - whole) * count
        phase = np.floor(phases + 0.5)
        first[group] = min(max(np.int32(np.int32(whole) + wide), none), last)
        weights_at[group] = np.int32(np.int32(phase) * wide)
        rests[group] = phases - phase
        tilts[group] = step * count
        is_steep |= np.int32(abs(step * count) > most_tilt)
    return is_steep != none


@inner_kernel()
def is_same(same_from, copied_from, first, begin, back):  # type: ignore[no-untyped-def]
    """Return whether out has what each of AT_ONCE groups sees, which is the same in all rows; see ``sum_groups``."""
    differs = np.int32(0)
    for group in range(begin, begin + AT_ONCE):
        differs |= np.int32(same_from[group] > first[group] + back) | (copied_from[group] ^ same_from[group])
    return differs == 0


@inner_kernel()
def sum_groups(  # type: ignore[no-untyped-def]
    values,
    starts,
    offset,
    same_from,
    copied_from,
    table,
    slopes,
    taps,
    bits,
    most_tilt,
    is_steep,
    first,
    weights_at,
    rests,
    tilts,
    out,
):
    """Sum up the rows that one line sees, by groups of raster columns: out (groups x GROUP,).

    values, starts: as in ``filter_moved_lines``; offset: of rows in starts; same_from (groups,): rows of starts from
    which a group stays the same; copied_from (groups,): the row of starts whose values out has, -1 if it has sums;
    table, slopes: weights at phases, and their derivatives; is_steep: whether columns of a group may see further than
    BEYOND; the others as from ``begin_groups``. Within a group weights change linearly, unless the tilt is more than
    ``most_tilt``.
    """
    groups, back, begins = starts.shape[1], np.int32(offset - BEYOND), starts.reshape(-1)
    for begin in range(0, groups, AT_ONCE):
        end = min(begin + AT_ONCE, groups)
        is_whole = begin + AT_ONCE <= groups
        if is_whole and not is_steep and is_same(same_from, copied_from, first, begin, back):
            continue
        for group in range(begin, end):
            row, at, tilt = first[group] + offset, GROUP * group, tilts[group]
            if same_from[group] <= row - BEYOND and not is_steep:
                if copied_from[group] != same_from[group]:
                    copied_from[group] = same_from[group]
                    source = starts[row, group]
                    copy_row(values[source : source + GROUP], out[at : at + GROUP])
                continue
            copied_from[group] = -1
            weight = weights_at[group]
            if abs(tilt) <= most_tilt:
                place = row * groups + group
                sum_tilted(
                    values, begins, place, groups, table, slopes, weight, taps, rests[group], tilt, out, at
                )
            else:
                sum_columns(values, starts[:, group], row, table, weight // taps, taps, bits, tilt, out, at)


@inner_kernel(error_model="numpy")
def sum_columns(values, begins, row, table, phase, taps, bits, tilt, out, at):  # type: ignore[no-untyped-def]
    """Sum up the rows of one group column by column; row, phase: where its middle sees them."""
    for i in range(GROUP):
        place = phase + int(np.rint(tilt * np.float32(i - (GROUP - 1) / 2)))
        start = min(max(row + (place >> bits), 0), begins.size - taps)
        weight = (place & ((1 << bits) - 1)) * taps
        total = np.float32(0)
        for t in range(taps):
            total += table[weight + t] * values[begins[start + t] + i]
        out[at + i] = total


@inner_kernel()
def mark_changes(starts, first, last, same_from):  # type: ignore[no-untyped-def]
    """Set same_from (groups,) to each row of first .. last - 1 that differs from the one above in a group."""
    for row in range(first, last):
        above, here = starts[row - 1], starts[row]
        for group in range(same_from.size):
            same_from[group] = row if here[group] != above[group] else same_from[group]


@kernel(
    "values (_), starts (S, (columns + GROUP - 1) // GROUP), beyond, columns, across.places (I, J), across.pitch, "
    "across.segment, across.cumulative (_), along.places (K, M), along.pitch, along.segment, "
    "along.cumulative (N), along.step, bits, line_from, line_to, light (L, P)",
    where=(
        "0 <= line_from, line_to <= L, (I - 1) * across.pitch >= line_to, (J - 1) * across.segment >= P, "
        "(K - 1) * along.pitch >= line_to, along.segment == GROUP, (M - 1) * GROUP >= columns, "
        "(N - 1) / along.step + 2 + BEYOND <= beyond, 2 * beyond <= S"
    ),
)
def filter_moved_lines(  # type: ignore[no-untyped-def]
    values, starts, beyond, columns, across, along, bits, line_from, line_to, light
):
    """Filter lines line_from .. line_to - 1 of a page at any placement, above the backing's level.

    values, starts: light as from ``lookup_groups``, with ``beyond`` rows of starts at zeros before and after those of
    the page; across, along: ``FilterPass``, along at lines and raster columns; bits: a raster pixel has 2^bits phases;
    light (lines, pixels). Rows that a line sees are summed up first, since a page has fewer lines than raster rows;
    where they are all the same they are not.
    """
    seen = int(np.ceil((across.cumulative.size - 1) / across.step)) + 1
    taps = whole_eights(seen)
    x_reach = (across.cumulative.size - 1) / (2 * across.step)
    y_reach = (along.cumulative.size - 1) / (2 * along.step)
    y_taps = int(np.ceil(2 * y_reach)) + 1
    offset = beyond - y_taps
    across_table = weights_at_phases(across.cumulative, across.step, 1 << bits, taps).reshape(-1)
    along_table = weights_at_phases(along.cumulative, along.step, 1 << bits, y_taps)
    slopes = derivatives(along_table).reshape(-1)
    along_weights = along_table.reshape(-1)
    most_tilt = np.float32(LINEAR_FOOTPRINTS * 2 * y_reach / (GROUP / 2) * (1 << bits))
    most_beyond = np.float32((BEYOND << bits) / (GROUP / 2))
    width = starts.shape[1] * GROUP
    line_light = np.zeros(width + 3 * taps, np.float32)
    summed = line_light[taps : taps + width]
    x_places, y_places = np.empty(across.places.shape[1]), np.empty(along.places.shape[1])
    x_first = np.empty((x_places.size - 1, across.segment), np.int32)
    x_weights_at = np.empty_like(x_first)
    rows, groups = starts.shape[0] - 2 * beyond, starts.shape[1]
    y_first, y_weights_at = np.empty(groups, np.int32), np.empty(groups, np.int32)
    rests, tilts = np.empty(groups, np.float32), np.empty(groups, np.float32)
    same_from, copied_from = np.zeros(groups, np.int32), np.full(groups, np.int32(-1))
    next_row = -1
    for line in range(line_from, line_to):
        place_row(along.places, along.pitch, line, y_places)
        is_steep = begin_groups(
            y_places, y_reach, bits, y_taps, rows, most_beyond, y_first, y_weights_at, rests, tilts
        )
        if next_row < 0:
            next_row = y_first.min() - BEYOND + offset
            same_from[:] = next_row
            next_row += 1
        newest = y_first.max() + y_taps + BEYOND + offset
        mark_changes(starts, next_row, newest, same_from)
        next_row = max(next_row, newest)
        sum_groups(
            values,
            starts,
            offset,
            same_from,
            copied_from,
            along_weights,
            slopes,
            y_taps,
            bits,
            most_tilt,
            is_steep,
            y_first,
            y_weights_at,
            rests,
            tilts,
            summed,
        )
        place_row(across.places, across.pitch, line, x_places)
        begin_row(x_places, x_reach, bits, taps, columns, x_first, x_weights_at)
        filter_row(line_light, x_first.reshape(-1), across_table, x_weights_at.reshape(-1), taps, light[line])
