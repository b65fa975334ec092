"""What no row can hold: told, counted, and pages kept as lines of JSON beside the journal, for their verdicts count."""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from prooflight.journal.columns import complaint
from prooflight.journal.exporting import page_facts
from prooflight.journal.opening import why
from prooflight.journal.schema import json_text

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.journal.queue import Batch
    from prooflight.journal.records import PageRecord

_log = logging.getLogger(__name__)
_FLAGS: Final = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)


def aside_file(database: Path) -> Path:
    """Where such pages go."""
    return database.with_name(database.name + ".aside.jsonl")


@dataclass(slots=True)
class Refusals:
    """Takes out of a batch what can never be written, and lets its run say so. Announced is the first of each sort."""

    database: Path
    announce: Callable[[str], None]
    pages: int = 0
    evidence: int = 0

    def page(self, batch: Batch, run_id: int, page: PageRecord, error: Exception) -> None:
        """A page goes into the file beside the journal."""
        batch.pages.remove((run_id, page))
        batch.dropped_pages[run_id] += 1
        self.pages += 1
        reason, file = complaint(error), aside_file(self.database)
        kept = f"such pages are kept in {file.name}"
        try:
            _append(file, run_id, page, reason)
        except OSError as trouble:
            kept = f"{file.name} cannot hold it either ({why(trouble)})"
            _log.warning("run %d, sheet %s: %s; %s", run_id, page.sheet, reason, kept)
        if self.pages == 1:
            said = f"no row can hold sheet {page.sheet} of run {run_id} ({reason})"
            self.announce(f"{self.database}: {said}; {kept}")

    def without_evidence(self, batch: Batch, run_id: int, page: PageRecord, error: Exception) -> PageRecord:
        """A page goes on without its evidence; returned."""
        without = replace(page, evidence=None)
        batch.pages[batch.pages.index((run_id, page))] = (run_id, without)
        batch.dropped_evidence[run_id] += 1
        self.evidence += 1
        if self.evidence == 1:
            said = f"no file can hold the evidence of sheet {page.sheet} of run {run_id} ({complaint(error)})"
            self.announce(f"{self.database}: {said}; its verdict is recorded")
        return without

    def run(self, run_ids: list[int], error: Exception) -> None:
        """How runs began or ended, or how much they lost."""
        self.announce(f"{self.database}: runs {run_ids} cannot be recorded as they are ({complaint(error)})")


def _append(file: Path, run_id: int, page: PageRecord, reason: str) -> None:
    """One page, without its evidence, on the disk when this returns; OSError."""
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
    except Exception:  # nobody knows what such a page is made of
        return repr(page)
