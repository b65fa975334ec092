"""Memory that stays with the process from page to page."""

from __future__ import annotations

import ctypes
from typing import Final

TRIM_THRESHOLD, MMAP_MAX, ARENA_MAX = -1, -4, -8
"""Parameter numbers of glibc's mallopt(3)."""
RETAINED_BYTES: Final = 2**31 - 1


def keep_memory() -> None:
    """Keep freed memory for the next page; if it is returned and requested again, the system clears it each time.

    This applies to the whole process. If the C library is not glibc, nothing changes.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for name, value in ((TRIM_THRESHOLD, RETAINED_BYTES), (MMAP_MAX, 0), (ARENA_MAX, 1)):
            mallopt(name, value)
