"""Detection of bytes of a block that did not arrive, for libraries that do not report them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.rng import stream
from prooflight.scans.lines import runs

if TYPE_CHECKING:
    from numpy.typing import NDArray

BYTES_PER_NUMBER: Final = 4
"""Size of a word in bytes; packets of GigE Vision have a multiple of it, except for a block's last."""


class Canary:
    """Random words that are written to a buffer before it is filled; where they remain, nothing arrived.

    Two words in a row match by chance once in 2^64; a packet has 45 words and more.
    """

    def __init__(self, size: int) -> None:
        """Draw the words of a block of ``size`` bytes."""
        self._size = size
        # The words need only differ from what a camera sends, and be the same in every run.
        self._numbers = stream(size, "block-canary").integers(
            0, 1 << 32, -(-size // BYTES_PER_NUMBER), np.uint32
        )

    def buffer(self) -> NDArray[np.uint8]:
        """Return a new buffer for a block, (size,), ready to be filled."""
        whole = np.empty(self._numbers.size, np.uint32)
        one = whole.view(np.uint8)[: self._size]
        self.write(one)
        return one

    def write(self, buffer: NDArray[np.uint8]) -> None:
        """Prepare a buffer to be filled again."""
        buffer[:] = self._numbers.view(np.uint8)[: self._size]

    def missing(self, buffer: NDArray[np.uint8]) -> tuple[tuple[int, int], ...]:
        """Return the first byte, and the one after the last, of each part of a buffer that was not filled."""
        whole = self._size // BYTES_PER_NUMBER
        same = np.zeros(whole + 1, bool)
        same[:whole] = buffer[: whole * BYTES_PER_NUMBER].view(np.uint32) == self._numbers[:whole]
        rest = slice(whole * BYTES_PER_NUMBER, self._size)
        same[whole] = rest.start < rest.stop and np.array_equal(
            buffer[rest], self._numbers.view(np.uint8)[rest]
        )
        return tuple(
            (first * BYTES_PER_NUMBER, min(end * BYTES_PER_NUMBER, self._size))
            for first, end in runs(same)
            if end - first > 1 or end * BYTES_PER_NUMBER >= self._size
        )
