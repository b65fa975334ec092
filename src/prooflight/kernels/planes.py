"""Compiled loops that displace a raster's ink planes."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]

from prooflight.kernels.area_averages import STEPS
from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.vectors import INT, number_at

HALVINGS = 16
"""Number of bisections that find a factor on inks, of at most some hundred, to less than a byte of ink."""


def recipes_at(builder: Any, packed: Any, place: Any, count: int) -> Any:
    """Return the address of ``count`` adjacent recipes of a packed raster, for an intrinsic's loads and stores."""
    return builder.bitcast(number_at(builder, packed, place), ir.VectorType(INT, count).as_pointer())


def composed_recipes(builder: Any, packed: Any, places: Any, count: int) -> Any:
    """Return a vector of ``count`` recipes whose inks are taken from four places of a packed raster, cyan first."""
    total = None
    for ink, place in enumerate(places):
        mask = ir.Constant(ir.VectorType(INT, count), [ir.Constant(INT, 255 << (8 * ink))] * count)
        part = builder.and_(builder.load(recipes_at(builder, packed, place, count), align=4), mask)
        total = part if total is None else builder.or_(total, part)
    return total


def any_differ(builder: Any, recipes: Any, others: Any) -> Any:
    """Return whether any recipe of two vectors differs, a truth value of the compiled loop."""
    bits = ir.IntType(recipes.type.count)
    flags = builder.bitcast(builder.icmp_unsigned("!=", recipes, others), bits)
    return builder.icmp_unsigned("!=", flags, bits(0))


@inner_kernel()
def compose_row(packed, row, planes, out):  # type: ignore[no-untyped-def]
    """Compose one raster row as printed, (columns,) uint32 with cyan in the lowest byte, with every plane displaced.

    planes (4, 2): number of pixels by which each lies too far right and too far down.
    """
    rows, columns = packed.shape
    right, above = planes[:, 0], row - planes[:, 1]
    first, stop = max(0, right.max()), min(columns, columns + right.min())
    if first < stop and above.min() >= 0 and above.max() < rows:
        compose_inner(packed, above, right, out[first:stop], first)
        compose_pixels(packed, row, planes, out, 0, first)
        compose_pixels(packed, row, planes, out, stop, columns)
    else:
        compose_pixels(packed, row, planes, out, 0, columns)


@inner_kernel()
def compose_inner(packed, rows, right, out, at):  # type: ignore[no-untyped-def]
    """Compose part of a row, out (n,) from pixel ``at`` on, where all planes have pixels.

    They are taken from rows (4,), right (4,) aside.
    """
    count = out.size
    c = packed[rows[0], at - right[0] : at - right[0] + count]
    m = packed[rows[1], at - right[1] : at - right[1] + count]
    y = packed[rows[2], at - right[2] : at - right[2] + count]
    k = packed[rows[3], at - right[3] : at - right[3] + count]
    for i in range(count):
        out[i] = (
            (c[i] & np.uint32(0xFF))
            | (m[i] & np.uint32(0xFF00))
            | (y[i] & np.uint32(0xFF0000))
            | (k[i] & np.uint32(0xFF000000))
        )


@inner_kernel()
def compose_pixels(packed, row, planes, out, begin, end):  # type: ignore[no-untyped-def]
    """Compose pixels begin .. end - 1 as in ``compose_row``, where planes may lack some."""
    rows, columns = packed.shape
    out[begin:end] = 0
    for ink in range(4):
        right = planes[ink, 0]
        source_row = row - planes[ink, 1]
        if 0 <= source_row < rows and abs(right) < columns:
            mask = np.uint32(255 << (8 * ink))
            first = max(right, begin)
            stop = max(min(columns + right, end), first)
            source = packed[source_row, first - right : stop - right]
            target = out[first:stop]
            for i in range(target.size):
                target[i] |= source[i] & mask


@kernel("packed (H, W), planes (4, 2), out (H, W)")
def compose_rows(packed, planes, out):  # type: ignore[no-untyped-def]
    """Run ``compose_row`` on all rows, out (rows, columns)."""
    for row in range(out.shape[0]):
        compose_row(packed, row, planes, out[row])


@inner_kernel(error_model="numpy")
def common_factor(light, solids, left):  # type: ignore[no-untyped-def]
    """Return the factor on the light (4,) that inks take at which they leave ``left`` together.

    light: shares of what each ink's solid takes, solids (4,), beyond which none takes more. Inks' light multiplies.
    """
    least, most = np.float32(0), np.float32(1)
    for ink in range(4):
        if light[ink] > 0:
            most = max(most, np.float32(1) / light[ink])
    for _ in range(HALVINGS):
        factor = np.float32(0.5) * (least + most)
        leave = np.float32(1)
        for ink in range(4):
            leave *= np.float32(1) - solids[ink] * min(factor * light[ink], np.float32(1))
        if leave > left:
            least = factor
        else:
            most = factor
    return np.float32(0.5) * (least + most)


@kernel(
    "packed (H, W), planes (4, 2), parts (4, 2), count, flat, takes (4, 256), needs (4, STEPS + 1), solids (4), "
    "out (H, W)",
    where="0 < count",
)
def compose_by_parts(packed, planes, parts, count, flat, takes, needs, solids, out):  # type: ignore[no-untyped-def]
    """Compose a raster whose planes lie off by whole pixels (``compose_row``) and by parts of one.

    parts (4, 2): further displacement to the right and down, in ``count``-ths of a pixel, 0 <= parts < count. Of each
    ink a pixel takes the mean light of its parts, as in ``average_areas``, of which flat, takes and needs are. Where
    several inks differ, what they take is multiplied by one factor, so that they leave together what count x count
    equal parts of the pixel leave, each of its own recipe; solids (4,): light that solids take, as shares of white.
    """
    further = planes + (parts > 0)
    turned = np.empty((2, 2, 4, 2), planes.dtype)
    for down in range(2):
        for across in range(2):
            turned[down, across, :, 0] = further[:, 0] if across else planes[:, 0]
            turned[down, across, :, 1] = further[:, 1] if down else planes[:, 1]
    rows = np.empty((4, packed.shape[1]), np.uint32)
    leaves = np.empty((4, 256), np.float32)
    for ink in range(4):
        leaves[ink] = np.float32(1) - solids[ink] * takes[ink]
    share = np.float32(1) / np.float32(count)
    light, mean, differ = np.empty(4, np.float32), np.empty(4, np.float32), np.empty(4, np.int64)
    amounts, weights = np.empty((4, 4), np.int64), np.empty((4, 4), np.float32)
    for ink in range(4):
        x, y = share * np.float32(parts[ink, 0]), share * np.float32(parts[ink, 1])
        weights[ink, 0], weights[ink, 1] = (1 - x) * (1 - y), x * (1 - y)
        weights[ink, 2], weights[ink, 3] = (1 - x) * y, x * y
    for row in range(packed.shape[0]):
        for corner in range(4):
            compose_row(packed, row, turned[corner // 2, corner % 2], rows[corner])
        for column in range(packed.shape[1]):
            first = rows[0, column]
            out[row, column] = first
            if rows[1, column] == first and rows[2, column] == first and rows[3, column] == first:
                continue
            several = 0
            for ink in range(4):
                low, high = 255, 0
                light[ink], mean[ink] = 0, 0
                for corner in range(4):
                    amount = (rows[corner, column] >> np.uint32(8 * ink)) & np.uint32(255)
                    amounts[ink, corner] = amount
                    low, high = min(low, amount), max(high, amount)
                    mean[ink] += weights[ink, corner] * np.float32(amount)
                    light[ink] += weights[ink, corner] * takes[ink, amount]
                differ[ink] = high - low
                if differ[ink] < flat:
                    light[ink] = 0
                else:
                    several += 1
            factor = np.float32(1)
            if several > 1:
                left = np.float32(0)
                for down in range(count):
                    for across in range(count):
                        of_part = np.float32(1)
                        for ink in range(4):
                            if differ[ink] >= flat:
                                corner = 2 * (down < parts[ink, 1]) + (across < parts[ink, 0])
                                of_part *= leaves[ink, amounts[ink, corner]]
                        left += of_part
                factor = common_factor(light, solids, share * share * left)
            recipe = np.uint32(0)
            for ink in range(4):
                if differ[ink] >= flat:
                    taken = min(factor * light[ink], np.float32(1))
                    amount = np.uint32(needs[ink, int(taken * STEPS + np.float32(0.5))])
                else:
                    amount = np.uint32(int(mean[ink] + np.float32(0.5)))
                recipe |= amount << np.uint32(8 * ink)
            out[row, column] = recipe
