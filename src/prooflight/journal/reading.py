"""What a journal holds, for whoever asks; while another process writes it as well.

A row that cannot be believed is one JournalError, which names run, sheet and column; whoever gives ``damaged`` is told
of it and gets the others.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import func, select

from prooflight.journal import packs, rows
from prooflight.journal.columns import PackColumns, complaint
from prooflight.journal.lock import WriterLock, writer_lives
from prooflight.journal.opening import UNREADABLE, why
from prooflight.journal.retention import used_bytes
from prooflight.journal.schema import JournalError, stored_packs, stored_pages, stored_runs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray
    from sqlalchemy import Engine

    from prooflight.journal.records import PageRecord, RunRow

    Damaged = Callable[[JournalError], None]

MOST_ID: Final = 2**63 - 1
_WHOLE: Final = "the page's row is whole: `prooflight run show`"


def refuse(error: JournalError) -> None:
    """What is done with a damaged row where nobody says otherwise: raised."""
    raise error


class JournalReader:
    """Runs and pages of an open journal. JournalError where what is asked for cannot be read."""

    def __init__(self, path: Path, engine: Engine) -> None:
        self.path = path
        self._engine = engine
        self._folder = packs.evidence_folder(path)
        self._lock: WriterLock | None = None

    def runs(self, *, damaged: Damaged = refuse) -> list[RunRow]:
        """All runs, oldest first. damaged: told of each that cannot be read."""
        return self._runs(None, damaged)

    def run(self, run_id: int) -> RunRow:
        """One run; JournalError if there is none of that number."""
        found = self._runs(run_id, refuse) if 0 < run_id <= MOST_ID else []
        if not found:
            last = self._last_run_id()
            remedy = "it holds no runs yet" if last is None else f"the last is run {last}"
            raise JournalError(self.path, f"there is no run {run_id}", remedy=remedy)
        return found[0]

    def last_run(self) -> RunRow:
        """The latest run; JournalError if there is none."""
        return self.run(self._last_run_id() or 1)

    def pages(self, run_id: int, *, passed: bool = True, damaged: Damaged = refuse) -> Iterator[PageRecord]:
        """A run's pages by sheet, read as they are asked for; without their evidence, which ``page`` reads.

        passed: False leaves out what nobody has to look at, good pages in time, without fault and note.
        damaged: told of each that cannot be read, and of the rest of them where the file itself is damaged.
        """
        page = stored_pages.c
        query = select(stored_pages).where(page.run_id == run_id).order_by(page.sheet)
        if not passed:
            query = query.where(~rows.surely_good())
        try:
            with self._asked(f"pages of run {run_id}"), self._engine.connect() as connection:
                # One by one: of those before a damaged place none is lost.
                for row in connection.execution_options(yield_per=1).execute(query):
                    try:
                        record = rows.page_record(row)
                    except ValueError as error:
                        damaged(self._bad_row(f"run {run_id}, sheet {row.sheet}", error))
                        continue
                    if passed or not rows.nobody_need_see(record):
                        yield record
        except JournalError as error:
            damaged(error)

    def asked_pages(self, run_id: int, *, damaged: Damaged = refuse) -> list[PageRecord]:
        """Pages of a run about which people are asked, by sheet, without their evidence; damaged: as for ``pages``."""
        page = stored_pages.c
        query = (
            select(stored_pages).where(page.run_id == run_id, page.asked.is_not(None)).order_by(page.sheet)
        )
        with self._asked(f"pages of run {run_id}"), self._engine.begin() as connection:
            raw = connection.execute(query).all()
        found = []
        for row in raw:
            try:
                found.append(rows.page_record(row))
            except ValueError as error:
                damaged(self._bad_row(f"run {run_id}, sheet {row.sheet}", error))
        return found

    def page(self, run_id: int, sheet: int) -> PageRecord:
        """One page with its evidence, if any was kept; JournalError if there is no such sheet."""
        row = None
        if 0 < run_id <= MOST_ID and 0 <= sheet <= MOST_ID:
            page = stored_pages.c
            query = select(stored_pages).where(page.run_id == run_id, page.sheet == sheet)
            with self._asked(f"run {run_id}, sheet {sheet}"), self._engine.begin() as connection:
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

    @property
    def megabytes(self) -> float:
        """Of its rows and its evidence, 1e6 bytes each."""
        with self._asked("its size"):
            return used_bytes(self._engine) / 1e6

    # --- parts ---

    def _runs(self, run_id: int | None, damaged: Damaged) -> list[RunRow]:
        def bad(number: object, error: ValueError) -> None:
            damaged(self._bad_row(f"run {number}", error))

        with self._asked("runs"), self._engine.begin() as connection:
            lives = self._lock is not None or writer_lives(self.path)
            return rows.read_runs(connection, run_id, writer_lives=lives, damaged=bad)

    def _last_run_id(self) -> int | None:
        with self._asked("runs"), self._engine.begin() as connection:
            last = connection.execute(select(func.max(stored_runs.c.id))).scalar()
        return last if isinstance(last, int) else None

    def _evidence(self, pack_id: object, sheet: int) -> dict[str, NDArray[Any]] | None:
        if pack_id is None:
            return None
        with self._asked(f"evidence {pack_id}"), self._engine.begin() as connection:
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
    def _asked(self, what: str) -> Iterator[None]:
        try:
            yield
        except UNREADABLE as error:
            remedy = "if the file is damaged, `sqlite3 FILE .recover` saves what can be saved"
            raise JournalError(self.path, f"{what}: cannot be read ({why(error)})", remedy=remedy) from error
