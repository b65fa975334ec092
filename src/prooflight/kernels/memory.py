"""Memory of large arrays that loops write, used again from sheet to sheet.

What a large array leaves goes back to the system, which clears every page of memory before it gives it again: of a
sheet's arrays that takes longer than many of the loops that fill them.
"""

from __future__ import annotations

import math
import threading
import weakref
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_PIECES: Final = 16
"""That one thread keeps; the one that was used longest ago goes."""
ROOM: Final = 1.25
"""A piece is not used for an array that needs less than this part of it."""


class _Piece(NamedTuple):
    memory: NDArray[np.uint8]
    lent: weakref.ref[NDArray[np.uint8]]
    """The array that all views of the memory hold on to: once it is gone, nobody looks at the memory any more."""


class _Kept(threading.local):
    """Each thread's own."""

    def __init__(self) -> None:
        self.pieces: list[_Piece] = []


_KEPT: Final = _Kept()


def unset(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """An array of float32 whose numbers may be any, as ``np.empty``'s, where an earlier one of this thread lay."""
    size = math.prod(shape) * np.dtype(np.float32).itemsize
    pieces = _KEPT.pieces
    for at, (memory, lent) in enumerate(pieces):
        if size <= memory.size <= ROOM * size and lent() is None:
            del pieces[at]
            break
    else:
        memory = np.empty(size, np.uint8)
        del pieces[: max(len(pieces) + 1 - MOST_PIECES, 0)]
    # Of a buffer, not of an array: views hold on to the first array of their chain, which is then this one.
    whole = np.frombuffer(memory.data, np.uint8)
    pieces.append(_Piece(memory, weakref.ref(whole)))
    return whole[:size].view(np.float32).reshape(shape)
