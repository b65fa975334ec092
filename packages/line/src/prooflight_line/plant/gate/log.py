"""Log of each sheet's decision and of when it was written: one JSON object a line, next to the journal.

A line is passed to the operating system before its register is written, so that no line is lost if the
process is killed; a journal's pages are durable half a second later.
"""

from __future__ import annotations

import json
import logging
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import InputError
from prooflight.files.given import GivenFiles

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Self

_log = logging.getLogger(__name__)

REMEDY: Final = "give the journal of a run that had a gate"


class PlantError(InputError):
    """The plant cannot be served: its controller does not answer, or does not match the press file."""


LOGS: Final = GivenFiles(error=PlantError, remedy=REMEDY, largest_mb=4000)


def log_path(journal: Path, run_id: int) -> Path:
    """Return the path of a run's gate log."""
    return journal.with_name(f"{journal.name}.gate") / f"run{run_id:06}.jsonl"


def set_aside(journal: Path, run_id: int) -> Path | None:
    """Rename a log that exists before that run begins; return its new path, or None if there is no log.

    It belongs to an earlier journal of this path, and its sheets would be taken for those of the run.
    """
    path = log_path(journal, run_id)
    if not path.exists():
        return None
    aside = next(
        unused for at in count(1) if not (unused := path.with_name(f"{path.name}.before{at}")).exists()
    )
    return path.rename(aside)


class GateLog:
    """Writer that appends lines; it may be used by several threads."""

    def __init__(self, path: Path | None) -> None:
        """Open the log for appending; ``path`` None writes nothing."""
        self._guard = Lock()
        self._file = None
        self.dropped = 0
        """Number of lines that could not be written."""
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a", encoding="utf-8", buffering=1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, kind: str, **facts: Any) -> None:
        """Append one line.

        A failure to write is logged once and not raised, because the gate must be served all the same.
        """
        with self._guard:
            if self._file is None:
                return
            try:
                self._file.write(json.dumps({"kind": kind, **facts}) + "\n")
            except OSError as error:
                if not self.dropped:
                    why = error.strerror or error
                    _log.warning("the gate's log cannot be written (%s); sheets continue to the gate", why)
                self.dropped += 1

    def close(self) -> None:
        """Close the file; later lines are ignored."""
        with self._guard:
            if self._file is not None:
                with suppress(OSError):
                    self._file.close()
                self._file = None


def rows_of(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a log, of which the last may be incomplete; PlantError if there is no log, or it is
    not one.
    """
    try:
        text = LOGS.read_text(path)
    except OSError as error:
        raise PlantError(path, "cannot be read", remedy=REMEDY) from error
    lines = text.split("\n")
    for number, line in enumerate(lines, start=1):
        if not line:
            continue
        try:
            row = json.loads(line)
        except (ValueError, RecursionError) as error:
            if number == len(lines):
                return
            raise PlantError(path, f"line {number} is not JSON", remedy="remove it") from error
        if not isinstance(row, dict) or not isinstance(row.get("kind"), str):
            raise PlantError(path, f"line {number} is not a line of a gate's log", remedy="remove it")
        yield row


NEEDED: Final = {
    "decision": ("tag", "came", "result", "code", "job_page", "page", "set"),
    "written": ("tag", "position"),
    "unsent": ("tag", "code"),
    "tray": ("tag", "tray", "session"),
}
"""Fields that a line of each kind needs so that sheets can be accounted for."""


@dataclass(slots=True)
class LoggedDecisions:
    """Content of a gate log of one run."""

    sessions: list[int] = field(default_factory=list)
    began: dict[str, Any] = field(default_factory=dict)
    decisions: dict[int, dict[str, Any]] = field(default_factory=dict)
    """Decision lines by tag, also of pages that did not come."""
    written: dict[int, dict[str, Any]] = field(default_factory=dict)
    """Last line of each tag that the controller has acknowledged."""
    places: dict[int, list[int]] = field(default_factory=dict)
    """Encoder counts, by tag, at which the sheet was expected at the gate; a controller that loses its
    power counts from 0 again."""
    unsent: dict[int, dict[str, Any]] = field(default_factory=dict)
    trays: dict[int, dict[str, Any]] = field(default_factory=dict)
    """Tray that the controller itself reported, by tag."""

    @classmethod
    def read(cls, path: Path) -> LoggedDecisions:
        """Read a log; PlantError as for ``rows_of``, or if a line lacks a field."""
        decisions = cls()
        for row in rows_of(path):
            try:
                decisions._add(row)
            except (KeyError, TypeError) as error:
                raise PlantError(path, f"a line lacks {error}", remedy="remove it") from error
        return decisions

    def _add(self, row: dict[str, Any]) -> None:
        lacking = [name for name in NEEDED.get(row["kind"], ()) if name not in row]
        if lacking:
            raise KeyError(lacking[0])
        if row["kind"] in ("decision", "written") and row.get("position") is not None:
            self.places.setdefault(row["tag"], []).append(row["position"])
        match row["kind"]:
            case "run":
                self.began = row
            case "session":
                self.sessions.append(row["session"])
            case "decision":
                self.decisions[row["tag"]] = row
            case "written":
                self.written[row["tag"]] = row
            case "unsent":
                self.unsent[row["tag"]] = row
            case "tray":
                self.trays[row["tag"]] = row
