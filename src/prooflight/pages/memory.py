"""Available memory, and limits of the memory that a file may need, checked before anything of it is decoded."""

from __future__ import annotations

import contextlib
import ctypes
import math
import stat
from pathlib import Path
from typing import Final

from prooflight.errors import InputError, JobError

MODEST_BYTES: Final = 2 * 2**30
"""Memory that any file may need to be read."""
MEGAPIXELS_MAX: Final = 400
"""Largest size of a page; assumed: A0 at 482 dpi has 360."""
BYTES_PER_FILE_BYTE: Final = 64
"""Memory that a larger file may need, per byte of the file: a highly compressed JPEG stores four pixels in
a byte, and reading takes up to 16 bytes for each. Files that declare more are made to exhaust memory."""
TRIM_THRESHOLD, MMAP_MAX, ARENA_MAX = -1, -4, -8
"""Parameter numbers of glibc's mallopt(3)."""
RETAINED_BYTES: Final = 2**31 - 1


def available_bytes(root: Path = Path("/")) -> float:
    """Return the memory that is available without swapping, to a container what its limit leaves.

    Infinite if the system does not report it. root: of the system's files.
    """
    free = left = math.inf
    with contextlib.suppress(OSError):
        for line in (root / "proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                free = float(line.split()[1]) * 1024
    # Control groups, version 2 (Linux, admin-guide/cgroup-v2): "max" is no limit, and files may be dropped.
    with contextlib.suppress(OSError, ValueError):
        limit, used, facts = (
            (root / "sys/fs/cgroup" / name).read_text()
            for name in ("memory.max", "memory.current", "memory.stat")
        )
        files = dict(line.split() for line in facts.splitlines()).get("inactive_file", 0)
        left = max(float(limit) - float(used) + float(files), 0.0)
    return min(free, left)


def refuse_oversize(where: object, rows: int, columns: int) -> None:
    """Raise JobError, before anything is allocated, if a page has more than 400 megapixels."""
    megapixels = rows * columns / 1e6
    if megapixels > MEGAPIXELS_MAX:
        what = f"{columns} x {rows} pixels are {megapixels:.0f} megapixels"
        raise JobError(where, what, remedy=f"at most {MEGAPIXELS_MAX}: lower the resolution or cut the page")


def refuse_unaffordable(
    refused: type[InputError], where: object, pixels: str, *, needed_bytes: float, file_bytes: int
) -> None:
    """Raise ``refused``, before anything is allocated, if an image needs more than its file or memory allow.

    ``pixels`` is its size, for people.
    """
    allowed, free = max(MODEST_BYTES, BYTES_PER_FILE_BYTE * file_bytes), available_bytes()
    if needed_bytes > allowed:
        what = f"{pixels} need {needed_bytes / 1e9:.1f} GB, in a file of {file_bytes / 1e6:.3g} MB"
        raise refused(where, what, remedy="export or copy it again: no image of this kind is so large")
    if needed_bytes > free:
        what = f"{pixels} need {needed_bytes / 1e9:.1f} GB"
        raise refused(where, what, remedy=f"{free / 1e9:.1f} GB of memory are free: lower the resolution")


def file_stamp(path: Path) -> list[int]:
    """Return values that distinguish a file from one that replaces it."""
    facts = path.stat()
    return [facts.st_ino, facts.st_mtime_ns, facts.st_size]


def file_head(path: Path, refused: type[InputError], size: int) -> bytes:
    """Return the first bytes of a file, at most ``size``; ``refused`` as by ``file_size``."""
    file_size(path, refused)
    with path.open("rb") as file:  # OSError for what the system cannot open
        return file.read(size)


def file_size(path: Path, refused: type[InputError]) -> int:
    """Return the size of a file [bytes].

    ``refused`` is raised if it is a pipe, a device or a folder, which could not be read to its end.
    """
    facts = path.stat()  # OSError for what the system cannot open
    if not stat.S_ISREG(facts.st_mode):
        raise refused(path, "is not a file", remedy="give a file, not a folder, pipe or device")
    return facts.st_size


def keep_memory() -> None:
    """Keep freed memory for the next page; if it is returned and requested again, the system clears it each time.

    This applies to the whole process. If the C library is not glibc, nothing changes.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for name, value in ((TRIM_THRESHOLD, RETAINED_BYTES), (MMAP_MAX, 0), (ARENA_MAX, 1)):
            mallopt(name, value)
