"""Exact look-up in tables over CMYK, recipe by recipe: the reference for prediction's quantised tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from prooflight.kernels.compiled import kernel
from prooflight.kernels.prediction.lookup import NODE_STEP, NODES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.prediction.tables import SensorModel

STRIDE_C, STRIDE_M, STRIDE_Y = NODES**3, NODES**2, NODES
CELL_BITS = 3
FRACTION = NODE_STEP - 1


def exact_lookup(
    cmyk: NDArray[np.uint8], sensor: SensorModel
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return mean and variance of recipes (n, 4), (n,) each [DN, DN^2], for a column gain of 1."""
    nodes = np.stack([sensor.mean_dn.ravel(), sensor.variance_dn2.ravel()], axis=1)
    mean, variance = np.empty((2, len(cmyk)), np.float32)
    lookup_row(cmyk, nodes, mean, variance)
    return mean, variance


@kernel("cmyk (N, 4), nodes (NODES**4, 2), mean (N), variance (N)")
def lookup_row(cmyk, nodes, mean, variance):  # type: ignore[no-untyped-def]
    """Look up one raster row quadrilinearly: cmyk (columns, 4) uint8, nodes (33^4, 2) -> mean, variance (columns,).

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
