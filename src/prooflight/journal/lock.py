"""Lock by which one process writes a journal at a time; it ends with the process, however that ends."""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from prooflight.journal.opening import ANOTHER, why
from prooflight.journal.schema import JournalError

if sys.platform != "win32":
    import fcntl

if TYPE_CHECKING:
    from pathlib import Path

PATIENCE_S: Final = 1.0
"""Time for which a writer tries: a reader that tests for a writer holds the lock for an instant."""
PLAIN: Final = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
"""Flags by which a link is not followed, and a pipe not waited for."""


@dataclass(frozen=True, slots=True)
class WriterLock:
    """Lock held by the process that writes."""

    handle: int

    @classmethod
    def take(cls, journal: Path) -> Self:
        """Take the lock; JournalError: another process holds it, or nothing can be written there."""
        path = _lock_file(journal)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(path, os.O_RDWR | os.O_CREAT | PLAIN, 0o666)
        except OSError as error:
            what = f"cannot be written ({why(error)}: {path.name})"
            raise JournalError(journal, what, remedy=ANOTHER) from error
        give_up = time.monotonic() + PATIENCE_S
        while not _locked(handle, alone=True):
            if time.monotonic() > give_up:
                os.close(handle)
                what = "is being written by another process"
                raise JournalError(journal, what, remedy="give this one its own with --journal")
            time.sleep(0.05)
        return cls(handle)

    def release(self) -> None:
        """Release the lock."""
        os.close(self.handle)


def writer_lives(journal: Path) -> bool:
    """Return whether some process writes this journal now."""
    try:
        handle = os.open(_lock_file(journal), os.O_RDONLY | PLAIN)
    except OSError:
        return False
    try:
        return not _locked(handle, alone=False)
    finally:
        os.close(handle)


def _lock_file(journal: Path) -> Path:
    return journal.with_name(journal.name + ".lock")


def _locked(handle: int, *, alone: bool) -> bool:
    if sys.platform == "win32":  # no such lock there: SQLite's own keeps the tables whole
        return True
    try:
        fcntl.flock(handle, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
