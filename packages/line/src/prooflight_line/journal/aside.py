"""What a journal's rows cannot store or do not name is kept aside, and reported.

Pages that no row can store are lines of JSON next to the journal, because their verdicts count. Files of evidence that
no row names are moved away, never removed, and moved back if a row names them: they come from a writer that died
between file and rows, from a sheet that was recorded again, or from a database that was moved away or restored from an
older copy, and only a person can tell which.
"""

from __future__ import annotations

import logging
import os
import stat
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

from prooflight_line.journal.columns import complaint
from prooflight_line.journal.exporting import page_facts
from prooflight_line.journal.opening import why
from prooflight_line.journal.packs import evidence_folder, refuse_other
from prooflight_line.journal.schema import json_text

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator
    from pathlib import Path

    from prooflight_line.journal.queue import Batch
    from prooflight_line.journal.records import PageRecord

_log = logging.getLogger(__name__)
_FLAGS: Final = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)


def aside_file(database: Path) -> Path:
    """Return the file for such pages."""
    return database.with_name(database.name + ".aside.jsonl")


@dataclass(slots=True)
class Refusals:
    """Removal from a batch of what can never be written; the first of each sort is announced by the run."""

    database: Path
    announce: Callable[[str], None]
    pages: int = 0
    evidence: int = 0

    def page(self, batch: Batch, run_id: int, page: PageRecord, error: Exception) -> None:
        """Move a page into the file next to the journal."""
        batch.pages.remove((run_id, page))
        batch.dropped_pages[run_id] += 1
        self.pages += 1
        reason, file = complaint(error), aside_file(self.database)
        outcome = f"such pages are stored in {file.name}"
        try:
            _append(file, run_id, page, reason)
        except OSError as trouble:
            outcome = f"{file.name} cannot store it either ({why(trouble)})"
            _log.warning("run %d, sheet %s: %s; %s", run_id, page.sheet, reason, outcome)
        if self.pages == 1:
            what = f"sheet {page.sheet} of run {run_id} cannot be stored as a row ({reason})"
            self.announce(f"{self.database}: {what}; {outcome}")

    def without_evidence(self, batch: Batch, run_id: int, page: PageRecord, error: Exception) -> PageRecord:
        """Replace a page of the batch by one without its evidence, and return that one."""
        without = replace(page, evidence=None)
        batch.pages[batch.pages.index((run_id, page))] = (run_id, without)
        batch.dropped_evidence[run_id] += 1
        self.evidence += 1
        if self.evidence == 1:
            what = f"the evidence of sheet {page.sheet} of run {run_id} cannot be stored ({complaint(error)})"
            self.announce(f"{self.database}: {what}; its verdict is recorded")
        return without

    def run(self, run_ids: list[int], error: Exception) -> None:
        """Announce runs whose begin, end or losses cannot be recorded."""
        self.announce(f"{self.database}: runs {run_ids} cannot be recorded as they are ({complaint(error)})")


def _append(file: Path, run_id: int, page: PageRecord, reason: str) -> None:
    """Append one page, without its evidence, durable when this returns; OSError."""
    sheet = page.sheet if isinstance(page.sheet, int) else str(page.sheet)
    line = json_text({"run": run_id, "sheet": sheet, "reason": reason, "page": _facts(page)}) + "\n"
    handle = os.open(file, _FLAGS, 0o666)
    with os.fdopen(handle, "a", encoding="utf-8") as stream:
        stream.write(line)
        stream.flush()
        os.fsync(handle)


def _facts(page: PageRecord) -> object:
    try:
        return page_facts(page)
    except Exception:  # such a page may contain anything
        return repr(page)


# --- files of evidence that no row names ---


@dataclass(frozen=True, slots=True, kw_only=True)
class Unclaimed:
    """Files moved when a journal was opened."""

    evidence: Path
    aside: Path
    moved: int = 0
    """Number of files moved into ``aside``."""
    moved_bytes: int = 0
    taken_back: int = 0
    left: int = 0
    """Links and anything else that is no plain file, and files that could not be moved; they stay in
    place."""

    @classmethod
    def nothing(cls, database: Path) -> Self:
        """Return the state before any file was examined."""
        return cls(evidence=evidence_folder(database), aside=unclaimed_folder(database))

    @property
    def messages(self) -> list[str]:
        """Messages for people, one a line."""
        messages = []
        if self.moved:
            size = f"{_files(self.moved)} ({self.moved_bytes / 1e6:.1f} MB) that no page of the journal names"
            messages.append(
                f"{self.evidence}: {size} were moved to {self.aside}; remove them if they are not needed"
            )
        if self.taken_back:
            messages.append(
                f"{self.aside}: {_files(self.taken_back)} that the journal names again were moved back"
            )
        if self.left:
            messages.append(
                f"{self.evidence}: {_files(self.left)} that are not evidence, or could not be moved, remain there"
            )
        return messages


def unclaimed_folder(database: Path) -> Path:
    """Return the folder for files that no row names: next to the evidence, which it keeps free of them."""
    return database.with_name(database.name + ".unclaimed")


def put_aside(database: Path, named: Collection[str]) -> Unclaimed:
    """Move files that no row names out of the evidence, and named ones back; JournalError: a link is in the way."""
    before = Unclaimed.nothing(database)
    evidence, aside = before.evidence, before.aside
    for folder in (evidence, aside):
        refuse_other(folder, stat.S_ISDIR)
    taken_back = sum(
        _moved(aside, evidence, name) for name, status in _below(aside) if name in named and _plain(status)
    )
    moved = size = left = 0
    for name, status in _below(evidence):
        if name in named and _plain(status):
            continue
        if _plain(status) and _moved(evidence, aside, name):
            moved, size = moved + 1, size + status.st_size
        else:
            left += 1
    return replace(before, moved=moved, moved_bytes=size, taken_back=taken_back, left=left)


def _below(folder: Path) -> Iterator[tuple[str, os.stat_result]]:
    """Yield everything but folders, by its name relative to this folder; links are not followed."""
    for here, folders, files in os.walk(folder):
        for name in (*files, *folders):
            path = os.path.join(here, name)  # noqa: PTH118  # a million paths are made here
            status = os.lstat(path)
            if not stat.S_ISDIR(status.st_mode):
                yield os.path.relpath(path, folder).replace(os.sep, "/"), status


def _plain(status: os.stat_result) -> bool:
    return stat.S_ISREG(status.st_mode)


def _moved(source: Path, target: Path, name: str) -> bool:
    """Move a file, without overwriting any; return whether it was moved."""
    end = target / name
    try:
        end.parent.mkdir(parents=True, exist_ok=True)
        if any(folder.is_symlink() for folder in end.parents if target in (folder, *folder.parents)):
            return False
        if os.path.lexists(end):
            return False
        (source / name).rename(end)
    except OSError:
        return False
    return True


def _files(count: int) -> str:
    return f"{count:,} {'file' if count == 1 else 'files'}"
