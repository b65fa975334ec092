"""Small JSON files next to a journal, by which the processes that use it tell each other of a run."""

from __future__ import annotations

import contextlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True, kw_only=True)
class SideFile:
    """A file beside a journal, which is there as a whole or not at all."""

    path: Path
    most_bytes: int = 10_000
    """Greatest size that is read; a longer file is cut there, and so is no JSON."""

    @classmethod
    def of(cls, journal: Path, suffix: str, *, most_bytes: int = 10_000) -> Self:
        """Return the file whose name is that of the journal and this suffix."""
        return cls(path=journal.with_name(journal.name + suffix), most_bytes=most_bytes)

    def read(self) -> dict[str, Any]:
        """Return what is written. OSError; ValueError: it is not a JSON object."""
        with self.path.open("rb") as file:
            facts = json.loads(file.read(self.most_bytes))
        if not isinstance(facts, dict):
            message = f"{self.path}: not a JSON object"
            raise ValueError(message)  # noqa: TRY004  # it is the file that is wrong, as where it is no JSON
        return facts

    def write(self, facts: dict[str, Any]) -> None:
        """Write this in place of what was there. OSError; ValueError: a number is not finite."""
        with whole_file(self.path) as unfinished:
            unfinished.write_text(json.dumps(facts, allow_nan=False), encoding="utf-8")

    def remove(self) -> None:
        """Remove the file, if that is possible."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)
