"""Compiled loops for sums of residuals over tiles and down columns, for every mode.

The sums of sixteen columns over some lines stay in registers.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from prooflight.cmyk import INKS
from prooflight.kernels.compiled import inner_kernel, kernel
from prooflight.kernels.prediction.filtering import copy_row
from prooflight.kernels.residuals.binning import add_row
from prooflight.kernels.vectors import GROUP, LONG, Group, Rows, filled, sums_of_lines, whole_groups

VOID, BLUR, WHOLE = 1 + 2 * INKS, 2 + 2 * INKS, 3 + 2 * INKS
"""Numbers of modes: light, each ink added (4), each ink's gain (4), void, blur and all inks' gain."""
MOST_SQUARE: Final = 25.0
LINES = 4
"""Lines that ``line_sums`` sums up at once."""


class ResidualImages(NamedTuple):
    """Residuals of one sensor's scan with the images for its modes; images (..., lines, pixels).

    With one more axis in front, those of all sensors.
    """

    residual: NDArray[np.float32]
    """Residual. [DN]"""
    weight: NDArray[np.float32]
    """Inverse variance. [1/DN^2]"""
    light: NDArray[np.float32]
    """Expected light. [DN]"""
    white: NDArray[np.float32]
    """Light of bare paper, (..., pixels). [DN]"""
    add: NDArray[np.float32]
    """``Modes.add``, (..., 4, lines, pixels). [DN]"""
    gain: NDArray[np.float32]
    """``Modes.gain``, (..., 4, lines, pixels). [DN]"""
    of_edges: NDArray[np.float32]
    """Share of the variance due to edges. [-]"""


@intrinsic
def sum_modes(  # type: ignore[no-untyped-def]
    context, residual, weight, light, of_edges, gains, modes, begins, first, last, at, most, most_edges, sums
):
    """Compute sums of two modes over lines first .. last - 1 of sixteen columns from ``at`` on, by class of edges.

    Written: sums (2 x classes x 4, w) from ``at`` on. They are sums of P r / V, P^2 / V, P light / V and the edges'
    part of P^2 / V, r without its column's part of the light, ``gains`` (1, w), and limited to ``most`` sigma. The
    lines of each mode, P, are from its ``begins`` on. Pixels whose variance is due to edges by more than ``most_edges``
    are left out. The columns may extend into the next line, and w by as much beyond the pixels.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        residuals, weights, lights, shares, own_gains, out = (
            Rows(context, builder, signature.args[n], args[n]) for n in (0, 1, 2, 3, 4, 12)
        )
        images, begins = (cgutils.unpack_tuple(builder, args[n]) for n in (5, 6))
        modes = [Rows(context, builder, signature.args[5].dtype, image) for image in images]
        first, last, at = args[7:10]
        limit, *classes = (
            Group(builder, filled(builder, number, GROUP))
            for number in (args[10], *cgutils.unpack_tuple(builder, args[11]))
        )
        gain, before = own_gains.at(ir.Constant(LONG, 0), at), [builder.sub(begin, first) for begin in begins]

        def terms(line: Any) -> list[Group]:
            w, light, share = (one.at(line, at) for one in (weights, lights, shares))
            most = limit * w.root()
            push = ((residuals.at(line, at) - light * gain) * w).at_most(most).at_least(most * -1.0)
            of_classes = [[one.chosen(share, "<=", most_edge) for one in (push, w)] for most_edge in classes]
            products = []
            for mode, by in zip(modes, before, strict=True):
                effect = mode.at(builder.add(line, by), at)
                square, shared = effect * effect, effect * light
                for own_push, own in of_classes:
                    products += [effect * own_push, square * own, shared * own, square * share * own]
            return products

        totals = sums_of_lines(builder, first, last, terms, 4 * len(modes) * len(classes))
        for n, total in enumerate(totals):
            out.store(ir.Constant(LONG, n), at, total)
        return context.get_dummy_value()

    place = types.int64
    taken = residual, weight, light, of_edges, gains, modes, begins, place, place, place, types.float32
    return types.void(*taken, most_edges, sums), generate


@intrinsic
def sum_energy(context, residual, weight, light, gains, first, last, at, sums):  # type: ignore[no-untyped-def]
    """Compute sums (2, w) as ``sum_modes``: squared residuals over their variance, and the pixels that have any."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        residuals, weights, lights, own_gains, out = (
            Rows(context, builder, signature.args[n], args[n]) for n in (0, 1, 2, 3, 7)
        )
        first, last, at = args[4:7]
        gain = own_gains.at(ir.Constant(LONG, 0), at)

        def terms(line: Any) -> list[Group]:
            w = weights.at(line, at)
            r = residuals.at(line, at) - lights.at(line, at) * gain
            return [(r * r * w).at_most(MOST_SQUARE), w.above(0.0)]

        for n, total in enumerate(sums_of_lines(builder, first, last, terms, 2)):
            out.store(ir.Constant(LONG, n), at, total)
        return context.get_dummy_value()

    place = types.int64
    return types.void(residual, weight, light, gains, place, place, place, sums), generate


@inner_kernel()
def mode_lines(m, images, scratch, first):  # type: ignore[no-untyped-def]
    """Return the image of a mode of one sensor, and where its line ``first`` is in it.

    scratch (n, lines, w): lines from ``first`` on of modes from ``VOID`` on.
    """
    if m >= VOID:
        return scratch[m - VOID], 0
    if m > INKS:
        return images.gain[m - 1 - INKS], first
    if m > 0:
        return images.add[m - 1], first
    return images.light, first


@inner_kernel()
def two_modes(m, other, images, scratch, first):  # type: ignore[no-untyped-def]
    """Return the images of two modes and where their lines ``first`` are, as ``mode_lines``."""
    (one, begin), (second, of_second) = (
        mode_lines(m, images, scratch, first),
        mode_lines(other, images, scratch, first),
    )
    return (one, second), (begin, of_second)


@inner_kernel(fastmath=True, error_model="numpy")
def void_row(light, white, out):  # type: ignore[no-untyped-def]
    """Compute the difference to bare paper."""
    for x in range(light.size):
        out[x] = white[x] - light[x]


@inner_kernel(fastmath=True, error_model="numpy")
def blur_row(light, line, out):  # type: ignore[no-untyped-def]
    """Compute half the sum of four neighbours less twice the middle; 0 at both ends."""
    above, here, below = light[line - 1], light[line], light[line + 1]
    last = light.shape[1] - 1
    out[0], out[last] = np.float32(0), np.float32(0)
    for x in range(1, last):
        around = here[x + 1] + here[x - 1] + above[x] + below[x]
        out[x] = around * np.float32(0.5) - np.float32(2) * here[x]


@kernel(
    "images.residual (L, P), images.weight (L, P), images.light (L, P), images.white (P), "
    "images.add (4, L, P), images.gain (4, L, P), images.of_edges (L, P), most_edges (2), shift (L), "
    "segment_lines, which (M), first, last, out (2, 4, M, G, P)",
    where="0 <= first, last <= G, P >= GROUP",
    fastmath=True,
    error_model="numpy",
)
def line_sums(images, most_edges, shift, segment_lines, which, first, last, out):  # type: ignore[no-untyped-def]
    """Add sums down the columns of a page, in segments of its height, to out (2, 4, modes, segments, pixels).

    Segments first .. last - 1 are processed. which (modes,): numbers of modes, none beyond ``VOID``. Of each:
    sum P r / V; P^2 / V; P light / V; the edges' part of P^2 / V. r is limited to 4 sigma. most_edges (2,):
    greatest share of variance due to edges of pixels that count. shift (lines,): whole pixels by which a line
    is moved left, so that columns of a turned page coincide. Lines are summed up by some, which stay in the cache.
    """
    residual, weight, light, white, _, _, of_edges = images
    lines, pixels = residual.shape
    wide, classes = whole_groups(pixels), (most_edges[0], most_edges[1])
    sums, gains = np.empty((16, wide), np.float32), np.zeros((1, wide), np.float32)
    void = np.zeros((1, LINES, wide), np.float32)
    for segment in range(first, last):
        line = max(segment * segment_lines, 2)
        stop = min(lines if segment == out.shape[3] - 1 else (segment + 1) * segment_lines, lines - 2)
        while line < stop:
            end, by = line + 1, shift[line]
            while end < min(line + LINES, stop) and shift[end] == by:
                end += 1
            left, right = max(by, 0), min(pixels + by, pixels)
            for near in range(line, end):
                void_row(light[near], white, void[0, near - line])
            for place in range(0, which.size, 2):
                stop_place = min(place + 2, which.size)
                modes, begins = two_modes(which[place], which[stop_place - 1], images, void, line)
                for at in range(0, pixels, GROUP):
                    sum_modes(
                        residual,
                        weight,
                        light,
                        of_edges,
                        gains,
                        modes,
                        begins,
                        line,
                        end,
                        at,
                        np.float32(4),
                        classes,
                        sums,
                    )
                if left < right:
                    for n in range(8 * (stop_place - place)):
                        to = out[n // 4 % 2, n % 4, place + n // 8, segment, left - by : right - by]
                        add_row(sums[n, left:right], to)
            line = end


@inner_kernel(fastmath=True, error_model="numpy")
def add_tile_row(images, gains, first, last, side, which, scratch, sums, out):  # type: ignore[no-untyped-def]
    """Add sums over one row of tiles, lines first .. last - 1 of one sensor, to out (4, modes + 1, tile columns).

    scratch (3, side, w), sums (8, w) are working space, w: ``whole_groups`` of pixels; the rest as in ``tile_sums``.
    """
    residual, weight, light, white, _, gain, of_edges = images
    for line in range(first, last):
        k = line - first
        for place in range(which.size):
            m = which[place]
            if m == VOID:
                void_row(light[line], white, scratch[0, k])
            elif m == BLUR:
                blur_row(light, line, scratch[1, k])
            elif m == WHOLE:
                whole_row(gain[0, line], gain[1, line], gain[2, line], gain[3, line], scratch[2, k])
    for place in range(0, which.size, 2):
        stop_place = min(place + 2, which.size)
        modes, begins = two_modes(which[place], which[stop_place - 1], images, scratch, first)
        for at in range(0, residual.shape[1], GROUP):
            sum_modes(
                residual,
                weight,
                light,
                of_edges,
                gains,
                modes,
                begins,
                first,
                last,
                at,
                np.float32(10),
                (np.float32(1),),
                sums,
            )
        for n in range(4 * (stop_place - place)):
            gather(sums[n], side, out[n % 4, place + n // 4])
    for at in range(0, residual.shape[1], GROUP):
        sum_energy(residual, weight, light, gains, first, last, at, sums)
    gather(sums[0], side, out[0, which.size])
    gather(sums[1], side, out[1, which.size])


@kernel(
    "images.residual (S, L, P), images.weight (S, L, P), images.light (S, L, P), images.white (S, P), "
    "images.add (S, 4, L, P), images.gain (S, 4, L, P), images.of_edges (S, L, P), gains (S, P), side, "
    "which (M), first, last, out (4, M + 1, L // side, P // side)",
    where="0 <= first, last <= L // side, P >= GROUP",
)
def tile_sums(images, gains, side, which, first, last, out):  # type: ignore[no-untyped-def]
    """Compute sums over tiles of all sensors: out (4, modes + 1, tile rows, tile columns), rows first .. last - 1.

    images: ``ResidualImages`` of all sensors; which (modes,): numbers of modes. As ``line_sums``, r without the gains
    of columns (sensors, pixels) and limited to 10 sigma; the last mode is the energy: sum of r^2 / V, each at most 25,
    and pixels. Sensors alternate at each row of tiles, whose sums stay in the cache: all tiles together are as large as
    all images.
    """
    residual, weight, light, white, add, gain, of_edges = images
    sensors, lines, pixels = residual.shape
    wide = whole_groups(pixels)
    own_gains = np.zeros((sensors, 1, wide), np.float32)
    for s in range(sensors):
        copy_row(gains[s], own_gains[s, 0, :pixels])
    scratch = np.zeros((3, side, wide), np.float32)
    sums = np.empty((8, wide), np.float32)
    here = np.empty((4, which.size + 1, out.shape[3]), np.float32)
    for tile in range(first, last):
        here[:] = np.float32(0)
        begin, end = max(tile * side, 2), min((tile + 1) * side, lines - 2)
        for s in range(sensors):
            own = ResidualImages(residual[s], weight[s], light[s], white[s], add[s], gain[s], of_edges[s])
            add_tile_row(own, own_gains[s], begin, end, side, which, scratch, sums, here)
        for i in range(4):
            for mode in range(which.size + 1):
                copy_row(here[i, mode], out[i, mode, tile])


@inner_kernel(fastmath=True, error_model="numpy")
def whole_row(cyan, magenta, yellow, black, out):  # type: ignore[no-untyped-def]
    """Compute the sum of all inks' gain."""
    for x in range(cyan.size):
        out[x] = cyan[x] + magenta[x] + yellow[x] + black[x]


@inner_kernel(fastmath=True, error_model="numpy")
def gather(sums, side, out):  # type: ignore[no-untyped-def]
    """Add sums (pixels,) in tiles of ``side`` to out (tile columns,)."""
    if side == 2:
        for column in range(out.size):
            out[column] += sums[2 * column] + sums[2 * column + 1]
        return
    for column in range(out.size):
        total = np.float32(0)
        for x in range(column * side, (column + 1) * side):
            total += sums[x]
        out[column] += total
