"""Data that no row can store: reported, counted, and pages kept as lines of JSON next to the journal.

The pages are kept because their verdicts count.
"""

from __future__ import annotations

import logging
import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from prooflight_line.journal.columns import complaint
from prooflight_line.journal.exporting import page_facts
from prooflight_line.journal.opening import why
from prooflight_line.journal.schema import json_text

if TYPE_CHECKING:
    from collections.abc import Callable
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
