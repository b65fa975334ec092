"""The journal of a press: one row a page, durable when ``commit`` returns True, with evidence in files next to it.

Order of a commit: evidence into a pack (``packs``), flushed to the disk; then one transaction with the
rows that name it. A process that dies between the two leaves a pack that no row names, which the next writer
moves away (``aside``). Opening a journal removes nothing. One process writes at a time; any number
may read.
"""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING, Self

from sqlalchemy import delete, exists, func, select
from sqlalchemy.exc import DBAPIError

from prooflight import __version__
from prooflight.files.lock import WriterLock
from prooflight_line.journal import rows
from prooflight_line.journal.aside import Refusals, Unclaimed, aside_file, put_aside
from prooflight_line.journal.columns import complaint
from prooflight_line.journal.labels import LabelStore
from prooflight_line.journal.opening import ANOTHER, examine, journal_path, open_database, why, writing
from prooflight_line.journal.queue import JournalQueue
from prooflight_line.journal.reading import JournalReader
from prooflight_line.journal.records import (
    Due,
    JournalHealth,
    PageRecord,
    Retention,
    RunEnd,
    RunFacts,
    Tidied,
)
from prooflight_line.journal.retention import due, tidy
from prooflight_line.journal.schema import JournalError, packs_table, pages_table, runs_table, stored_packs
from prooflight_line.journal.writing import write

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sqlalchemy import Engine

_log = logging.getLogger(__name__)


class Journal(JournalReader):
    """An open journal, created by ``open``. Its methods may be called from several threads."""

    def __init__(
        self, path: Path, engine: Engine, lock: WriterLock | None, announce: Callable[[str], None]
    ) -> None:
        super().__init__(path, engine)
        self._writer = writing(engine)
        self._lock, self._announce = lock, announce
        self._queue = JournalQueue()
        self._refusals = Refusals(path, announce)
        self._writing = threading.Lock()
        self._trouble: str | None = None
        self._last_run = 0
        self.unclaimed = Unclaimed.nothing(path)
        """Files moved away when it was opened for writing."""

    @classmethod
    def open(
        cls, url: str, *, read_only: bool = False, announce: Callable[[str], None] = _log.warning
    ) -> Self:
        """Open a journal by URL (sqlite:///FILE) or file, and create it if there is none.

        announce: called once when the journal can no longer write, and once when it can again; with what was
        moved away; and with what could not be recorded. JournalError: it is no journal, of another schema, or
        another process writes it.
        """
        path = journal_path(url)
        examine(path, read_only=read_only)
        lock = (
            None
            if read_only
            else WriterLock.take(
                path, error=JournalError, wait="give this one its own with --journal", elsewhere=ANOTHER
            )
        )
        try:
            engine = open_database(path, read_only=read_only, version=__version__)
            journal = cls(path, engine, lock, announce)
            if not read_only:
                journal._take_over()
        except BaseException:
            if lock is not None:
                lock.release()
            raise
        return journal

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Commit what waits, report what is not recorded, and let another process write."""
        if self._lock is None:
            self._engine.dispose()
            return
        try:
            self.commit()
            if lost := self.health.unrecorded:
                self._announce(f"{self.path}: {lost} of the reported pages are not recorded{self._aside()}")
        finally:
            self._engine.dispose()
            self._lock.release()
            self._lock = None

    # --- writing ---

    def begin_run(self, facts: RunFacts) -> int:
        """Begin a run; return its number, even while the journal cannot write. JournalError: no row can store it."""
        with self._writing:
            run_id = self._last_run + 1
            try:
                rows.run_row(run_id, facts)
            except (ValueError, TypeError) as error:
                what = f"run {run_id} cannot be recorded ({complaint(error)})"
                raise JournalError(self.path, what, remedy=ANOTHER) from error
            self._last_run = run_id
        self._queue.begin(run_id, facts)
        self.commit()
        return run_id

    def record(self, run_id: int, page: PageRecord) -> None:
        """Queue one page; never waits for the disk. A sheet recorded again replaces the earlier record."""
        self._queue.add(run_id, page)

    def end_run(self, run_id: int, end: RunEnd) -> None:
        """End a run."""
        self._queue.end(run_id, end)
        self.commit()

    def commit(self) -> bool:
        """Make all that is queued durable; False: it cannot be written now, stays queued, and was announced once.

        What no row can ever store is moved aside and does not block the rest.
        """
        with self._writing:
            while not (batch := self._queue.take()).empty:
                try:
                    write(self._writer, self._folder, batch, self._refusals)
                except BaseException as error:
                    self._queue.put_back(batch)
                    if not isinstance(error, Exception):
                        raise
                    self._cannot_write(error)
                    return False
                self._queue.written()
                self._can_write()
            return self._trouble is None

    @property
    def health(self) -> JournalHealth:
        """State of the journal's writing."""
        return JournalHealth(
            trouble=self._trouble,
            waiting=self._queue.waiting,
            dropped_pages=self._queue.dropped_pages,
            dropped_evidence=self._queue.dropped_evidence + self._refusals.evidence,
            set_aside=self._refusals.pages,
        )

    def due(self, retention: Retention, *, now_s: float) -> list[Due]:
        """Return what ``tidy`` would remove by the age of runs, and remove nothing; the limit of size is not counted.

        JournalError: the holds or the rows cannot be read.
        """
        on_hold = LabelStore(self.path).on_hold()
        with self._reading("runs and evidence"):
            return due(self._engine, self._folder, retention, Tidied(), now_s=now_s, on_hold=on_hold)

    def tidy(self, retention: Retention, *, now_s: float) -> Tidied:
        """Remove runs, pictures and scans that are too old, then the oldest evidence, then the oldest runs.

        Commits go on between.
        Returns what it removed, also if it had to stop; ``health`` tells whether it had to. now_s: Unix time.
        Nothing of a run on legal hold is removed. JournalError: the holds cannot be read, and nothing was removed.
        """
        tidied, done = Tidied(), object()
        on_hold = LabelStore(self.path).on_hold()
        steps = tidy(self._writer, self._folder, retention, tidied, now_s=now_s, on_hold=on_hold)
        while True:
            with self._writing:
                try:
                    if next(steps, done) is done:
                        return tidied
                except (DBAPIError, OSError) as error:
                    self._cannot_write(error)
                    return tidied

    # --- inside ---

    def _take_over(self) -> None:
        """Continue after the last run; move away files that a dead writer left or that were replaced.

        Nothing is removed.
        """
        in_use = exists().where(pages_table.c.pack_id == packs_table.c.id)
        with self._reading("runs and evidence"), self._writer.begin() as connection:
            self._last_run = connection.execute(select(func.max(runs_table.c.id))).scalar() or 0
            connection.execute(delete(packs_table).where(~in_use))
            named = set(connection.execute(select(stored_packs.c.file)).scalars())
        self.unclaimed = put_aside(self.path, named)
        for line in self.unclaimed.messages:
            self._announce(line)

    def _cannot_write(self, error: Exception) -> None:
        before, self._trouble = self._trouble, why(error)
        if not isinstance(error, DBAPIError | OSError):
            _log.error("the journal", exc_info=error)
        if before is None:
            problem = f"the journal cannot write ({self._trouble})"
            self._announce(f"{self.path}: {problem}; inspection continues, pages wait")

    def _can_write(self) -> None:
        if self._trouble is not None:
            health = self.health
            lost = f"{health.dropped_pages} pages and the evidence of {health.dropped_evidence} were dropped"
            self._announce(f"{self.path}: the journal writes again; {lost}")
        self._trouble = None

    def _aside(self) -> str:
        pages = self.health.set_aside
        return f"; {pages} of them are in {aside_file(self.path).name}" if pages else ""
