"""Memory that stays with the process from page to page."""

from __future__ import annotations

import ctypes
from typing import Final

TRIM_THRESHOLD, MMAP_MAX, ARENA_MAX = -1, -4, -8
"""Names of glibc's mallopt(3)."""
KEPT_BYTES: Final = 2**31 - 1


def keep_memory() -> None:
    """Keep freed memory for the next page: given back and asked for again, the system clears it each time.

    For the whole process; where the C library is not glibc, memory stays as it was.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for name, value in ((TRIM_THRESHOLD, KEPT_BYTES), (MMAP_MAX, 0), (ARENA_MAX, 1)):
            mallopt(name, value)
