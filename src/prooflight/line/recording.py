"""Outcomes into the journal: committed together, by a thread of its own, so that no verdict waits for a disk."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Final, Self

from prooflight.journal.records import RunEnd
from prooflight.line.status import Phase

if TYPE_CHECKING:
    from prooflight.journal.journal import Journal
    from prooflight.journal.records import Ending, PageRecord
    from prooflight.line.status import Status

_log = logging.getLogger(__name__)

COMMIT_S: Final = 0.5
COMMIT_PAGES: Final = 64
"""What is recorded is durable after half a second or 64 pages."""


def ending_of(status: Status, *, stopped: bool) -> Ending:
    """How a run ended; a source that ended before all pages came is at fault. stopped: by a person."""
    broke_off = status.phase is Phase.FAULT or (status.to_come > 0 and not stopped)
    return "fault" if broke_off else "stopped" if stopped else "finished"


class Recorder:
    """Writes one run of a journal; use it as a context. What then is ``unrecorded`` never will be by this process."""

    def __init__(self, journal: Journal, run_id: int) -> None:
        self.journal, self.run_id = journal, run_id
        self._recorded = 0
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
        """Pages that are on the disk."""
        return max(self._recorded - self.unrecorded, 0)

    @property
    def unrecorded(self) -> int:
        """Pages not in the journal, once it is closed for good: they wait, were dropped, or no row can hold them."""
        return self.journal.health.unrecorded

    def record(self, page: PageRecord) -> None:
        """Queue a page; never waits."""
        self.journal.record(self.run_id, page)
        self._recorded += 1
        if self._recorded % COMMIT_PAGES == 0:
            self._due.set()

    def end(self, status: Status, *, stopped: bool, detail: str = "") -> None:
        """The run is over; stopped: by a person, before the source ended. detail: what it lacks."""
        ending = ending_of(status, stopped=stopped)
        said = "; ".join(filter(None, (status.detail, detail)))
        self.journal.commit()
        counts = asdict(status) | {"journalled": self.durable}
        end = RunEnd(ended_s=time.time(), ending=ending, detail=said, counts=counts)
        self.journal.end_run(self.run_id, end)

    def _commit_all(self) -> None:
        while not self._ended.is_set():
            self._due.wait(COMMIT_S)
            self._due.clear()
            try:
                self.journal.commit()
            except Exception:  # whatever it is, pages that come must be written
                _log.exception("the journal %s", self.journal.path)
