"""Recording of outcomes in the journal, in batches and by a thread of its own, so that no verdict waits for a disk."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Final, Self

from prooflight_line.journal.records import RunEnd
from prooflight_line.run.status import Phase

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_line.journal.journal import Journal
    from prooflight_line.journal.records import Ending, PageRecord
    from prooflight_line.run.status import Status

_log = logging.getLogger(__name__)

COMMIT_S: Final = 0.5
COMMIT_PAGES: Final = 64
"""Pages after which a commit begins: recorded pages are durable after this many pages or ``COMMIT_S``."""


def ending_of(status: Status, *, stopped: bool) -> Ending:
    """Return how a run ended; a source that ended before all pages came is at fault. stopped: by a person."""
    broke_off = status.phase is Phase.FAULT or (status.to_come > 0 and not stopped)
    return "fault" if broke_off else "stopped" if stopped else "finished"


class Recorder:
    """Writer of one run of a journal, used as a context manager.

    Pages that are ``unrecorded`` after its end will not be recorded by this process.
    """

    def __init__(self, journal: Journal, run_id: int, *, recorded: int = 0) -> None:
        """``recorded`` is the number of rows that the run has before."""
        self.committed: Callable[[int], None] = lambda _rows: None
        """Called after each commit with the number of pages on the disk, by the thread that writes."""
        self.journal, self.run_id = journal, run_id
        self._recorded = recorded
        self._due, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._commit_all, name="journal", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._due.set()
        self._thread.join()
        self.journal.commit()

    @property
    def durable(self) -> int:
        """Number of pages that are on the disk."""
        return max(self._recorded - self.unrecorded, 0)

    @property
    def unrecorded(self) -> int:
        """Number of pages not in the journal, final once it is closed: waiting, dropped, or not fit for any row."""
        return self.journal.health.unrecorded

    def record(self, page: PageRecord) -> None:
        """Queue a page; never waits."""
        self.journal.record(self.run_id, page)
        self._recorded += 1
        if self._recorded % COMMIT_PAGES == 0:
            self._due.set()

    def end(self, status: Status, *, stopped: bool, detail: str = "") -> None:
        """End the run; stopped: by a person, before the source ended. detail: added to the status's detail."""
        ending = ending_of(status, stopped=stopped)
        full_detail = "; ".join(filter(None, (status.detail, detail)))
        self.journal.commit()
        counts = asdict(status) | {"journalled": self.durable}
        end = RunEnd(ended_s=time.time(), ending=ending, detail=full_detail, counts=counts)
        self.journal.end_run(self.run_id, end)

    def _commit_all(self) -> None:
        while not self._ended.is_set():
            self._due.wait(COMMIT_S)
            self._due.clear()
            try:
                self.journal.commit()
                self.committed(self.durable)
            except Exception:  # whatever it was, later pages must be written
                _log.exception("the journal %s", self.journal.path)
