"""The journal of a press: one row a page, durable when ``commit`` says so, evidence in files beside it.

Order of a commit: evidence into a pack (``journaling.packs``), flushed to the disk; then one transaction with the rows
that name it. Whoever dies between the two leaves a pack that no row names, and the next writer removes it. One
process writes at a time; any number read meanwhile.
"""

from __future__ import annotations

import hashlib
import logging
import threading
from typing import TYPE_CHECKING, Any, Self

from sqlalchemy import delete, exists, func, select
from sqlalchemy.exc import DBAPIError

from prooflight import __version__
from prooflight.inspecting.journaling import packs, rows
from prooflight.inspecting.journaling.lock import WriterLock
from prooflight.inspecting.journaling.queue import JournalQueue
from prooflight.inspecting.journaling.reading import JournalReader
from prooflight.inspecting.journaling.records import (
    JournalHealth,
    PageRecord,
    Retention,
    RunEnd,
    RunFacts,
    RunRow,
)
from prooflight.inspecting.journaling.retention import tidy
from prooflight.inspecting.journaling.schema import (
    JournalError,
    default_journal,
    journal_path,
    open_database,
    packs_table,
    pages_table,
    runs_table,
    writing,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from numpy.typing import NDArray
    from sqlalchemy import Engine

    from prooflight.inspecting.journaling.queue import Batch

__all__ = [
    "Journal",
    "JournalError",
    "JournalHealth",
    "PageRecord",
    "Retention",
    "RunEnd",
    "RunFacts",
    "RunRow",
    "content_digest",
    "default_journal",
]

_log = logging.getLogger(__name__)
_SAME_RUN = ("job_digest", "press_digest", "detector")


class Journal(JournalReader):
    """An open journal; ``open`` makes one. Its methods may be called from several threads."""

    def __init__(
        self, path: Path, engine: Engine, lock: WriterLock | None, announce: Callable[[str], None]
    ) -> None:
        super().__init__(path, engine)
        self._writer = writing(engine)
        self._lock, self._announce = lock, announce
        self._queue = JournalQueue()
        self._writing = threading.Lock()
        self._trouble: str | None = None
        self._last_run = 0

    @classmethod
    def open(
        cls, url: str, *, read_only: bool = False, announce: Callable[[str], None] = _log.warning
    ) -> Self:
        """Open a journal by URL (sqlite:///FILE) or file, and make it if there is none.

        announce: told once when the journal can no longer write, and once when it can again. JournalError: it is no
        journal, of another schema, or another process writes it.
        """
        path = journal_path(url)
        lock = None if read_only else WriterLock.take(path)
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
        """Commit what waits and let another process write."""
        if self._lock is not None:
            self.commit()
        self._engine.dispose()
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    # --- writing ---

    def begin_run(self, facts: RunFacts) -> int:
        """A new run; returns its number, even while the journal cannot write."""
        with self._writing:
            self._last_run += 1
            run_id = self._last_run
        self._queue.begin(run_id, facts)
        self.commit()
        return run_id

    def unfinished_run(self, facts: RunFacts) -> int | None:
        """The latest run, if it has no end and is of the same job, press and detector: one to go on with."""
        query = select(runs_table).order_by(runs_table.c.id.desc()).limit(1)
        with self._engine.begin() as connection:
            row = connection.execute(query).first()
        if row is None or row.ended_s is not None:
            return None
        return row.id if all(getattr(row, name) == getattr(facts, name) for name in _SAME_RUN) else None

    def record(self, run_id: int, page: PageRecord) -> None:
        """Queue one page; never waits for the disk. A sheet recorded again replaces what was there."""
        self._queue.add(run_id, page)

    def end_run(self, run_id: int, end: RunEnd) -> None:
        """The run is over."""
        self._queue.end(run_id, end)
        self.commit()

    def commit(self) -> bool:
        """Make all that is queued durable; False: it cannot be now, stays queued, and was announced once."""
        with self._writing:
            while not (batch := self._queue.take()).empty:
                try:
                    self._write(batch)
                except BaseException as error:
                    self._queue.put_back(batch)
                    if not isinstance(error, DBAPIError | OSError):
                        raise
                    self._cannot_write(error)
                    return False
                self._queue.written()
                self._can_write()
            return self._trouble is None

    @property
    def health(self) -> JournalHealth:
        """Whether it keeps up."""
        return JournalHealth(
            trouble=self._trouble,
            waiting=self._queue.waiting,
            dropped_pages=self._queue.dropped_pages,
            dropped_evidence=self._queue.dropped_evidence,
        )

    def tidy(self, retention: Retention, *, now_s: float) -> None:
        """Remove runs that ended too long ago, then the oldest evidence, then the oldest runs; commits go on between.

        now_s: Unix time.
        """
        steps = tidy(self._writer, self._folder, retention, now_s=now_s)
        done = object()
        while True:
            with self._writing:
                try:
                    if next(steps, done) is done:
                        return
                except (DBAPIError, OSError) as error:
                    self._cannot_write(error)
                    return

    # --- inside ---

    def _take_over(self) -> None:
        """Remove what a writer left that died, or replaced; go on after its last run."""
        in_use = exists().where(pages_table.c.pack_id == packs_table.c.id)
        with self._writer.begin() as connection:
            self._last_run = connection.execute(select(func.max(runs_table.c.id))).scalar() or 0
            connection.execute(delete(packs_table).where(~in_use))
            named = set(connection.execute(select(packs_table.c.file)).scalars())
        packs.remove_strangers(self._folder, named)

    def _write(self, batch: Batch) -> None:
        """Evidence, one pack a run, then rows; leaves nothing of a batch that cannot be written."""
        of_runs: dict[int, dict[int, Mapping[str, NDArray[Any]]]] = {}
        for run_id, page in batch.pages:
            if page.evidence:
                of_runs.setdefault(run_id, {})[page.sheet] = page.evidence
        written = {}
        try:
            for run_id, pages in of_runs.items():
                file = packs.pack_name(run_id, min(pages))
                written[run_id] = (file, packs.write_pack(self._folder / file, pages))
            with self._writer.begin() as connection:
                rows.write_rows(connection, batch, written)
        except BaseException:
            for file, _ in written.values():
                (self._folder / file).unlink(missing_ok=True)
            raise

    def _cannot_write(self, error: Exception) -> None:
        why = str(getattr(error, "orig", None) or getattr(error, "strerror", None) or error).lower()
        if self._trouble is None:
            self._announce(f"{self.path}: the journal cannot write ({why}); inspection goes on, pages wait")
        self._trouble = why

    def _can_write(self) -> None:
        if self._trouble is not None:
            health = self.health
            lost = f"{health.dropped_pages} pages and the evidence of {health.dropped_evidence} were dropped"
            self._announce(f"{self.path}: the journal writes again; {lost}")
        self._trouble = None


def content_digest(path: Path) -> str:
    """SHA-256 of a file, or of all files in a folder with their names."""
    sha = hashlib.sha256()
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    for file in files:
        sha.update(f"{file.relative_to(path).as_posix()} {file.stat().st_size}\n".encode())
        with file.open("rb") as content:
            while piece := content.read(1 << 20):
                sha.update(piece)
    return sha.hexdigest()
