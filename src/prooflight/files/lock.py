"""Lock by which one process writes a file at a time; it ends with the process, however that ends."""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

if sys.platform != "win32":
    import fcntl

if TYPE_CHECKING:
    from prooflight.errors import InputError

PATIENCE_S: Final = 1.0
"""Time for which a writer tries: a reader that tests for a writer holds the lock for an instant."""
PLAIN: Final = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
"""Flags by which a link is not followed, and a pipe not waited for."""


@dataclass(frozen=True, slots=True)
class WriterLock:
    """Lock held by the process that writes."""

    handle: int

    @classmethod
    def take(cls, file: Path, *, error: type[InputError], wait: str, elsewhere: str) -> Self:
        """Take the lock of a file.

        Parameters
        ----------
        error : kind of error if the lock cannot be taken
        wait : remedy if another process holds it
        elsewhere : remedy if nothing can be written there
        """
        path = _lock_file(file)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(path, os.O_RDWR | os.O_CREAT | PLAIN, 0o666)
        except OSError as fault:
            why = (fault.strerror or str(fault)).lower()
            raise error(file, f"cannot be written ({why}: {path.name})", remedy=elsewhere) from fault
        give_up = time.monotonic() + PATIENCE_S
        while not _locked(handle, alone=True):
            if time.monotonic() > give_up:
                os.close(handle)
                raise error(file, "is being written by another process", remedy=wait)
            time.sleep(0.05)
        return cls(handle)

    def release(self) -> None:
        """Release the lock."""
        os.close(self.handle)


def writer_lives(file: Path) -> bool:
    """Return whether some process holds the lock of this file now."""
    try:
        handle = os.open(_lock_file(file), os.O_RDONLY | PLAIN)
    except OSError:
        return False
    try:
        return not _locked(handle, alone=False)
    finally:
        os.close(handle)


def _lock_file(file: Path) -> Path:
    return file.with_name(file.name + ".lock")


def _locked(handle: int, *, alone: bool) -> bool:
    if sys.platform == "win32":  # no such lock there: SQLite's own keeps the tables whole
        return True
    try:
        fcntl.flock(handle, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
