"""How far the start of a run has got, for those who look at its journal: a small file next to it.

A run composes, builds, prints for the drum and prepares designs for minutes before its first sheet. The process that
does so writes its stage, and removes the file with the first line that it inspects.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from prooflight_line.journal.side_files import SideFile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

Item = TypeVar("Item")
SUFFIX: Final = ".start.json"
STAGES: Final = ("job", "press", "print", "prepare", "rehearse")
"""Stages: composing or reading the job, building the press, printing for the drum, preparing designs, and
inspections that warm the machine up."""
MOST_AGE_S: Final = 3600.0
"""Age after which a file is that of a process that died elsewhere. Assumed: no step takes longer, even on a busy
machine. [s]"""
EVERY_S: Final = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """A stage of a start."""

    stage: str
    """One of ``STAGES``."""
    done: int = 0
    total: int = 0
    """Number of steps; 0: unknown."""
    left_s: float | None = None
    """Time that the rest of the stage takes at the speed so far; None: unknown. [s]"""
    part: str = ""
    """Part of the stage, as commands report it; empty: it has none."""


@dataclass(slots=True, kw_only=True)
class StartFile:
    """The file of one journal."""

    journal: Path
    clock: Callable[[], float] = time.monotonic
    _written_s: float = field(default=-math.inf)

    @property
    def path(self) -> Path:
        """The file."""
        return self._file.path

    @property
    def _file(self) -> SideFile:
        return SideFile.of(self.journal, SUFFIX)

    def write(self, start: Start) -> None:
        """Write a stage; a folder that cannot be written is no reason not to start."""
        self._written_s = self.clock()
        facts = {name: getattr(start, name) for name in ("stage", "done", "total", "left_s", "part")}
        with contextlib.suppress(OSError):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file.write(facts | {"pid": os.getpid()})

    def write_at_times(self, start: Start) -> None:
        """Write a stage, unless one was written just before."""
        if self.clock() - self._written_s >= EVERY_S:
            self.write(start)

    def noted(self, items: Iterable[Item], *, total: int, stage: str, part: str = "") -> Iterator[Item]:
        """Yield the items of a stage, and write how many are done and how long the others take."""
        begun_s = self.clock()
        self.write(Start(stage=stage, total=total, part=part))
        for done, item in enumerate(items):
            if done:
                left_s = (self.clock() - begun_s) / done * (total - done)
                self.write_at_times(Start(stage=stage, done=done, total=total, left_s=left_s, part=part))
            yield item

    def read(self) -> Start | None:
        """Return the stage; None: nothing starts, or whoever started is gone."""
        try:
            if abs(time.time() - self.path.stat().st_mtime) > MOST_AGE_S:
                return None
            facts = self._file.read()
            os.kill(int(facts.pop("pid")), 0)
            start = Start(**facts)
        except PermissionError:  # of another user, and alive
            start = Start(**facts)
        except (OSError, ValueError, TypeError, KeyError, OverflowError):
            return None
        numbers = (start.done, start.total, start.left_s or 0.0)
        sound = start.stage in STAGES and all(isinstance(n, int | float) and 0 <= n < 1e9 for n in numbers)
        return start if sound and isinstance(start.part, str) else None

    def clear(self) -> None:
        """Remove the file, as the run has started or ended."""
        self._file.remove()
