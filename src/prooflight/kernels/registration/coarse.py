"""Compiled loop of the coarse search: reduction of a scan."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import kernel

SHRINK = 8
"""Camera pixels in a coarse pixel, either way: 0.84 mm. Known to the compiler, so that loops run in
vectors."""


@kernel("image (L, P), means (L // SHRINK, P // SHRINK)")
def square_means(image, means):  # type: ignore[no-untyped-def]
    """Compute means over whole squares of 8 x 8 pixels of image (lines, pixels): means (rows, columns) float32."""
    share = np.float32(1 / SHRINK**2)
    columns = np.empty(means.shape[1] * SHRINK, np.float32)
    for row in range(means.shape[0]):
        columns[:] = 0
        for line in range(row * SHRINK, (row + 1) * SHRINK):
            source = image[line, : columns.size]
            for i in range(columns.size):
                columns[i] += np.float32(source[i])
        out = means[row]
        for square in range(out.size):
            at = SHRINK * square
            left = (columns[at] + columns[at + 1]) + (columns[at + 2] + columns[at + 3])
            right = (columns[at + 4] + columns[at + 5]) + (columns[at + 6] + columns[at + 7])
            out[square] = share * (left + right)
