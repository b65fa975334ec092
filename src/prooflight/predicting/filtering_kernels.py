"""Compiled loops of prediction: weighted sums of raster rows, across and along."""

from __future__ import annotations

import numpy as np
from numba import njit

from prooflight.predicting.summing_kernels import FEW, FEWEST, MANY, sum_few, sum_fewest, sum_many


@njit(cache=True, nogil=True)
def copy_row(source, target):  # type: ignore[no-untyped-def]
    """Target = source, (n,) each: a plain loop, five times faster than what numba makes of ``target[:] = source``."""
    for i in range(target.size):
        target[i] = source[i]


@njit(cache=True, nogil=True)
def dealt_count(columns, stride, phase):  # type: ignore[no-untyped-def]
    """How many pixels of one phase a dealt row has."""
    return max((columns - phase + stride - 1) // stride, 0)


@njit(cache=True, nogil=True)
def deal_row(words, place, dealt):  # type: ignore[no-untyped-def]
    """One raster row dealt out by ``stride``, so that pixels a stride apart lie side by side: dealt (stride, places).

    Pixel p goes to dealt[p % stride, place + p // stride]; the rest stays as it was.
    """
    stride = dealt.shape[0]
    if stride == 2:  # one loop over both, which runs in vectors
        pairs = words.size // 2
        evens, odds = dealt[0, place : place + pairs], dealt[1, place : place + pairs]
        for i in range(pairs):
            evens[i] = words[2 * i]
            odds[i] = words[2 * i + 1]
        if words.size > 2 * pairs:
            dealt[0, place + pairs] = words[2 * pairs]
        return
    for phase in range(stride):
        count = dealt_count(words.size, stride, phase)
        target, source = dealt[phase, place : place + count], words[phase::stride]
        for i in range(count):
            target[i] = source[i]


@njit(cache=True, nogil=True)
def add_weighted(source, weight, slope, origin, target):  # type: ignore[no-untyped-def]
    """Target += (weight + slope x (i - origin)) x source, one array at a time so that it runs in vectors."""
    if slope == 0:
        for i in range(target.size):
            target[i] += weight * source[i]
    else:
        weight -= slope * np.float32(origin)
        for i in range(target.size):
            target[i] += (weight + slope * np.float32(i)) * source[i]


@njit(cache=True, nogil=True)
def any_drift(slopes):  # type: ignore[no-untyped-def]
    """Whether weights change along a segment."""
    steepest = np.float32(0)
    for t in range(slopes.size):
        steepest = max(steepest, abs(slopes[t]))
    return steepest != 0


@njit(cache=True, nogil=True)
def filter_across(split, pad, columns, segment, first, weights, slopes, starts, out):  # type: ignore[no-untyped-def]
    """One raster row at camera columns: split as ``deal_row`` deals, weights as ``aim`` does; out (pixels,).

    What is off the page counts as 0, the level of the backing. starts (taps,) int64 is working space.
    """
    stride, width = split.shape
    taps = weights.shape[1]
    flat = split.reshape(-1)
    out[:] = 0
    for k in range(first.size):
        start = k * segment
        stop = min(start + segment, out.size)
        middle = (start + stop) // 2
        # Pixel i sees raster pixels from first + stride (i - middle); only those that touch the row are done.
        start = max(start, middle - (first[k] + taps - 1) // stride)
        stop = min(stop, middle + (columns - 1 - first[k]) // stride + 1)
        if start >= stop:
            continue
        place = first[k] + pad
        phase, at = place % stride, place // stride - middle
        for t in range(taps):  # counted on: a division for each tap would take longer than the sums
            starts[t] = phase * width + at
            phase += 1
            if phase == stride:
                phase, at = 0, at + 1
        drifts = any_drift(slopes[k])
        of, by = weights[k], slopes[k]
        while start + MANY <= stop:
            sum_many(flat, starts, start, of, by, 0, taps, start - middle, drifts, out, start)
            start += MANY
        while start + FEW <= stop:
            sum_few(flat, starts, start, of, by, 0, taps, start - middle, drifts, out, start)
            start += FEW
        if start + FEWEST <= stop:
            sum_fewest(flat, starts, start, of, by, 0, taps, start - middle, drifts, out, start)
            start += FEWEST
        if start < stop:
            for t in range(taps):
                source = flat[starts[t] + start : starts[t] + stop]
                add_weighted(source, weights[k, t], slopes[k, t], middle - start, out[start:stop])


@njit(cache=True, nogil=True)
def filter_along(ring, rows, segment, first, weights, slopes, starts, out):  # type: ignore[no-untyped-def]
    """One line from the ring of filtered rows (depth, pixels), row r at r % depth; out (pixels,).

    Rows off the page, below 0 or from ``rows`` on, count as 0, the level of the backing. starts (taps,) int64 is
    working space.
    """
    depth, pixels = ring.shape
    flat = ring.reshape(-1)
    out[:] = 0
    for k in range(first.size):
        start = k * segment
        stop = min(start + segment, pixels)
        middle = (start + stop) // 2
        t_first = max(-first[k], 0)
        t_last = min(weights.shape[1], rows - first[k])
        slot = (first[k] + t_first) % depth
        for t in range(t_first, t_last):
            starts[t] = slot * pixels
            slot = slot + 1 if slot + 1 < depth else 0
        drifts = any_drift(slopes[k])
        of, by = weights[k], slopes[k]
        while start + MANY <= stop:
            sum_many(flat, starts, start, of, by, t_first, t_last, start - middle, drifts, out, start)
            start += MANY
        while start + FEW <= stop:
            sum_few(flat, starts, start, of, by, t_first, t_last, start - middle, drifts, out, start)
            start += FEW
        if start + FEWEST <= stop:
            sum_fewest(flat, starts, start, of, by, t_first, t_last, start - middle, drifts, out, start)
            start += FEWEST
        if start < stop:
            for t in range(t_first, t_last):
                source = flat[starts[t] + start : starts[t] + stop]
                add_weighted(source, weights[k, t], slopes[k, t], middle - start, out[start:stop])
