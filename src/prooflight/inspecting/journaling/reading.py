"""What a journal holds, for whoever asks; while another process writes it as well."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sqlalchemy import func, or_, select

from prooflight.inspecting.journaling import packs, rows
from prooflight.inspecting.journaling.lock import WriterLock, writer_lives
from prooflight.inspecting.journaling.retention import used_bytes
from prooflight.inspecting.journaling.schema import JournalError, packs_table, pages_table, runs_table

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray
    from sqlalchemy import Engine

    from prooflight.inspecting.journaling.records import PageRecord, RunRow


class JournalReader:
    """Runs and pages of an open journal."""

    def __init__(self, path: Path, engine: Engine) -> None:
        self.path = path
        self._engine = engine
        self._folder = packs.evidence_folder(path)
        self._lock: WriterLock | None = None

    def runs(self) -> list[RunRow]:
        """All runs, oldest first."""
        with self._engine.begin() as connection:
            return rows.read_runs(connection, None, writer_lives=self._written_now())

    def run(self, run_id: int) -> RunRow:
        """One run; JournalError if there is none of that number."""
        with self._engine.begin() as connection:
            found = rows.read_runs(connection, run_id, writer_lives=self._written_now())
            if not found:
                last = connection.execute(select(func.max(runs_table.c.id))).scalar()
                remedy = "it holds no runs yet" if last is None else f"the last is run {last}"
                raise JournalError(self.path, f"there is no run {run_id}", remedy=remedy)
        return found[0]

    def last_run(self) -> RunRow:
        """The latest run; JournalError if there is none."""
        with self._engine.begin() as connection:
            last = connection.execute(select(func.max(runs_table.c.id))).scalar()
        return self.run(last or 1)

    def pages(self, run_id: int, *, passed: bool = True) -> Iterator[PageRecord]:
        """A run's pages by sheet, read as they are asked for; without their evidence, which ``page`` reads.

        passed: False leaves out what nobody has to look at, good pages in time, without fault and note.
        """
        query = select(pages_table).where(pages_table.c.run_id == run_id).order_by(pages_table.c.sheet)
        if not passed:
            page = pages_table.c
            query = query.where(or_(page.verdict != "good", page.late, page.faulty, page.noted))
        with self._engine.connect() as connection:
            for row in connection.execution_options(yield_per=500).execute(query):
                yield rows.page_record(row)

    def page(self, run_id: int, sheet: int) -> PageRecord:
        """One page with its evidence, if any was kept; JournalError if there is no such sheet."""
        query = (
            select(pages_table, packs_table.c.file)
            .outerjoin(packs_table)
            .where(pages_table.c.run_id == run_id, pages_table.c.sheet == sheet)
        )
        with self._engine.begin() as connection:
            row = connection.execute(query).first()
        if row is None:
            self.run(run_id)
            what = f"run {run_id} has no sheet {sheet}"
            raise JournalError(self.path, what, remedy=f"see `prooflight run show {run_id}`")
        return rows.page_record(row, None if row.file is None else self._evidence(row.file, sheet))

    @property
    def megabytes(self) -> float:
        """Of its rows and its evidence, 1e6 bytes each."""
        return used_bytes(self._engine) / 1e6

    def _evidence(self, file: str, sheet: int) -> dict[str, NDArray[Any]] | None:
        path = self._folder / file
        try:
            return packs.read_pack(path, sheet)
        except FileNotFoundError:
            return None  # retention took it since its row was read, or somebody removed it
        except ValueError as error:
            what = f"is damaged ({error})"
            raise JournalError(path, what, remedy="the page's row is whole: `prooflight run show`") from error

    def _written_now(self) -> bool:
        return self._lock is not None or writer_lives(self.path)
