"""Compiled loops of prediction at any placement: every camera pixel has its own position on the raster.

Weights are tabulated at so many phases of a raster pixel that the nearest is accurate enough, and are stored
in the order of their raster pixels: a camera pixel is one product of two short vectors, independent of its
neighbours.
"""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.planes import compose_row
from prooflight.kernels.prediction.aiming import begin_row, place_row, weights_at_phases, whole_eights
from prooflight.kernels.prediction.filtering import filter_row
from prooflight.kernels.prediction.lines import lookup_packed, same_row
from prooflight.kernels.prediction.lookup import AT_ONCE
from prooflight.kernels.prediction.summing import EIGHT, transpose_eight


@inner_kernel()
def keep_block(block, slot, turned):  # type: ignore[no-untyped-def]
    """Transpose rows (8, pixels and more) into slots slot .. slot + 7 of turned (pixels and more, slots).

    Pixels are processed in eights.
    """
    stride, slots = block.shape[1], turned.shape[1]
    rows, to = block.reshape(-1), turned.reshape(-1)
    for at in range(0, turned.shape[0], EIGHT):
        transpose_eight(rows, at, stride, to, at * slots + slot, slots)


@inner_kernel()
def to_slots(first, depth, slots):  # type: ignore[no-untyped-def]
    """Convert first rows (pixels,) to indices in memory of (pixels, slots), row r at r % depth; in place."""
    base = first.min() // depth * depth
    for i in range(first.size):
        slot = first[i] - base
        first[i] = np.int32(i * slots + (slot - depth if slot >= depth else slot))


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
    "packed (H, _), repeats (H), planes (4, 2), quantised.codes (65536, 16), quantised.inner (_, 4), "
    "quantised.outer (_, 8), quantised.bits (4), backing, across.places (I, J), across.pitch, across.segment, "
    "across.cumulative (_), along.places (K, M), along.pitch, along.segment, "
    "along.cumulative (_), bits, crossed, line_from, line_to, light (L, P)",
    where=(
        "0 <= line_from, line_to <= L, (I - 1) * across.pitch >= H, (J - 1) * across.segment >= P, "
        "(K - 1) * along.pitch >= line_to, (M - 1) * along.segment >= P"
    ),
)
def filter_moved_lines(  # type: ignore[no-untyped-def]
    packed, repeats, planes, quantised, backing, across, along, bits, crossed, line_from, line_to, light
):
    """Filter lines line_from .. line_to - 1 in one table of a page at any placement, above the backing's level.

    Arguments as in ``filter_lines``; repeats: raster rows that are known to equal the one above; planes: as in
    ``compose_row``, by which each row is composed when it is needed, since writing and reading a whole raster
    takes longer; bits: a raster pixel has 2^bits phases; crossed: raster rows that a line crosses. Rows are
    filtered across eight at once and transposed, so that the pixels that a camera pixel sees along are adjacent
    too: each has room for as many rows as its line needs, and the first ones are repeated after the last. Rows
    and columns count from ``taps`` before the page on.
    """
    rows, columns = packed.shape
    pixels = light.shape[1]
    seen = int(np.ceil((across.cumulative.size - 1) / across.step)) + 1
    taps = whole_eights(seen)
    reach = (across.cumulative.size - 1) / (2 * across.step)
    across_table = weights_at_phases(across.cumulative, across.step, 1 << bits, taps).reshape(-1)
    along_table = weights_at_phases(along.cumulative, along.step, 1 << bits, taps).reshape(-1)
    source = np.zeros(columns + 3 * taps, np.float32)
    few = np.zeros((2, AT_ONCE), np.uint32)
    room = whole_eights(pixels)
    block = np.zeros((EIGHT, room), np.float32)
    depth = (seen + crossed + 2 * EIGHT) // EIGHT * EIGHT
    turned = np.zeros((room, depth + taps), np.float32)
    x_places, y_places = np.empty(across.places.shape[1]), np.empty(along.places.shape[1])
    x_first = np.empty((x_places.size - 1, across.segment), np.int32)
    y_first = np.empty((y_places.size - 1, along.segment), np.int32)
    x_weights_at, y_weights_at = np.empty_like(x_first), np.empty_like(y_first)
    x_begins, x_weight_starts = x_first.reshape(-1), x_weights_at.reshape(-1)
    y_begins, y_weight_starts = y_first.reshape(-1), y_weights_at.reshape(-1)
    is_displaced = planes.any()
    composed = np.empty((2 if is_displaced else 0, columns), np.uint32)
    turn = 0
    before = few[0]
    next_row = -1
    last_row = -2
    for line in range(line_from, line_to):
        place_row(along.places, along.pitch, line, y_places)
        begin_row(y_places, reach, bits, taps, rows, y_first, y_weights_at)
        if next_row < 0:
            next_row = y_first.min() // EIGHT * EIGHT
        while next_row < y_first.max() + seen:
            for k in range(EIGHT):
                row = next_row + k - taps
                if row < 0 or row >= rows:
                    block[k] = 0
                    continue
                place_row(across.places, across.pitch, row, x_places)
                begin_row(x_places, reach, bits, taps, columns, x_first, x_weights_at)
                if row - 1 != last_row or not is_repeated(repeats, row, planes):
                    here = packed[row]
                    if is_displaced:
                        turn = 1 - turn
                        here = composed[turn]
                        compose_row(packed, row, planes, here)
                    if row - 1 != last_row or not same_row(here, before):
                        lookup_packed(here, quantised, backing, few, source[taps : taps + columns])
                    before = here
                last_row = row
                filter_row(source, x_begins, across_table, x_weight_starts, taps, block[k, :pixels])
            slot = next_row % depth
            keep_block(block, slot, turned)
            if slot < taps:
                keep_block(block, depth + slot, turned)
            next_row += EIGHT
        to_slots(y_begins, depth, turned.shape[1])
        filter_row(turned.reshape(-1), y_begins, along_table, y_weight_starts, taps, light[line])
