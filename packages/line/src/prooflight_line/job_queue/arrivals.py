"""Arrival of files: which of those in a folder are whole, and when to look again."""

from __future__ import annotations

import fcntl
import os
import signal
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

UNFINISHED: Final = (".part", ".partial", ".tmp", ".temp", ".filepart", ".crdownload", ".download", "~")
"""Endings of names under which programs write files that they rename when these are whole."""
POLL_S: Final = 1.0
"""Time between two looks at the folder where the system does not report changes."""
IDLE_S: Final = 10.0
"""Longest time between two looks where it does: it reports nothing that another machine changes on a share."""

State = tuple[int, int, int]
"""Inode, size [bytes] and time of the last change [ns] of a file."""


@dataclass(slots=True, kw_only=True)
class Arrivals:
    """Files of a folder as they arrive."""

    folder: Path
    settle_s: float
    """Time for which a file must not change before it is whole."""
    clock: Callable[[], float] = time.monotonic
    _since: dict[str, tuple[State, float]] = field(default_factory=dict)
    """State of each file, and since when it has been so."""
    _whole: frozenset[str] = frozenset()
    """Names of the files that were whole when last looked at."""
    _changes: Iterator[object] | None = None

    @property
    def pending(self) -> list[str]:
        """Names of the files that were not whole when last looked at."""
        return sorted(self._since.keys() - self._whole)

    def whole(self) -> list[str]:
        """Return the names of files that are whole, the one that was changed first at first.

        A file is whole when it has not changed for ``settle_s``, and no process of this machine has it open for
        writing. Names that begin with a dot or have an ending of ``UNFINISHED``, and folders, are passed over.
        """
        before, now, ready = self._since, self.clock(), list[tuple[int, str]]()
        self._since = {}
        for path in sorted(self.folder.iterdir()):
            name = path.name
            if name.startswith(".") or name.lower().endswith(UNFINISHED):
                continue
            try:
                state = state_of(path)
            except FileNotFoundError:
                continue
            if state is None:
                continue
            earlier = before.get(name)
            since = now if earlier is None or earlier[0] != state else earlier[1]
            self._since[name] = (state, since)
            if now - since >= self.settle_s and not being_written(path):
                ready.append((state[2], name))
        self._whole = frozenset(name for _, name in ready)
        return [name for _, name in sorted(ready)]

    def wait(self) -> None:
        """Wait until there may be something new."""
        if self.pending:
            time.sleep(min(POLL_S, max(self.settle_s / 4, 0.01)))
        elif self._changes is not None:
            next(self._changes)
        else:
            self._changes = _reported(self.folder)
            next(self._changes)


def _reported(folder: Path) -> Iterator[object]:
    """Yield after each change in a folder, and at times without one."""
    try:
        from watchfiles import watch
    except ImportError:
        while True:
            time.sleep(POLL_S)
            yield None
    timeout_ms = round(1e3 * IDLE_S)
    yield from watch(folder, recursive=False, rust_timeout=timeout_ms, yield_on_timeout=True)


def state_of(path: Path) -> State | None:
    """Return the state of a file or a link; None: it is a folder. FileNotFoundError: it has gone."""
    facts = path.lstat()
    return (
        None if path.is_dir() and not path.is_symlink() else (facts.st_ino, facts.st_size, facts.st_mtime_ns)
    )


def being_written(path: Path) -> bool:
    """Return whether a process of this machine has a file open for writing; False where that cannot be known.

    Linux grants a read lease, fcntl(2), on a file that nobody has open for writing, to its owner and to root, on disks
    of this machine. Samba and FTP servers have files open as long as their clients write.
    """
    if not hasattr(fcntl, "F_SETLEASE"):
        return False
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        # Whoever opens it meanwhile has the system send a signal: SIGIO would end this process, SIGURG does nothing.
        fcntl.fcntl(handle, fcntl.F_SETSIG, signal.SIGURG)
        fcntl.fcntl(handle, fcntl.F_SETLEASE, fcntl.F_RDLCK)
        fcntl.fcntl(handle, fcntl.F_SETLEASE, fcntl.F_UNLCK)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(handle)
    return False
