"""Which bytes of a block did not arrive, where the library that fills the block does not say."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.rng import stream
from prooflight.scans.lines import runs

if TYPE_CHECKING:
    from numpy.typing import NDArray

WORD: Final = 4
"""Bytes; packets of GigE Vision hold a multiple of so many, but for a block's last."""


class Canary:
    """Random words that stand in a buffer before it is filled: where they still stand, nothing arrived.

    Two words in a row are the same by chance once in 2^64; a packet has 45 words and more.
    """

    def __init__(self, size: int) -> None:
        """size: of a block. [bytes]"""
        self._size = size
        # Whatever it is, it must only be unlike what a camera sends, and the same in every run.
        self._words = stream(size, "block-canary").integers(0, 1 << 32, -(-size // WORD), np.uint32)

    def buffer(self) -> NDArray[np.uint8]:
        """A new buffer for a block, (size,), ready to be filled."""
        whole = np.empty(self._words.size, np.uint32)
        one = whole.view(np.uint8)[: self._size]
        self.write(one)
        return one

    def write(self, buffer: NDArray[np.uint8]) -> None:
        """Make a buffer ready to be filled again."""
        buffer[:] = self._words.view(np.uint8)[: self._size]

    def missing(self, buffer: NDArray[np.uint8]) -> tuple[tuple[int, int], ...]:
        """First and behind the last byte of each part of a buffer that was not filled."""
        whole = self._size // WORD
        same = np.zeros(whole + 1, bool)
        same[:whole] = buffer[: whole * WORD].view(np.uint32) == self._words[:whole]
        rest = slice(whole * WORD, self._size)
        same[whole] = rest.start < rest.stop and np.array_equal(
            buffer[rest], self._words.view(np.uint8)[rest]
        )
        return tuple(
            (first * WORD, min(end * WORD, self._size))
            for first, end in runs(same)
            if end - first > 1 or end * WORD >= self._size
        )
