"""Reuse of the memory of large arrays that loops write, from sheet to sheet.

The memory of a large array is returned to the system, which clears every page of memory before it is used
again: for a sheet's arrays that takes longer than many of the loops that fill them.

Arrays begin at other places of a page of memory. The system begins all large ones at the same, where loops over several
images evict from the processor's cache what they need next: it has room for eight pieces of the same place.
"""

from __future__ import annotations

import math
import threading
import weakref
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_PIECES: Final = 16
"""Number of pieces that one thread stores; the least recently used is dropped."""
ROOM: Final = 1.25
"""Greatest ratio of a piece's size to that of an array for which it is used."""
MEMORY_PAGE: Final = 4096
OFFSET: Final = 5 * 64
"""Distance of the beginnings of pieces, in whole lines of the cache. [bytes]"""


class _Piece(NamedTuple):
    memory: NDArray[np.uint8]
    lent: weakref.ref[NDArray[np.uint8]]
    """The base array of all views of the memory: once it is collected, the memory is free."""


class _Pool(threading.local):
    """Pieces of each thread."""

    def __init__(self) -> None:
        self.pieces: list[_Piece] = []
        self.made = 0


_POOL: Final = _Pool()


def unset(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return an uninitialised array of float32, in memory that an earlier one of this thread has left if possible."""
    size = math.prod(shape) * np.dtype(np.float32).itemsize
    pieces = _POOL.pieces
    for at, (memory, lent) in enumerate(pieces):
        if size <= memory.size <= ROOM * size and lent() is None:
            del pieces[at]
            break
    else:
        room = np.empty(size + MEMORY_PAGE, np.uint8)
        begin = (OFFSET * _POOL.made - room.ctypes.data) % MEMORY_PAGE
        memory = room[begin : begin + size]
        _POOL.made += 1
        del pieces[: max(len(pieces) + 1 - MOST_PIECES, 0)]
    # A buffer is used, not an array: views refer to the first array of their chain, which is then this one.
    whole = np.frombuffer(memory.data, np.uint8)
    pieces.append(_Piece(memory, weakref.ref(whole)))
    return whole[:size].view(np.float32).reshape(shape)
