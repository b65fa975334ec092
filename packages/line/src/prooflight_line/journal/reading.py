"""Reading of a journal, also while another process writes it.

A damaged row is one JournalError, which names run, sheet and column; a caller that gives ``damaged`` is called
with it and gets the other rows.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import func, select

from prooflight.files.lock import WriterLock, writer_lives
from prooflight_line.journal import packs, rows
from prooflight_line.journal.columns import PackColumns, complaint
from prooflight_line.journal.opening import UNREADABLE, why
from prooflight_line.journal.retention import used_bytes
from prooflight_line.journal.schema import (
    JournalError,
    journal_table,
    stored_packs,
    stored_pages,
    stored_runs,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray
    from sqlalchemy import ColumnElement, Engine

    from prooflight_line.journal.records import PageRecord, RunRow

    Damaged = Callable[[JournalError], None]

MOST_ID: Final = 2**63 - 1
_WHOLE: Final = "the page's row is complete: `prooflight run show`"


def refuse(error: JournalError) -> None:
    """Raise the error of a damaged row: the default of ``damaged``."""
    raise error


class JournalReader:
    """Reader of an open journal. JournalError if what is requested cannot be read."""

    def __init__(self, path: Path, engine: Engine) -> None:
        self.path = path
        self._engine = engine
        self._folder = packs.evidence_folder(path)
        self._lock: WriterLock | None = None

    def runs(self, *, damaged: Damaged = refuse) -> list[RunRow]:
        """Return all runs, oldest first. damaged: called with the error of each that cannot be read."""
        return self._runs(None, damaged)

    def run(self, run_id: int) -> RunRow:
        """Return one run; JournalError if there is none of that number."""
        runs = self._runs(run_id, refuse) if 0 < run_id <= MOST_ID else []
        if not runs:
            last = self._last_run_id()
            remedy = "it contains no runs yet" if last is None else f"the last is run {last}"
            raise JournalError(self.path, f"there is no run {run_id}", remedy=remedy)
        return runs[0]

    def last_run(self) -> RunRow:
        """Return the latest run; JournalError if there is none."""
        return self.run(self._last_run_id() or 1)

    def pages(self, run_id: int, *, passed: bool = True, damaged: Damaged = refuse) -> Iterator[PageRecord]:
        """Yield a run's pages by sheet, read one by one; without their evidence, which ``page`` reads.

        passed: False leaves out pages that need no review: good, in time, without fault and note. damaged: called
        with the error of each page that cannot be read, and of all remaining ones if the file itself is damaged.
        """
        page = stored_pages.c
        query = select(stored_pages).where(page.run_id == run_id).order_by(page.sheet)
        if not passed:
            query = query.where(~rows.clearly_good())
        try:
            with self._reading(f"pages of run {run_id}"), self._engine.connect() as connection:
                # One by one, so that no row before a damaged place is lost.
                for row in connection.execution_options(yield_per=1).execute(query):
                    try:
                        record = rows.page_record(row)
                    except ValueError as error:
                        damaged(self._bad_row(f"run {run_id}, sheet {row.sheet}", error))
                        continue
                    if passed or not rows.needs_no_review(record):
                        yield record
        except JournalError as error:
            damaged(error)

    def sampled_pages(self, run_id: int, *, damaged: Damaged = refuse) -> list[PageRecord]:
        """Return a run's pages up for review, by sheet, without their evidence; damaged: as for ``pages``."""
        page = stored_pages.c
        query = (
            select(stored_pages).where(page.run_id == run_id, page.asked.is_not(None)).order_by(page.sheet)
        )
        with self._reading(f"pages of run {run_id}"), self._engine.begin() as connection:
            raw = connection.execute(query).all()
        records = []
        for row in raw:
            try:
                records.append(rows.page_record(row))
            except ValueError as error:
                damaged(self._bad_row(f"run {run_id}, sheet {row.sheet}", error))
        return records

    def page(self, run_id: int, sheet: int) -> PageRecord:
        """Return one page with its evidence, if any was stored; JournalError if there is no such sheet."""
        row = None
        if 0 < run_id <= MOST_ID and 0 <= sheet <= MOST_ID:
            page = stored_pages.c
            query = select(stored_pages).where(page.run_id == run_id, page.sheet == sheet)
            with self._reading(f"run {run_id}, sheet {sheet}"), self._engine.begin() as connection:
                row = connection.execute(query).first()
        if row is None:
            self.run(run_id)
            what = f"run {run_id} has no sheet {sheet}"
            raise JournalError(self.path, what, remedy=f"see `prooflight run show {run_id}`")
        try:
            return rows.page_record(row, self._evidence(row.pack_id, sheet))
        except JournalError:
            raise
        except ValueError as error:
            raise self._bad_row(f"run {run_id}, sheet {sheet}", error) from error

    def evidence_of_run(self, run_id: int) -> dict[int, Path]:
        """Return the file of evidence of each sheet of a run that has one, by sheet; a file may be missing."""
        page = stored_pages.c
        return self._evidence_files(page.sheet, page.run_id == run_id, refuse)

    def _evidence_files(self, key: Any, condition: ColumnElement[bool], damaged: Damaged) -> dict[int, Path]:
        """Return the files of evidence of the pages that meet a condition, by a number of the page, in its order."""
        page, pack = stored_pages.c, stored_packs.c
        pages = stored_pages.join(stored_packs, pack.id == page.pack_id)
        query = select(key.label("of"), stored_packs).select_from(pages).where(condition).order_by(key)
        with self._reading("evidence"), self._engine.begin() as connection:
            raw = connection.execute(query).all()
        files = {}
        for row in raw:
            try:
                files[row.of] = packs.inside(self._folder, PackColumns(**row._asdict()).file)
            except JournalError as error:
                damaged(error)
            except ValueError as error:
                damaged(self._bad_row(f"evidence {row.id}", error))
        return files

    @property
    def version(self) -> str:
        """Version of the program that created the journal."""
        with self._reading("its version"), self._engine.begin() as connection:
            return str(connection.execute(select(journal_table.c.version)).scalar())

    @property
    def megabytes(self) -> float:
        """Size of its rows and its evidence, 1e6 bytes each."""
        with self._reading("its size"):
            return used_bytes(self._engine) / 1e6

    # --- parts ---

    def _runs(self, run_id: int | None, damaged: Damaged) -> list[RunRow]:
        def bad(number: object, error: ValueError) -> None:
            damaged(self._bad_row(f"run {number}", error))

        with self._reading("runs"), self._engine.begin() as connection:
            lives = self._lock is not None or writer_lives(self.path)
            return rows.read_runs(connection, run_id, writer_lives=lives, damaged=bad)

    def _last_run_id(self) -> int | None:
        with self._reading("runs"), self._engine.begin() as connection:
            last = connection.execute(select(func.max(stored_runs.c.id))).scalar()
        return last if isinstance(last, int) else None

    def _evidence(self, pack_id: object, sheet: int) -> dict[str, NDArray[Any]] | None:
        if pack_id is None:
            return None
        with self._reading(f"evidence {pack_id}"), self._engine.begin() as connection:
            row = connection.execute(select(stored_packs).where(stored_packs.c.id == pack_id)).first()
        if row is None:
            return None  # retention took it since the page's row was read
        try:
            path = packs.inside(self._folder, PackColumns(**row._asdict()).file)
        except JournalError:
            raise
        except ValueError as error:
            raise self._bad_row(f"evidence {pack_id}", error) from error
        try:
            return packs.read_pack(path, sheet)
        except FileNotFoundError:
            return None  # retention took it, or somebody removed it
        except OSError as error:
            raise JournalError(path, f"cannot be read ({why(error)})", remedy=_WHOLE) from error
        except ValueError as error:
            raise JournalError(path, f"is damaged ({error})", remedy=_WHOLE) from error

    def _bad_row(self, where: str, error: ValueError) -> JournalError:
        what = f"the row of {where} is damaged ({complaint(error)})"
        return JournalError(self.path, what, remedy="other rows can be read")

    @contextmanager
    def _reading(self, what: str) -> Iterator[None]:
        try:
            yield
        except UNREADABLE as error:
            remedy = "if the file is damaged, `sqlite3 FILE .recover` saves what can be saved"
            raise JournalError(self.path, f"{what}: cannot be read ({why(error)})", remedy=remedy) from error
