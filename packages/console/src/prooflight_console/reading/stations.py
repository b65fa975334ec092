"""Presses and jobs of the console, selected by the digests that runs name."""

from __future__ import annotations

import contextlib
import threading
from functools import lru_cache
from typing import TYPE_CHECKING, Final

from prooflight.errors import ProoflightError
from prooflight.files.content import content_digest
from prooflight.pages.memory import file_stamp
from prooflight.press.artefact import Press

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from prooflight_line.journal.records import RunRow

LOADED: Final = 2
"""Number of presses that are cached."""


class Stations:
    """Presses and jobs by digest; a file is read again if it has changed."""

    def __init__(
        self,
        *,
        presses: Sequence[Path],
        jobs: Sequence[Path],
        versions: Callable[[], Sequence[Path]] = tuple,
    ) -> None:
        """``versions`` returns the artefacts of further versions of the presses."""
        self._presses, self._jobs, self._versions = tuple(presses), tuple(jobs), versions
        self._guard = threading.Lock()

    def warm(self) -> None:
        """Load presses and jobs in advance, as many as are cached: a press takes a quarter of a second."""
        for path in self._presses[:LOADED]:
            with contextlib.suppress(OSError, ProoflightError):
                press_of(path, content_stamp(path))
        for path in self._jobs:
            with contextlib.suppress(OSError, ProoflightError):
                digest_of(path, content_stamp(path))

    def press(self, run: RunRow) -> Press | None:
        """Return the press by which a run was judged; None if the console does not have it."""
        located = self._press_of(run)
        return None if located is None else located[1]

    def press_file(self, run: RunRow) -> Path | None:
        """Return the file of that press; None if the console does not have it."""
        located = self._press_of(run)
        return None if located is None else located[0]

    def _press_of(self, run: RunRow) -> tuple[Path, Press] | None:
        with self._guard:
            for path in (*self._presses, *self._versions()):
                try:
                    press, digest = press_of(path, content_stamp(path))
                except (OSError, ProoflightError):
                    continue
                if run.facts.press_digest == digest:
                    return path, press
        return None

    def job(self, run: RunRow) -> Path | None:
        """Return the job of a run; None if the console does not have it, or if it has changed since."""
        if not run.facts.job_digest:
            return None
        with self._guard:
            for path in self._jobs:
                try:
                    if digest_of(path, content_stamp(path)) == run.facts.job_digest:
                        return path
                except (OSError, ProoflightError):
                    continue
        return None


@lru_cache(maxsize=LOADED)
def press_of(path: Path, _stamp: tuple[int, ...]) -> tuple[Press, str]:
    """Return the press of a file, and its digest. _stamp: ``content_stamp``, the key of the cache."""
    press = Press.load(path)
    return press, press.digest


@lru_cache(maxsize=64)
def digest_of(path: Path, _stamp: tuple[int, ...]) -> str:
    """Return ``content_digest`` of a job. _stamp: as in ``press_of``."""
    return content_digest(path)


def content_stamp(path: Path) -> tuple[int, ...]:
    """Return a stamp of a file, or of all files in a folder, that changes when one of them changes."""
    files = sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]
    return tuple(number for file in files for number in file_stamp(file))
