"""Compiled loops for local displacements: sums of residuals from which they are estimated, and their removal."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.residuals.binning import add_row
from prooflight.kernels.residuals.fit import sum_of
from prooflight.kernels.vectors import GROUP, LONG, Group, Rows, sums_of_lines

MOST_SIGMA = 16.0
"""Greatest residual that counts. [standard deviations]"""


@intrinsic
def sum_slopes(context, residual, weight, light, first, last, at, sums):  # type: ignore[no-untyped-def]
    """Compute sums as ``slope_sums`` over lines first .. last - 1 of sixteen columns from ``at`` on, into sums (5, w).

    The columns may extend into the next line, and w by as much beyond the pixels.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        residuals, weights, lights, out = (
            Rows(context, builder, signature.args[n], args[n]) for n in (0, 1, 2, 6)
        )
        first, last, at = args[3:6]

        def terms(line: Any) -> list[Group]:
            w, (across, along) = weights.at(line, at), lights.slopes(line, at)
            across, along = across * 0.5, along * 0.5
            most = w.root() * MOST_SIGMA
            push = (residuals.at(line, at) * w).at_most(most).at_least(most * -1.0)
            return [across * push, along * push, across * across * w, along * along * w, across * along * w]

        for n, total in enumerate(sums_of_lines(builder, first, last, terms, 5)):
            out.store(ir.Constant(LONG, n), at, total)
        return context.get_dummy_value()

    place = types.int64
    return types.void(residual, weight, light, place, place, place, sums), generate


@kernel(
    "residual (L, P), weight (L, P), light (L, P), side, first, last, out (5, R, _)",
    where="0 <= first, last <= R, P >= GROUP",
    fastmath=True,
    error_model="numpy",
)
def slope_sums(residual, weight, light, side, first, last, out):  # type: ignore[no-untyped-def]
    """Add sums of one sensor's residuals about local displacements to out (5, tile rows, tile columns).

    Rows first .. last - 1: sums of gx r / V, gy r / V, gx^2 / V, gy^2 / V, gx gy / V; gx, gy: slopes of the
    light across and along; r is limited to ``MOST_SIGMA``. The last tiles include the remaining pixels.
    """
    lines, pixels = residual.shape
    rows, columns = out.shape[1], out.shape[2]
    sums = np.empty((5, pixels + GROUP), np.float32)
    for row in range(first, last):
        begin, stop = max(row * side, 2), lines - 2 if row == rows - 1 else min((row + 1) * side, lines - 2)
        for at in range(0, pixels, GROUP):
            sum_slopes(residual, weight, light, begin, stop, at, sums)
        for i in range(5):
            if i % 2 == 0:  # there is no slope across at the ends
                sums[i, 0] = sums[i, pixels - 1] = np.float32(0)
            for column in range(columns):
                end = pixels if column == columns - 1 else (column + 1) * side
                out[i, row, column] += sum_of(sums[i, column * side : end])


@inner_kernel(fastmath=True, error_model="numpy")
def between(above, below, share, out):  # type: ignore[no-untyped-def]
    """Interpolate between two rows (pixels,); out may be longer."""
    for x in range(above.size):
        out[x] = above[x] + share * (below[x] - above[x])


@intrinsic
def by_slopes(context, weight, light, by, line, at, out):  # type: ignore[no-untyped-def]
    """Compute by how much sixteen pixels of a line lighten from ``at`` on if light moves, into out (1, w).

    by (2, w): to the left and up [pixels]. Pixels without weight do not.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        weights, lights, moves, change = (
            Rows(context, builder, signature.args[n], args[n]) for n in (0, 1, 2, 5)
        )
        line, at = args[3:5]
        none, one = ir.Constant(LONG, 0), ir.Constant(LONG, 1)
        across, along = lights.slopes(line, at)
        of_both = (across * moves.at(none, at) + along * moves.at(one, at)) * 0.5
        change.store(none, at, of_both.chosen(weights.at(line, at), ">", 0.0))
        return context.get_dummy_value()

    return types.void(weight, light, by, types.int64, types.int64, out), generate


@kernel(
    "residual (L, P), weight (L, P), light (L, P), right (R, P), down (R, P), first, last",
    where="0 <= first, last <= L, R > 0, P >= GROUP",
    error_model="numpy",
)
def take_slopes(residual, weight, light, right, down, first, last):  # type: ignore[no-untyped-def]
    """Subtract local displacements from one sensor's residuals, in place, in lines first .. last - 1.

    right, down: by how far light lies too far right and down, at the middles of rows of squares, (rows, pixels)
    [pixels]; linear between them.
    """
    lines, pixels = residual.shape
    rows = right.shape[0]
    by, change = np.zeros((2, pixels + GROUP), np.float32), np.empty((1, pixels + GROUP), np.float32)
    for line in range(max(first, 2), min(last, lines - 2)):
        place = min(max((line + 0.5) * rows / lines - 0.5, 0.0), rows - 1.0)
        row = min(int(place), max(rows - 2, 0))
        after, share = min(row + 1, rows - 1), np.float32(place - row)
        between(right[row], right[after], share, by[0])
        between(down[row], down[after], share, by[1])
        for at in range(0, pixels, GROUP):
            by_slopes(weight, light, by, line, at, change)
        add_row(change[0, 2 : pixels - 2], residual[line, 2 : pixels - 2])
