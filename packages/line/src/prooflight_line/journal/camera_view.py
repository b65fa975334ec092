"""Exchange of a watched camera's present view between processes, by two small files next to the journal.

A process that shows the view touches one of them, and the process that watches writes the other while the first
is fresh. If nobody requests the view, nothing is computed or written.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from prooflight_line.journal.side_files import SideFile

if TYPE_CHECKING:
    from collections.abc import Callable

SHOWN, ASKED = ".camera.json", ".camera.asked"
FRESH_S: Final = 5.0
"""Age of a file after which a request has lapsed, or a view is no longer current."""
MOST_BYTES: Final = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraExchange:
    """The exchange of one journal. clock: Unix time, which both processes share. [s]"""

    journal: Path
    clock: Callable[[], float] = time.time

    def ask(self) -> None:
        """Request the view. OSError."""
        self._side_file(ASKED).path.touch()

    def is_requested(self) -> bool:
        """Return whether the view is requested."""
        return self._fresh(ASKED)

    def write(self, view: dict[str, Any]) -> None:
        """Write the view, which JSON must be able to represent. OSError."""
        self._side_file(SHOWN).write(view)

    def read(self) -> dict[str, Any] | None:
        """Return the present view; None: nobody watches, or the file is not a view."""
        if not self._fresh(SHOWN):
            return None
        try:
            return self._side_file(SHOWN).read()
        except (OSError, ValueError):
            return None

    def clear(self) -> None:
        """Remove the files, as nobody watches any more."""
        for name in (SHOWN, ASKED):
            self._side_file(name).remove()

    def _side_file(self, suffix: str) -> SideFile:
        return SideFile.of(self.journal, suffix, most_bytes=MOST_BYTES)

    def _fresh(self, suffix: str) -> bool:
        try:
            return abs(self.clock() - self._side_file(suffix).path.stat().st_mtime) <= FRESH_S
        except OSError:
            return False
