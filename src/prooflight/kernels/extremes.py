"""Greatest numbers of rows, by their bits: loops for the greatest of whole numbers run in vectors, of others not."""

from __future__ import annotations

import numpy as np

from prooflight.kernels.compiled import inner_kernel


@inner_kernel()
def greatest_of(row):  # type: ignore[no-untyped-def]
    """Return the greatest number of a row, at least 0: numbers above 0 are ordered as their bits."""
    bits, most = row.view(np.int32), np.int32(0)
    for x in range(bits.size):
        most = max(most, bits[x])
    return np.int32(most).view(np.float32)
