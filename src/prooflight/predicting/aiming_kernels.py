"""Compiled loops of prediction: where camera pixels look on the raster, and what weights they give its pixels."""

from __future__ import annotations

import numpy as np
from numba import njit

from prooflight.predicting.summing_kernels import FEWEST, SLACK, lerp_eight

PHASES = 64
"""At least so many of a raster pixel at which weights are tabulated: between them they err by 5 / (128^2 8) of an edge,
0.004 %, at two raster pixels a camera pixel (the lens's line spread rises by at most 5 a pixel and pixel)."""


@njit(cache=True, nogil=True, error_model="numpy")
def place_row(nodes, pitch, row, places):  # type: ignore[no-untyped-def]
    """What one row sees at node columns, linear between rows of nodes (nodes down, nodes across)."""
    cell = min(row // pitch, nodes.shape[0] - 2)
    share = (row - cell * pitch) / pitch
    above, below = nodes[cell], nodes[cell + 1]
    for k in range(places.size):
        places[k] = above[k] + share * (below[k] - above[k])


@njit(cache=True, nogil=True)
def weigh(edge, step, cumulative, drift, weights, slopes):  # type: ignore[no-untyped-def]
    """Weights (taps,) of raster pixels in one footprint, and what they change by as it moves on by ``drift``.

    edge: of the first raster pixel in the footprint's cumulative spread, in its steps; step: a raster pixel's.
    """
    last = cumulative.size - 1
    before = 0.0
    spread_before = 0.0
    for t in range(weights.size):
        u = edge + (t + 1) * step
        if u >= last:
            upto = 1.0
            spread = 0.0
        else:
            i = max(int(u), 0)
            spread = cumulative[i + 1] - cumulative[i]
            upto = cumulative[i] + (max(u, 0.0) - i) * spread
        weights[t] = upto - before
        slopes[t] = (spread_before - spread) * step * drift
        before = upto
        spread_before = spread


@njit(cache=True, nogil=True)
def aim(places, pixels, segment, stride, cumulative, step, first, weights, slopes):  # type: ignore[no-untyped-def]
    """Weights of raster pixels at the middle of every segment of camera pixels, and how they change along it.

    places: where camera pixels 0, segment, 2 segment, ... look [raster pixels]. cumulative: of the footprint; step:
    its steps in a raster pixel. Written: first (segments,), the first raster pixel that the middle one,
    (start + stop) // 2, sees; weights, slopes (segments, taps): a pixel further on it is weights + slopes, of raster
    pixels ``stride`` further on.
    """
    reach = (cumulative.size - 1) / (2 * step)
    for k in range(first.size):
        start = k * segment
        middle = (start + min(start + segment, pixels)) // 2
        advance = (places[k + 1] - places[k]) / segment
        at = places[k] + advance * (middle - start) - reach
        first[k] = int(np.floor(at))
        weigh((first[k] - at) * step, step, cumulative, advance - stride, weights[k], slopes[k])


@njit(cache=True, nogil=True)
def phases(cumulative, step, taps):  # type: ignore[no-untyped-def]
    """``weigh`` at even phases of a raster pixel, 0 to 1: two ((phases + 1) x taps and ``SLACK``,), and their number.

    As many phases as the spread has steps in a raster pixel, which may be many camera pixels wide.
    """
    count = max(PHASES, int(np.ceil(step)))
    weights = np.zeros((count + 1) * taps + SLACK, np.float32)
    slopes = np.zeros(weights.size, np.float32)
    for phase in range(count + 1):
        row = slice(phase * taps, (phase + 1) * taps)
        weigh(-phase / count * step, step, cumulative, 1.0, weights[row], slopes[row])
    return weights, slopes, count


@njit(cache=True, nogil=True)
def tap_rows(segments, taps):  # type: ignore[no-untyped-def]
    """Room for the taps of each segment, (segments, taps), and the memory it lies in, which has ``SLACK``."""
    room = np.empty(segments * taps + SLACK, np.float32)
    return room[: segments * taps].reshape(segments, taps), room


@njit(cache=True, nogil=True, error_model="numpy")
def aim_between(  # type: ignore[no-untyped-def]
    places, pixels, segment, stride, reach, taps, phase_weights, phase_slopes, count, first, weights, slopes
):
    """``aim`` by linear interpolation between ``phases``, for the many segments of a page off its place.

    reach: of the footprint [raster pixels]; weights, slopes: memory of ``tap_rows``.
    """
    per = 1 / segment
    for k in range(first.size):
        start = k * segment
        middle = (start + min(start + segment, pixels)) // 2
        advance = (places[k + 1] - places[k]) * per
        at = places[k] + advance * (middle - start) - reach
        whole = np.floor(at)
        first[k] = int(whole)
        place = (at - whole) * count
        phase = min(int(place), count - 1)
        share = np.float32(place - phase)
        drift = np.float32(advance - stride)
        for t in range(0, taps, FEWEST):
            source, target = phase * taps + t, k * taps + t
            lerp_eight(phase_weights, phase_slopes, source, taps, share, drift, weights, slopes, target)
