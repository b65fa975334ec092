"""Compiled loops of prediction at any placement: every camera pixel has its own position on the raster.

Weights are tabulated at so many phases of a raster pixel that the nearest is accurate enough, and are stored
in the order of their raster pixels: a camera pixel is one product of two short vectors, independent of its
neighbours.
"""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.planes import compose_row
from prooflight.kernels.prediction.aiming import (
    begin_row,
    derivatives,
    place_row,
    weights_at_phases,
    whole_eights,
)
from prooflight.kernels.prediction.filtering import copy_row, filter_row
from prooflight.kernels.prediction.lines import lookup_packed, same_row
from prooflight.kernels.prediction.lookup import AT_ONCE
from prooflight.kernels.prediction.summing import GROUP, sum_tilted

BEYOND = 1
"""Rows before and after those that the middle of a group sees that its other columns may see."""
LINEAR_FOOTPRINTS = 0.008
"""Greatest displacement within a group, in footprints, at which weights change linearly: they are then off
by less than the nearest phase's."""


@inner_kernel(error_model="numpy")
def begin_groups(places, segment, reach, bits, taps, beyond, first, weights_at, rests, tilts):  # type: ignore[no-untyped-def]
    """Compute where the middle of each group of raster columns sees the first row, and its weights.

    places: of columns 0, segment, 2 segment, ..., linear between. reach, bits, taps, beyond, first, weights_at: as in
    ``begin_row``, (segments, groups). Written too: rests (segments, groups), phases by which a group lies beyond the
    nearest; tilts (segments,), phases by which a column sees another place than its neighbour.
    """
    count = 1 << bits
    for k in range(tilts.size):
        step = (places[k + 1] - places[k]) / segment
        tilts[k] = step * count
        begin = places[k] - reach + step * ((GROUP - 1) / 2)
        for group in range(first.shape[1]):
            here = min(max(begin + step * GROUP * group, -1e6), 1e6)
            whole = np.floor(here)
            phases = (here - whole) * count
            phase = np.floor(phases + 0.5)
            first[k, group] = min(max(np.int32(whole) + taps, 0), beyond + taps)
            weights_at[k, group] = np.int32(phase) * taps
            rests[k, group] = phases - phase


@inner_kernel()
def sum_groups(  # type: ignore[no-untyped-def]
    ring, slots, base, depth, table, slopes, taps, bits, most_tilt, first, weights_at, rests, tilts, out
):
    """Sum up the rows that one line sees, by groups of raster columns: out (groups x GROUP,).

    ring: rows of light, row r at slots[r % depth], which are repeated; base: the whole multiple of depth up to the
    first row of all; table, slopes: weights at phases, and their derivatives; the others as from ``begin_groups``.
    Within a group weights change linearly, unless the tilt is more than ``most_tilt``.
    """
    groups = first.shape[1]
    firsts, weight_starts, beyond = first.reshape(-1), weights_at.reshape(-1), rests.reshape(-1)
    for group in range(out.size // GROUP):
        slot = firsts[group] - base
        slot = slot - depth if slot >= depth else slot
        tilt, weight, at = tilts[group // groups], weight_starts[group], GROUP * group
        if abs(tilt) <= most_tilt:
            sum_tilted(ring, slots, slot, table, slopes, weight, taps, beyond[group], tilt, out, at)
        else:
            sum_columns(ring, slots, firsts[group], depth, table, weight // taps, taps, bits, tilt, out, at)


@inner_kernel(error_model="numpy")
def sum_columns(ring, slots, row, depth, table, phase, taps, bits, tilt, out, at):  # type: ignore[no-untyped-def]
    """Sum up the rows of one group column by column; row, phase: where its middle sees them."""
    for i in range(GROUP):
        place = phase + int(np.rint(tilt * np.float32(i - (GROUP - 1) / 2)))
        start = max(row + (place >> bits), 0) % depth
        weight = (place & ((1 << bits) - 1)) * taps
        total = np.float32(0)
        for t in range(taps):
            total += table[weight + t] * ring[slots[start + t] + at + i]
        out[at + i] = total


@inner_kernel()
def is_repeated(repeats, row, planes):  # type: ignore[no-untyped-def]
    """Return whether a composed row equals the one above, since the row of every plane does."""
    for ink in range(planes.shape[0]):
        own = row - planes[ink, 1]
        if own == 0 or own == repeats.size or (0 < own < repeats.size and not repeats[own]):
            return False
    return True


@kernel("packed (H, _), repeats (H)")
def find_repeats(packed, repeats):  # type: ignore[no-untyped-def]
    """Set repeats (rows,) where a raster row equals the one above."""
    for row in range(repeats.size):
        repeats[row] = row > 0 and same_row(packed[row], packed[row - 1])


@kernel(
    "packed (H, W), repeats (H), planes (4, 2), quantised.codes (65536, 16), quantised.inner (_, 4), "
    "quantised.outer (_, 8), quantised.bits (4), backing, across.places (I, J), across.pitch, across.segment, "
    "across.cumulative (_), along.places (K, M), along.pitch, along.segment, "
    "along.cumulative (_), bits, crossed, line_from, line_to, light (L, P)",
    where=(
        "0 <= line_from, line_to <= L, (I - 1) * across.pitch >= line_to, (J - 1) * across.segment >= P, "
        "(K - 1) * along.pitch >= line_to, (M - 1) * along.segment >= W"
    ),
)
def filter_moved_lines(  # type: ignore[no-untyped-def]
    packed, repeats, planes, quantised, backing, across, along, bits, crossed, line_from, line_to, light
):
    """Filter lines line_from .. line_to - 1 in one table of a page at any placement, above the backing's level.

    Arguments as in ``filter_lines``, but along: at lines and raster columns; repeats: raster rows that
    are known to equal the one above; planes: as in ``compose_row``, by which each row is composed when it is needed,
    since writing and reading a whole raster takes longer; bits: a raster pixel has 2^bits phases; crossed: raster rows
    that a line crosses. Rows that a line sees are summed up first, since a page has fewer lines than raster rows; equal
    rows are kept once, and a line that sees such rows alone is one of them. Rows and columns count from ``taps``
    before the page on.
    """
    rows, columns = packed.shape
    seen = int(np.ceil((across.cumulative.size - 1) / across.step)) + 1
    taps = whole_eights(seen)
    x_reach = (across.cumulative.size - 1) / (2 * across.step)
    y_reach = (along.cumulative.size - 1) / (2 * along.step)
    y_taps = int(np.ceil(2 * y_reach)) + 1
    across_table = weights_at_phases(across.cumulative, across.step, 1 << bits, taps).reshape(-1)
    along_table = weights_at_phases(along.cumulative, along.step, 1 << bits, y_taps)
    slopes = derivatives(along_table).reshape(-1)
    along_weights = along_table.reshape(-1)
    few = np.zeros((2, AT_ONCE), np.uint32)
    most_tilt = np.float32(LINEAR_FOOTPRINTS * 2 * y_reach / (GROUP / 2) * (1 << bits))
    depth = y_taps + crossed + 2 * BEYOND
    width = (columns + GROUP - 1) // GROUP * GROUP
    ring = np.zeros((depth + 1) * width, np.float32)  # the last row is beyond the page
    slots = np.full(2 * depth, depth * width)
    line_light = np.zeros(width + 3 * taps, np.float32)
    summed = line_light[taps : taps + width]
    x_places, y_places = np.empty(across.places.shape[1]), np.empty(along.places.shape[1])
    x_first = np.empty((x_places.size - 1, across.segment), np.int32)
    y_first = np.empty((y_places.size - 1, along.segment // GROUP), np.int32)
    x_weights_at, y_weights_at = np.empty_like(x_first), np.empty_like(y_first)
    rests, tilts = np.empty(y_first.shape, np.float32), np.empty(y_places.size - 1, np.float32)
    is_displaced = planes.any()
    composed = np.empty((2 if is_displaced else 0, columns), np.uint32)
    turn, slot, newest = 0, depth, 0
    before = few[0]
    next_row, last_row = -1, -2
    equal_from, copied = -1, -2
    for line in range(line_from, line_to):
        place_row(along.places, along.pitch, line, y_places)
        begin_groups(
            y_places, along.segment, y_reach, bits, y_taps, rows, y_first, y_weights_at, rests, tilts
        )
        low = max(y_first.min() - BEYOND, 0)
        if next_row < 0:
            next_row = low
        while next_row < y_first.max() + y_taps + BEYOND:
            row, previous = next_row - y_taps, slot
            if row < 0 or row >= rows:
                slot = depth
            else:
                if row - 1 != last_row or not is_repeated(repeats, row, planes):
                    here = packed[row]
                    if is_displaced:
                        turn = 1 - turn
                        here = composed[turn]
                        compose_row(packed, row, planes, here)
                    if row - 1 != last_row or not same_row(here, before):
                        newest = newest + 1 if newest + 1 < depth else 0
                        at = newest * width
                        lookup_packed(here, quantised, backing, few, ring[at : at + columns])
                    before = here
                last_row = row
                slot = newest
            if slot != previous or equal_from < 0:
                equal_from = next_row
            slots[next_row % depth] = slots[next_row % depth + depth] = slot * width
            next_row += 1
        if equal_from > low:
            base = low // depth * depth
            sum_groups(
                ring,
                slots,
                base,
                depth,
                along_weights,
                slopes,
                y_taps,
                bits,
                most_tilt,
                y_first,
                y_weights_at,
                rests,
                tilts,
                summed,
            )
            copied = -2
        elif copied != equal_from:
            copy_row(ring[slot * width : slot * width + width], summed)
            copied = equal_from
        place_row(across.places, across.pitch, line, x_places)
        begin_row(x_places, x_reach, bits, taps, columns, x_first, x_weights_at)
        filter_row(line_light, x_first.reshape(-1), across_table, x_weights_at.reshape(-1), taps, light[line])
