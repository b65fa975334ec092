"""Designs in memory that all worker processes of a run share, their arrays written out while there is room."""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import threading
import weakref
from typing import TYPE_CHECKING, Final

from prooflight.errors import ProoflightError
from prooflight.inspection.prepared_store import PreparedStore, mapped_file
from prooflight.pages.memory import available_bytes

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.inspection.inspector import Inspector
    from prooflight.inspection.packed_design import PackedDesign

_log = logging.getLogger(__name__)

WRITTEN_SHARE: Final = 0.4
"""Share of the memory that is available when the run starts for designs whose arrays are written out. Writing them
takes up to a sixth of an inspection's time. Assumed: packed designs may take as much (``settings.DESIGNS_SHARE``), and
inspections need the rest."""

MADV_POPULATE_READ: Final = 22
"""Advice of madvise(2), which Python does not name, to map all pages of memory now: linux/mman.h, since Linux 5.14."""

MOST_FILES: Final = 256
"""Greatest number of designs that are written out: each is an open file of this process, which may have some 1,000."""


class SharedDesigns:
    """Files of designs; safe to use from several threads.

    A file whose arrays are written out is memory that has no name on a disk: a link leads to it while this process
    keeps it open. Each worker would otherwise write out the same arrays for itself, while a sheet waits.
    """

    def __init__(self, *, room_bytes: float | None = None) -> None:
        """Write out arrays of at most ``room_bytes``; None: by ``WRITTEN_SHARE``, where the system has such memory."""
        if room_bytes is None:
            room_bytes = WRITTEN_SHARE * available_bytes() if hasattr(os, "memfd_create") else 0
        self._room_bytes, self._room_files = room_bytes, MOST_FILES
        self._files: weakref.WeakKeyDictionary[PackedDesign, Path] = weakref.WeakKeyDictionary()
        self._releases: list[weakref.finalize[..., PackedDesign]] = []
        self._numbers, self._writing = itertools.count(), threading.Lock()

    def file(self, design: PackedDesign, inspector: Inspector, folder: Path) -> Path:
        """Return a design's file, written into ``folder`` unless it is there; it is removed with the design."""
        file = self._files.get(design)
        if file is not None:
            return file
        with self._writing:
            file = self._files.get(design)
            if file is None:
                file = self._files[design] = self._written(design, inspector, folder)
            return file

    def close(self) -> None:
        """Remove all files; workers that have read one may go on using it."""
        for release in self._releases:
            release()

    def _written(self, design: PackedDesign, inspector: Inspector, folder: Path) -> Path:
        file, size = folder / f"{next(self._numbers):06d}.design", design.written_bytes
        store = PreparedStore(folder=folder, inspector=inspector)
        # None makes room for another: of designs that come in turn, the one used longest ago is needed next.
        if 0 < size <= self._room_bytes and self._room_files:
            memory = os.memfd_create(file.name)
            try:
                _write(memory, store.encoded(design.written_out()))
                file.symlink_to(f"/proc/{os.getpid()}/fd/{memory}")
                file.stat()  # it fails where the system does not show open files
            except OSError as error:
                os.close(memory)
                file.unlink(missing_ok=True)
                self._room_files = 0
                _log.warning("designs stay packed: %s", error)
            else:
                self._room_bytes -= size
                self._room_files -= 1
                self._releases.append(weakref.finalize(design, self._release, file, memory, size))
                return file
        _write(file, store.encoded(design))
        self._releases.append(weakref.finalize(design, file.unlink, missing_ok=True))
        return file

    def _release(self, file: Path, memory: int, size: int) -> None:
        file.unlink(missing_ok=True)
        os.close(memory)
        self._room_bytes += size
        self._room_files += 1


def _write(file: Path | int, pieces: list[bytes | memoryview]) -> None:
    with open(file, "wb", closefd=not isinstance(file, int)) as opened:
        opened.writelines(pieces)


def read_design(file: Path, inspector: Inspector) -> PackedDesign:
    """Return the design in a file of ``SharedDesigns``; ProoflightError: it cannot be read."""
    try:
        mapped = mapped_file(file)
    except OSError as error:
        raise ProoflightError(f"{file}: the design cannot be read: {error}") from error
    with contextlib.suppress(OSError, AttributeError):  # an older system, or another than Linux
        mapped.madvise(MADV_POPULATE_READ)  # or the first sheet would wait some 20 ms for it
    return PreparedStore(folder=file.parent, inspector=inspector).decoded(memoryview(mapped))
