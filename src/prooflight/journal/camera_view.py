"""What a watched camera sees now, from the process that holds it to whoever looks: two small files beside the journal.

Whoever looks touches one of them, and whoever watches writes the other while that is fresh. Nobody looks: nothing is
computed or written.
"""

from __future__ import annotations

import contextlib
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from collections.abc import Callable

SHOWN, ASKED = ".camera.json", ".camera.asked"
FRESH_S: Final = 5.0
"""After which nobody looks any more, and what was written is no longer now."""
MOST_BYTES: Final = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraExchange:
    """Of one journal. clock: Unix time, which both processes share. [s]"""

    journal: Path
    clock: Callable[[], float] = time.time

    def ask(self) -> None:
        """Somebody looks. OSError."""
        self._beside(ASKED).touch()

    def asked(self) -> bool:
        """Whether somebody does."""
        return self._fresh(ASKED)

    def write(self, told: dict[str, Any]) -> None:
        """What is seen; what JSON can hold. OSError."""
        with whole_file(self._beside(SHOWN)) as unfinished:
            unfinished.write_text(json.dumps(told, allow_nan=False), encoding="utf-8")

    def read(self) -> dict[str, Any] | None:
        """What is seen now; None: nobody watches, or what lies there is nothing of ours."""
        if not self._fresh(SHOWN):
            return None
        try:
            with self._beside(SHOWN).open("rb") as file:
                told = json.loads(file.read(MOST_BYTES))
        except (OSError, ValueError):
            return None
        return told if isinstance(told, dict) else None

    def clear(self) -> None:
        """Nobody watches any more."""
        for name in (SHOWN, ASKED):
            with contextlib.suppress(OSError):
                self._beside(name).unlink(missing_ok=True)

    def _beside(self, suffix: str) -> Path:
        return self.journal.with_name(self.journal.name + suffix)

    def _fresh(self, suffix: str) -> bool:
        try:
            return abs(self.clock() - self._beside(suffix).stat().st_mtime) <= FRESH_S
        except OSError:
            return False
