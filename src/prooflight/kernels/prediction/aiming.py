"""Compiled loops of prediction: positions of camera pixels on the raster, and the weights of its pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from prooflight.kernels.compiled import inner_kernel, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray


class FilterPass(NamedTuple):
    """One of the two passes of filtering: its sampling positions and its footprint."""

    places: NDArray[np.float64]
    """Positions as in ``Nodes`` of a sampling grid, (nodes down, nodes across). [raster pixels]"""
    pitch: int
    """Rows between nodes."""
    segment: int
    """Columns between nodes."""
    cumulative: NDArray[np.float64]
    """Cumulative spread of the ``Footprint``, (2 n + 1,)."""
    step: float
    """Size of a raster pixel in steps of that."""


@inner_kernel(error_model="numpy")
def place_row(nodes, pitch, row, places):  # type: ignore[no-untyped-def]
    """Interpolate the positions of one row at node columns, linear between rows of nodes (nodes down, nodes across)."""
    cell = min(row // pitch, nodes.shape[0] - 2)
    share = (row - cell * pitch) / pitch
    above, below = nodes[cell], nodes[cell + 1]
    for k in range(places.size):
        places[k] = above[k] + share * (below[k] - above[k])


@inner_kernel()
def footprint_weights(edge, step, cumulative, weights):  # type: ignore[no-untyped-def]
    """Compute the weights (taps,) of raster pixels in one footprint.

    edge: position of the first raster pixel in the footprint's cumulative spread, in its steps; step: a
    raster pixel's.
    """
    last = cumulative.size - 1
    before = 0.0
    for t in range(weights.size):
        u = edge + (t + 1) * step
        if u >= last:
            upto = 1.0
        else:
            i = max(int(u), 0)
            upto = cumulative[i] + (max(u, 0.0) - i) * (cumulative[i + 1] - cumulative[i])
        weights[t] = upto - before
        before = upto


@inner_kernel()
def aim(place, cumulative, step, weights):  # type: ignore[no-untyped-def]
    """Compute weights (taps,) in a footprint about ``place`` [raster pixels]; return the first raster pixel."""
    begin = place - (cumulative.size - 1) / (2 * step)
    first = int(np.floor(begin))
    footprint_weights((first - begin) * step, step, cumulative, weights)
    return first


@inner_kernel()
def whole_eights(count):  # type: ignore[no-untyped-def]
    """Return the least multiple of eight that is no less."""
    return (count + 7) // 8 * 8


@inner_kernel(error_model="numpy")
def aim_each(across, taps, beyond, first, weights_at):  # type: ignore[no-untyped-def]
    """Run ``aim`` at every camera pixel of the first row of a pass; return weights (pixels x taps,).

    Other arguments are as in ``begin_row``.
    """
    places, segment, cumulative, step = across.places[0], across.segment, across.cumulative, across.step
    reach = (cumulative.size - 1) / (2 * step)
    table = np.empty(first.size * taps, np.float32)
    for i in range(first.size):
        k = i // segment
        begin = places[k] + (places[k + 1] - places[k]) * ((i - k * segment) / segment) - reach
        whole = int(np.floor(begin))
        footprint_weights((whole - begin) * step, step, cumulative, table[i * taps : (i + 1) * taps])
        first[i] = min(max(whole + taps, 0), beyond + taps)
        weights_at[i] = i * taps
    return table


@inner_kernel()
def weights_at_phases(cumulative, step, count, taps):  # type: ignore[no-untyped-def]
    """Return weights of raster pixels in footprints that begin 0, 1 / count, ..., 1 into one: (count + 1, taps)."""
    table = np.empty((count + 1, taps), np.float32)
    for phase in range(count + 1):
        footprint_weights(-phase / count * step, step, cumulative, table[phase])
    return table


@inner_kernel()
def derivatives(table):  # type: ignore[no-untyped-def]
    """Return the change of weights (phases + 1, taps) from each phase to the next."""
    changes = np.empty_like(table)
    last = table.shape[0] - 1
    for phase in range(last + 1):
        low, high = max(phase - 1, 0), min(phase + 1, last)
        for t in range(table.shape[1]):
            changes[phase, t] = (table[high, t] - table[low, t]) / np.float32(max(high - low, 1))
    return changes


@kernel("cumulative (_), step, count, taps")
def phase_weights(cumulative, step, count, taps):  # type: ignore[no-untyped-def]
    """Return ``weights_at_phases``, for callers that are not compiled."""
    return weights_at_phases(cumulative, step, count, taps)


@inner_kernel(error_model="numpy")
def begin_row(places, reach, bits, taps, beyond, first, weights_at):  # type: ignore[no-untyped-def]
    """Compute where the footprint of every camera pixel of a row begins, and its weights in ``weights_at_phases``.

    places: of camera pixels 0, segment, 2 segment, ..., linear between. reach: of the footprint [raster
    pixels]; beyond: the first raster pixel past the page. Written: first, raster pixels from ``taps`` before
    the page on, so that none is below 0; weights_at; (segments, segment) int32 each. Footprints off the page
    begin anywhere off it.
    """
    count, last = np.float32(1 << bits), np.int32(beyond + taps)
    mask, per, wide = np.int32((1 << bits) - 1), np.int32(bits), np.int32(taps)
    none, per_pixel = np.int32(0), count / first.shape[1]
    for k in range(places.size - 1):
        firsts, ats = first[k], weights_at[k]
        begin = places[k] - reach
        whole = np.floor(begin)
        base = np.int32(min(max(whole, -1e6), 1e6)) + wide
        at = np.float32((begin - whole) * count + 0.5)
        advance = np.float32((places[k + 1] - places[k]) * per_pixel)
        for i in range(firsts.size):
            place = np.int32(np.floor(at + advance * np.float32(i)))
            firsts[i] = min(max(np.int32(base + np.int32(place >> per)), none), last)
            ats[i] = np.int32(np.int32(place & mask) * wide)
