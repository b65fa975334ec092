"""Compiled loops of prediction: weighted sums of raster rows, across and along."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel
from prooflight.kernels.prediction.summing import (
    EIGHT,
    FEW,
    FEWEST,
    MANY,
    dot_eight,
    sum_few,
    sum_fewest,
    sum_many,
)


@inner_kernel()
def copy_row(source, target):  # type: ignore[no-untyped-def]
    """Copy source to target, (n,) each: a plain loop, five times faster than numba's ``target[:] = source``.

    It also compiles sooner: numba compiles the text of an error of shapes with each assignment of an array, in 2 s.
    """
    for i in range(target.size):
        target[i] = source[i]


@inner_kernel()
def dealt_count(columns, stride, phase):  # type: ignore[no-untyped-def]
    """Return the number of pixels of one phase in a dealt row."""
    return max((columns - phase + stride - 1) // stride, 0)


@inner_kernel()
def deal_row(packed, place, dealt):  # type: ignore[no-untyped-def]
    """Deal one raster row out by ``stride``, so that pixels a stride apart are adjacent: dealt (stride, places).

    Pixel p goes to dealt[p % stride, place + p // stride]; the rest is unchanged.
    """
    stride = dealt.shape[0]
    if stride == 2:  # one loop over both, which runs in vectors
        pairs = packed.size // 2
        evens, odds = dealt[0, place : place + pairs], dealt[1, place : place + pairs]
        for i in range(pairs):
            evens[i] = packed[2 * i]
            odds[i] = packed[2 * i + 1]
        if packed.size > 2 * pairs:
            dealt[0, place + pairs] = packed[2 * pairs]
        return
    for phase in range(stride):
        count = dealt_count(packed.size, stride, phase)
        target, source = dealt[phase, place : place + count], packed[phase::stride]
        for i in range(count):
            target[i] = source[i]


@inner_kernel()
def sum_row(source, starts, weights, first, last, start, stop, out):  # type: ignore[no-untyped-def]
    """Add sum over t, first <= t < last, of weights[t] source[starts[t] + i] to out[i], start <= i < stop."""
    while start + MANY <= stop:
        sum_many(source, starts, start, weights, first, last, out, start)
        start += MANY
    while start + FEW <= stop:
        sum_few(source, starts, start, weights, first, last, out, start)
        start += FEW
    if start + FEWEST <= stop:
        sum_fewest(source, starts, start, weights, first, last, out, start)
        start += FEWEST
    for i in range(start, stop):
        for t in range(first, last):
            out[i] += weights[t] * source[starts[t] + i]


@inner_kernel()
def filter_across(split, pad, columns, first, weights, starts, out):  # type: ignore[no-untyped-def]
    """Filter one raster row at camera columns: split as from ``deal_row``, weights (taps,); out (pixels,).

    first: the first raster pixel that camera pixel 0 sees; pixels off the page count as 0, the level of the
    backing. starts (taps,) int64 is working space.
    """
    stride, width = split.shape
    taps = weights.size
    out[:] = 0
    # Pixel i sees raster pixels from first + stride i; only those that touch the row are computed.
    start = max(0, -((first + taps - 1) // stride))
    stop = min(out.size, (columns - 1 - first) // stride + 1)
    if start >= stop:
        return
    place = first + pad
    phase, at = place % stride, place // stride
    for t in range(taps):  # counted on: a division for each tap would take longer than the sums
        starts[t] = phase * width + at
        phase += 1
        if phase == stride:
            phase, at = 0, at + 1
    sum_row(split.reshape(-1), starts, weights, 0, taps, start, stop, out)


@inner_kernel()
def filter_along(ring, rows, first, weights, starts, out):  # type: ignore[no-untyped-def]
    """Filter one line, out (pixels,), from row ``first`` on of a ring of filtered rows (depth, pixels).

    Row r is at r % depth. Rows off the page, below 0 or from ``rows`` on, count as 0, the level of the
    backing. starts (taps,) int64 is working space.
    """
    depth, pixels = ring.shape
    out[:] = 0
    t_first = max(-first, 0)
    t_last = min(weights.size, rows - first)
    slot = (first + t_first) % depth
    for t in range(t_first, t_last):
        starts[t] = slot * pixels
        slot = slot + 1 if slot + 1 < depth else 0
    sum_row(ring.reshape(-1), starts, weights, t_first, t_last, 0, pixels, out)


@inner_kernel()
def filter_row(source, starts, table, weights_at, taps, out):  # type: ignore[no-untyped-def]
    """Set out[i] = sum over t < taps of table[weights_at[i] + t] source[starts[i] + t]; out (pixels,)."""
    whole = out.size // EIGHT * EIGHT
    for at in range(0, whole, EIGHT):
        dot_eight(source, starts, table, weights_at, taps, out, at)
    for i in range(whole, out.size):
        total = np.float32(0)
        for t in range(taps):
            total += table[weights_at[i] + t] * source[starts[i] + t]
        out[i] = total
