"""Compiled loops of prediction: look up, filter and area-sample a page line by line, in constant memory."""

from __future__ import annotations

import numpy as np
from numba import njit

from prooflight.predicting.tables import NODE_STEP, NODES

STRIDE_C, STRIDE_M, STRIDE_Y = NODES**3, NODES**2, NODES
CELL_BITS = 3
FRACTION = NODE_STEP - 1


@njit(cache=True, nogil=True)
def look_up_row(cmyk, nodes, mean, variance):  # type: ignore[no-untyped-def]
    """Quadrilinear look-up of one raster row: cmyk (columns, 4) uint8, nodes (33^4, 2) -> mean, variance (columns,).

    A run of equal pixels is looked up once: half of every page is paper.
    """
    m = np.float32(0.0)
    v = np.float32(0.0)
    for x in range(cmyk.shape[0]):
        c, g, y, k = cmyk[x, 0], cmyk[x, 1], cmyk[x, 2], cmyk[x, 3]
        if x == 0 or c != cmyk[x - 1, 0] or g != cmyk[x - 1, 1] or y != cmyk[x - 1, 2] or k != cmyk[x - 1, 3]:
            base = (
                (c >> CELL_BITS) * STRIDE_C
                + (g >> CELL_BITS) * STRIDE_M
                + (y >> CELL_BITS) * STRIDE_Y
                + (k >> CELL_BITS)
            )
            fc = np.float32(c & FRACTION) / np.float32(NODE_STEP)
            fm = np.float32(g & FRACTION) / np.float32(NODE_STEP)
            fy = np.float32(y & FRACTION) / np.float32(NODE_STEP)
            fk = np.float32(k & FRACTION) / np.float32(NODE_STEP)
            m = np.float32(0.0)
            v = np.float32(0.0)
            for corner in range(16):
                weight = fc if corner & 8 else np.float32(1) - fc
                weight *= fm if corner & 4 else np.float32(1) - fm
                weight *= fy if corner & 2 else np.float32(1) - fy
                weight *= fk if corner & 1 else np.float32(1) - fk
                if weight > 0:
                    node = (
                        base
                        + (corner >> 3) * STRIDE_C
                        + ((corner >> 2) & 1) * STRIDE_M
                        + ((corner >> 1) & 1) * STRIDE_Y
                        + (corner & 1)
                    )
                    m += weight * nodes[node, 0]
                    v += weight * nodes[node, 1]
        mean[x] = m
        variance[x] = v


@njit(cache=True, nogil=True)
def sample_row(row, first, weights, out):  # type: ignore[no-untyped-def]
    """Weighted sums of a row at every camera pixel: taps as in ``pages.sampling.Taps``."""
    for i in range(first.size):
        total = np.float32(0.0)
        start = first[i]
        for t in range(weights.shape[1]):
            total += weights[i, t] * row[start + t]
        out[i] = total


@njit(cache=True, nogil=True)
def predict_lines(  # type: ignore[no-untyped-def]
    cmyk,
    nodes,
    across_first,
    across_weights,
    along_first,
    along_weights,
    backing_mean,
    backing_variance,
    column_offset,
    column_gain,
    dark_variance,
    top_code,
    line_from,
    line_to,
    expected,
    variance,
):
    """Expected DN and temporal variance of scan lines line_from .. line_to - 1 of one sensor.

    cmyk (rows, columns, 4) uint8; expected, variance (lines, pixels) float32 are written at those lines only, so bands
    may run in several threads. Rows pass once through a ring of as many filtered rows as there are taps along.
    """
    pixels = across_first.size
    reach = along_weights.shape[1]
    mean_row = np.empty(cmyk.shape[1], np.float32)
    variance_row = np.empty(cmyk.shape[1], np.float32)
    ring_mean = np.empty((reach, pixels), np.float32)
    ring_variance = np.empty((reach, pixels), np.float32)
    across_cover = np.empty(pixels, np.float32)
    for i in range(pixels):
        across_cover[i] = across_weights[i].sum()
    next_row = along_first[line_from]
    for line in range(line_from, line_to):
        top = along_first[line]
        next_row = max(next_row, top)
        while next_row < top + reach:
            look_up_row(cmyk[next_row], nodes, mean_row, variance_row)
            sample_row(mean_row, across_first, across_weights, ring_mean[next_row % reach])
            sample_row(variance_row, across_first, across_weights, ring_variance[next_row % reach])
            next_row += 1
        out_mean = expected[line]
        out_variance = variance[line]
        cover = along_weights[line].sum()
        for i in range(pixels):
            off_page = np.float32(1) - cover * across_cover[i]
            out_mean[i] = off_page * backing_mean
            out_variance[i] = off_page * backing_variance
        for t in range(reach):
            weight = along_weights[line, t]
            if weight != 0:
                slot = (top + t) % reach
                for i in range(pixels):
                    out_mean[i] += weight * ring_mean[slot, i]
                    out_variance[i] += weight * ring_variance[slot, i]
        for i in range(pixels):
            out_mean[i] = min(max(column_offset[i] + column_gain[i] * out_mean[i], np.float32(0)), top_code)
            out_variance[i] = dark_variance + column_gain[i] * (out_variance[i] - dark_variance)
