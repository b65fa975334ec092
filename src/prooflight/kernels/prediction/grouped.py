"""Compiled loops that look up a raster's light once, in groups of columns, for any number of predictions.

Most of a page is flat: a group whose surroundings have one recipe is not read at all.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.planes import any_differ, compose_pixels, composed_recipes, recipes_at
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.prediction.lookup import lookup_light
from prooflight.kernels.prediction.summing import GROUP
from prooflight.kernels.vectors import fetch

AHEAD = 3
"""Rows ahead of the composed one, of the plane that lies highest, that are fetched from memory."""
PART = 8
"""Pixels of a part of a row, of each of which a byte of a 64-bit integer says something."""
PARTS = GROUP // PART
ALL_FLAT = np.uint64(0x0101010101010101)
"""Eight groups that are flat."""


@inner_kernel()
def differing_row(above, here, out):  # type: ignore[no-untyped-def]
    """Compute where a row (columns,) differs from the one above or from the pixel to the left, out (columns,) of bytes.

    Return whether it does anywhere.
    """
    every = (here[0] ^ above[0]) | here[0]
    out[0] = every != 0
    for i in range(1, here.size):
        differs = (here[i] ^ above[i]) | (here[i] ^ here[i - 1])
        out[i] = differs != 0
        every |= differs
    return every != 0


@inner_kernel()
def add_masked(parts, mask, out):  # type: ignore[no-untyped-def]
    """Add the bits of ``parts`` (n,) within a mask to those of out (n,)."""
    for i in range(out.size):
        out[i] |= parts[i] & mask


@inner_kernel()
def add_near(parts, first, reach, out):  # type: ignore[no-untyped-def]
    """Compute which parts (n,) from ``first`` on have a byte of 1 within a reach, out (n,): not 0 there.

    parts (any,) uint64: the bytes of a row, lowest first. The reach is one byte less to the left, where a byte says
    that its pixel differs from the one before.
    """
    whole = ~np.uint64(0)
    for i in range(out.size):
        out[i] = parts[first + i]
    for side, bytes_there in ((-1, reach - 1), (1, reach)):
        for step in range(1, bytes_there // PART + 1):
            at = first + side * step
            add_masked(parts[at : at + out.size], whole, out)
        if bytes_there % PART:
            at, rest = first + side * (bytes_there // PART + 1), np.uint64(8 * (PART - bytes_there % PART))
            mask = whole << rest if side < 0 else whole >> rest
            add_masked(parts[at : at + out.size], mask, out)


@kernel("packed (H, W), reach, changes (H + 1, W // GROUP)", where="0 < W, 1 <= reach")
def find_changes(packed, reach, changes):  # type: ignore[no-untyped-def]
    """Compute whether a recipe changes within ``reach`` columns of each group, from the row above or along the row.

    changes (rows + 1, whole groups) bool. Beyond the page is no ink, and its end is a change where ink ends.
    """
    rows, columns = packed.shape
    groups = changes.shape[1]
    blank = np.zeros(columns, np.uint32)
    beyond = reach // PART + 1  # parts without pixels before the first group, and after the row's last pixel
    near = np.empty(groups * PARTS, np.uint64)
    parts = np.zeros(near.size + PARTS + 2 * beyond, np.uint64)
    differs = parts.view(np.uint8)[PART * beyond : PART * beyond + columns]
    last = max((columns - reach) // GROUP, 0)  # first group from which the page's end is in reach
    for row in range(rows + 1):
        above, here = packed[row - 1] if row > 0 else blank, packed[row] if row < rows else blank
        if not differing_row(above, here, differs) and here[columns - 1] == 0:
            for group in range(groups):
                changes[row, group] = False
            continue
        add_near(parts, beyond, reach, near)
        for group in range(groups):
            every = np.uint64(0)
            for part in range(PARTS * group, PARTS * (group + 1)):
                every |= near[part]
            changes[row, group] = every != 0
        if here[columns - 1] != 0:
            for group in range(last, groups):
                changes[row, group] = True


@intrinsic
def compose_group(context, packed, cyan, magenta, yellow, black, composed, above, here, pixels, at):  # type: ignore[no-untyped-def]
    """Compose a group of columns of one row; return whether it differs from that of the row above.

    packed, composed, pixels (n,) uint32; cyan, magenta, yellow, black: where in packed each plane's begins; above,
    here: where in composed that of the row above begins, and this one. Written too: pixels from ``at`` on.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        packed, composed_data, pixels = (
            make_array(signature.args[n])(context, builder, args[n]).data for n in (0, 5, 8)
        )
        recipes = composed_recipes(builder, packed, args[1:5], GROUP)
        above = builder.load(recipes_at(builder, composed_data, args[6], GROUP), align=4)
        differs = any_differ(builder, recipes, above)
        for array, place in ((composed_data, args[7]), (pixels, args[9])):
            builder.store(recipes, recipes_at(builder, array, place, GROUP), align=4)
        return differs

    whole = types.int64
    places = (whole, whole, whole, whole)
    return types.boolean(packed, *places, composed, whole, whole, pixels, whole), generate


@inner_kernel()
def fill_group(row, at, recipe):  # type: ignore[no-untyped-def]
    """Set a group of a row from ``at`` on to one recipe."""
    for i in range(at, at + GROUP):
        row[i] = recipe


@inner_kernel()
def differing_groups(row, one, other):  # type: ignore[no-untyped-def]
    """Return whether two groups of a row differ that begin at ``one`` and ``other``."""
    differs = np.uint32(0)
    for i in range(GROUP):
        differs |= row[one + i] ^ row[other + i]
    return differs != 0


@inner_kernel()
def compose_border(packed, row, planes, composed, above, here, column, pixels, at):  # type: ignore[no-untyped-def]
    """Run ``compose_group`` on a group from ``column`` on of which some planes lack pixels."""
    stop = min(column + GROUP, packed.shape[1])
    compose_pixels(packed, row, planes, composed[here : here + stop], column, stop)
    copy_row(composed[here + column : here + column + GROUP], pixels[at : at + GROUP])
    return differing_groups(composed, above + column, here + column)


@kernel(
    "packed (H, W), flat (H, W // GROUP), planes (4, 2), tables[].codes (N, 65536, 16), tables[].bits (N, 4), "
    "backings (N), starts (H, (W + GROUP - 1) // GROUP), values (N, V)",
    where="GROUP * (1 + H * ((W + GROUP - 1) // GROUP)) <= V",
)
def lookup_groups(packed, flat, planes, tables, backings, starts, values):  # type: ignore[no-untyped-def]
    """Look up a raster with displaced planes, in groups of columns.

    packed (rows, columns) uint32; flat (rows, whole groups): groups that have the recipe of all pixels around them,
    further than any plane is displaced; planes: as in ``compose_row``; tables: a tuple of n ``QuantisedTable``;
    backings (n,). Written: starts (rows, groups) int32, where in values the light of each group begins;
    values (n, any) float32: light above the backing's, 0 beyond the page. Groups that are equal to that above,
    or flat and beside a flat one, begin where it does.
    """
    rows, columns = packed.shape
    groups, whole = starts.shape[1], flat.shape[1]
    width, eights = groups * GROUP, whole // 8
    of_columns = packed.reshape(-1)
    composed = np.zeros(2 * width, np.uint32)
    pixels = np.empty(width, np.uint32)
    places = np.empty(4, np.int64)
    low, high = max(0, planes[:, 0].max()), min(columns, columns + planes[:, 0].min()) - GROUP
    top, bottom = max(0, planes[:, 1].max()), min(rows, rows + planes[:, 1].min())
    least, at = planes[:, 1].min(), GROUP
    for row in range(rows):
        here, above = row % 2 * width, (1 - row % 2) * width
        for ink in range(4):
            places[ink] = (row - planes[ink, 1]) * columns - planes[ink, 0]
        ahead = min(row - least + AHEAD, rows - 1) * columns
        flats, before = flat[row], flat[max(row - 1, 0)]
        flat_eights, eights_before = flats[: 8 * eights].view(np.uint64), before[: 8 * eights].view(np.uint64)
        begins, last_begins = starts[row], starts[max(row - 1, 0)]
        is_first, count, group = row == 0, 0, 0
        while group < groups:
            eight = group // 8
            skips = group % 8 == 0 and eight < eights and not is_first
            if skips and flat_eights[eight] == ALL_FLAT and eights_before[eight] == ALL_FLAT:
                for each in range(group, group + 8):
                    begins[each] = last_begins[each]
                group += 8
                continue
            column = GROUP * group
            is_flat = group < whole and flats[group]
            was_flat = group < whole and before[group]
            if is_flat and was_flat and not is_first:
                begins[group] = last_begins[group]
                group += 1
                continue
            if was_flat:
                fill_group(composed, above + column, packed[max(row - 1, 0), column])
            if is_flat:
                fill_group(composed, here + column, packed[row, column])
                fill_group(pixels, count, packed[row, column])
                is_new = differing_groups(composed, above + column, here + column)
            elif top <= row < bottom and low <= column <= high:
                fetch(of_columns, ahead + column, ahead + column + GROUP)
                is_new = compose_group(
                    of_columns,
                    places[0] + column,
                    places[1] + column,
                    places[2] + column,
                    places[3] + column,
                    composed,
                    above + column,
                    here + column,
                    pixels,
                    count,
                )
            else:
                is_new = compose_border(packed, row, planes, composed, above, here, column, pixels, count)
            if not (is_new or is_first):
                begins[group] = last_begins[group]
            elif is_flat and group > 0 and flats[group - 1]:
                begins[group] = begins[group - 1]
            else:
                begins[group] = at + count
                count += GROUP
            group += 1
        if count:
            for n in range(len(tables)):
                lookup_light(pixels[:count], tables[n], backings[n], values[n, at : at + count])
        if whole < groups:  # its other columns are beyond the page
            for n in range(len(tables)):
                values[n, begins[whole] + columns - GROUP * whole : begins[whole] + GROUP] = 0
        at += count
