"""Reading of a journal while another process writes it: new rows, and pages selected by conditions.

SQLite numbers rows in the order in which they were written (``rowid``), and a sheet that is recorded again is a
new row. A reader therefore finds the new rows by the number of the last row it has read, across restarts of
either process.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import and_, case, func, literal_column, or_, select, text

from prooflight.files.lock import writer_lives
from prooflight_line.journal import rows
from prooflight_line.journal.columns import RunColumns
from prooflight_line.journal.reading import JournalReader, refuse
from prooflight_line.journal.records import COUNTED
from prooflight_line.journal.schema import JournalError, stored_pages, stored_runs

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from sqlalchemy import ColumnElement, Engine, Select

    from prooflight_line.journal.reading import Damaged
    from prooflight_line.journal.records import PageRecord, RunRow

ROW: Any = literal_column("pages.rowid").label("rowid")
QUARTER_S: Final = 900
"""Length of the parts of time in which sheets are counted: any offset of local time is a multiple of it. [s]"""
SAMPLED_EVERY: Final = 20
"""One sheet in so many is read for means of nuisance amounts. Assumed: drifts take hundreds of sheets."""
AT_ONCE: Final = 20_000
"""Rows that are read at once."""
_STARTS: Final = """WITH starts AS MATERIALIZED (SELECT runs.id, runs.started_s - coalesce((SELECT first.time_s
    FROM pages AS first WHERE first.run_id = runs.id ORDER BY first.sheet LIMIT 1), 0) AS start_s FROM runs)"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """A page with its row."""

    row: int
    """Number of its row, which grows with every page that is written."""
    run_id: int
    page: PageRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class Heads:
    """State of a journal: two of them are equal if nothing was written in between."""

    row: int
    """Row of the last page; 0: none was written."""
    run: int
    """Number of the last run; 0: none began."""
    ended: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Counted:
    """A run, counted up to a row."""

    run: RunRow
    upto: int
    last_sheet: int
    """Highest number of its sheets; -1: it has none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """Number of sheets of a run in one quarter of an hour."""

    run_id: int
    quarter: int
    """Unix time of the sheets, divided by ``QUARTER_S`` and rounded down."""
    sheets: int
    misprints: int
    not_inspected: int
    first_sheet: int
    last_sheet: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelSum:
    """Sum of one nuisance amount over the sampled sheets of a run in one quarter of an hour."""

    run_id: int
    quarter: int
    channel: str
    count: int
    total: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSpan:
    """The part of a run between two times of its source's clock; None: no bound. [s]"""

    run_id: int
    since_s: float | None = None
    until_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PageQuery:
    """Conditions on pages; None: no condition."""

    run_id: int | None = None
    verdict: str | None = None
    kind: str | None = None
    page: str | None = None
    """The page's name in the job, or the beginning of the name."""
    job: str | None = None
    """Part of the job's name."""
    press: str | None = None
    """Part of the press's name."""
    since_s: float | None = None
    """Earliest start of the run; Unix time. [s]"""
    until_s: float | None = None
    """Time before which the run began; Unix time. [s]"""
    late: bool | None = None
    first_sheet: int | None = None
    last_sheet: int | None = None
    spans: tuple[RunSpan, ...] | None = None
    """Parts of runs, of which pages of any are selected."""
    sheets: tuple[int, ...] | None = None
    """Numbers of sheets; with ``job_pages``, pages of either are selected."""
    job_pages: tuple[int, ...] | None = None
    to_review: bool = False
    """Whether to leave out pages that need no review: good, in time, without fault and note."""

    @property
    def of_runs(self) -> bool:
        """Whether there is any condition on the pages' runs."""
        return {self.job, self.press, self.since_s, self.until_s} != {None}

    def conditions(self) -> list[ColumnElement[bool]]:
        """Return the conditions as SQL."""
        page, run = stored_pages.c, stored_runs.c
        conditions: list[ColumnElement[bool]] = []
        for name in ("run_id", "verdict", "kind"):
            if (value := getattr(self, name)) is not None:
                conditions.append(page[name] == value)
        if self.page is not None:
            conditions.append(page.page.startswith(self.page, autoescape=True))
        for name in ("job", "press"):
            if (value := getattr(self, name)) is not None:
                conditions.append(run[name].contains(value, autoescape=True))
        if self.since_s is not None:
            conditions.append(run.started_s >= self.since_s)
        if self.until_s is not None:
            conditions.append(run.started_s < self.until_s)
        if self.late is not None:
            conditions.append(page.late == int(self.late))
        if self.first_sheet is not None:
            conditions.append(page.sheet >= self.first_sheet)
        if self.last_sheet is not None:
            conditions.append(page.sheet <= self.last_sheet)
        if self.sheets is not None or self.job_pages is not None:
            conditions.append(page.sheet.in_(self.sheets or ()) | page.job_page.in_(self.job_pages or ()))
        if self.spans is not None:
            conditions.append(_within(self.spans))
        if self.to_review:
            conditions.append(~rows.clearly_good())
        return conditions


class JournalFollower(JournalReader):
    """Reader of a journal that others write. JournalError as ``JournalReader``."""

    def __init__(self, path: Path, engine: Engine) -> None:
        super().__init__(path, engine)

    def close(self) -> None:
        """Close the file."""
        self._engine.dispose()

    def heads(self) -> Heads:
        """Return the state of the journal."""
        run = select(stored_runs.c.id, stored_runs.c.ended_s).order_by(stored_runs.c.id.desc()).limit(1)
        with self._reading("its position"), self._engine.begin() as connection:
            row = connection.execute(select(func.max(_row())).select_from(stored_pages)).scalar()
            last = connection.execute(run).first()
        return Heads(
            row=row if isinstance(row, int) else 0,
            run=0 if last is None else last.id,
            ended=last is not None and last.ended_s is not None,
        )

    def run_ids(self, *, before: int | None = None, limit: int = 50) -> list[int]:
        """Return the numbers of runs, the latest first; before: only lower ones."""
        run = stored_runs.c.id
        query = select(run).order_by(run.desc()).limit(limit)
        if before is not None:
            query = query.where(run < before)
        with self._reading("runs"), self._engine.begin() as connection:
            return [number for number in connection.execute(query).scalars() if isinstance(number, int)]

    def counted(self, run_id: int) -> Counted:
        """Return a run with the counts of all its pages; JournalError: there is none of that number."""

        def bad(number: object, error: ValueError) -> None:
            raise self._bad_row(f"run {number}", error)

        page = stored_pages.c
        heads = select(func.max(_row()), func.max(page.sheet)).where(page.run_id == run_id)
        with self._reading("runs"), self._engine.begin() as connection:
            lives = writer_lives(self.path)
            runs = rows.read_runs(connection, run_id, writer_lives=lives, damaged=bad)
            upto, last = connection.execute(heads).one()
        if not runs:
            raise JournalError(self.path, f"there is no run {run_id}", remedy="see `prooflight runs`")
        return Counted(run=runs[0], upto=upto or 0, last_sheet=-1 if last is None else last)

    def counted_on(self, before: Counted) -> Counted | None:
        """Return the same run with the pages written since; None: all must be counted again.

        None is returned if a sheet was recorded again, a page has a note, the run has ended, or its writer has
        ended or started.
        """
        page, run_id = stored_pages.c, before.run.id
        conditions = {
            "misprints": page.verdict == "misprint",
            "not_inspected": page.verdict == "not-inspected",
            "late": page.late == 1,
            "faulty": page.faulty == 1,
            "absent": rows.absent(),
            "noted": page.noted == 1,
        }
        sums = [func.sum(case((condition, 1), else_=0)).label(name) for name, condition in conditions.items()]
        extremes = (func.max(_row()).label("upto"), func.min(page.sheet).label("first"))
        query = select(
            func.count().label("pages"), *extremes, func.max(page.sheet).label("last"), *sums
        ).where(_row() > before.upto, page.run_id == run_id)
        ended = select(stored_runs.c.ended_s).where(stored_runs.c.id == run_id)
        with self._reading(f"pages of run {run_id}"), self._engine.begin() as connection:
            over = connection.execute(ended).scalar() is not None
            new = connection.execute(query).one()
        if over or new.noted or (before.run.state == "running") != writer_lives(self.path):
            return None
        if not new.pages:
            return before
        if new.first <= before.last_sheet:
            return None
        more = {name: getattr(before.run, name) + (getattr(new, name) or 0) for name in COUNTED}
        return Counted(run=replace(before.run, **more), upto=new.upto, last_sheet=new.last)

    def last_sheet(self, run_id: int) -> int:
        """Return the highest number of a run's sheets; -1: it has none."""
        query = select(func.max(stored_pages.c.sheet)).where(stored_pages.c.run_id == run_id)
        with self._reading(f"pages of run {run_id}"), self._engine.begin() as connection:
            last = connection.execute(query).scalar()
        return last if isinstance(last, int) else -1

    def run_rows(
        self, *, after: int, also: Collection[int] = (), damaged: Damaged = refuse
    ) -> list[RunColumns]:
        """Return the rows of runs above a number, and of these others, oldest first; their pages are not counted.

        damaged: called for each that cannot be read.
        """
        run = stored_runs.c
        query = select(stored_runs).where((run.id > after) | run.id.in_(also)).order_by(run.id)
        with self._reading("runs"), self._engine.begin() as connection:
            raw = connection.execute(query).all()
        valid = []
        for row in raw:
            try:
                valid.append(RunColumns(**row._asdict()))
            except ValueError as error:
                damaged(self._bad_row(f"run {row.id}", error))
        return valid

    def first_time_s(self, run_id: int) -> float | None:
        """Return the time of a run's first sheet, by the source's clock; None: it has none. [s]"""
        page = stored_pages.c
        query = select(page.time_s).where(page.run_id == run_id).order_by(page.sheet).limit(1)
        with self._reading(f"pages of run {run_id}"), self._engine.begin() as connection:
            time_s = connection.execute(query).scalar()
        return float(time_s) if isinstance(time_s, int | float) else None

    def evidence_files(self, *, after: int, upto: int) -> dict[int, Path]:
        """Return the file of evidence of each row above one and up to another that names a valid file."""
        rows_between = (_row() > after) & (_row() <= upto)
        return self._evidence_files(
            _row(), rows_between, lambda _: None
        )  # of an invalid name nothing is read

    def row_after(self, row: int, *, count: int) -> int:
        """Return the row that lies so many rows after one, damaged rows included, or the last if there are fewer."""
        following = select(ROW).select_from(stored_pages).where(_row() > row).order_by(_row()).limit(count)
        query = select(func.max(following.subquery().c.rowid))
        with self._reading("pages"), self._engine.begin() as connection:
            last = connection.execute(query).scalar()
        return last if isinstance(last, int) else row

    def written_after(
        self, row: int, *, run_id: int | None = None, limit: int = 500, damaged: Damaged = refuse
    ) -> list[Written]:
        """Return the pages written after a row, in that order; damaged: called for each that cannot be read."""
        query = select(ROW, stored_pages).where(_row() > row).order_by(_row()).limit(limit)
        if run_id is not None:
            query = query.where(stored_pages.c.run_id == run_id)
        return self._written(query, damaged)

    def to_review_between(
        self, *, after: int, upto: int, run_id: int | None = None, damaged: Damaged = refuse
    ) -> Iterator[Written]:
        """Yield the pages above a row and up to another that need review or were sampled.

        damaged: called for each that cannot be read.
        """
        query = select(ROW, stored_pages).where(~rows.clearly_good() | stored_pages.c.asked.is_not(None))
        if run_id is not None:
            query = query.where(stored_pages.c.run_id == run_id)
        for first in range(after, upto, AT_ONCE):  # windows of rows bound the memory
            window = (_row() > first) & (_row() <= min(first + AT_ONCE, upto))
            yield from self._written(query.where(window).order_by(_row()), damaged)

    def tallies(self, *, after: int, upto: int, run_id: int | None = None) -> list[Tally]:
        """Count the pages above a row and up to another, by run and quarter of an hour of their own time."""
        query = f"""{_STARTS} SELECT pages.run_id, CAST((starts.start_s + pages.time_s) / {QUARTER_S} AS INTEGER),
            count(*), sum(pages.verdict = 'misprint'), sum(pages.verdict = 'not-inspected'),
            min(pages.sheet), max(pages.sheet) FROM pages
            JOIN starts ON starts.id = pages.run_id
            WHERE pages.rowid > :after AND pages.rowid <= :upto{_of_run(run_id)} GROUP BY 1, 2"""
        names = ("run_id", "quarter", "sheets", "misprints", "not_inspected", "first_sheet", "last_sheet")
        values = {"after": after, "upto": upto, "run_id": run_id}
        with self._reading("pages"), self._engine.begin() as connection:
            raw = connection.execute(text(query), values).all()
        return [
            Tally(**dict(zip(names, row, strict=True))) for row in raw if all(isinstance(n, int) for n in row)
        ]

    def channel_sums(self, *, after: int, upto: int, run_id: int | None = None) -> list[ChannelSum]:
        """Add up nuisance amounts of one in ``SAMPLED_EVERY`` pages, by run, quarter of an hour and channel."""
        query = f"""{_STARTS} SELECT pages.run_id, CAST((starts.start_s + pages.time_s) / {QUARTER_S} AS INTEGER),
            amounts.key, count(*), sum(amounts.value)
            FROM pages JOIN starts ON starts.id = pages.run_id,
            json_each(CASE WHEN json_valid(pages.nuisance) THEN pages.nuisance ELSE '{{}}' END) AS amounts
            WHERE pages.rowid > :after AND pages.rowid <= :upto{_of_run(run_id)}
            AND pages.sheet % {SAMPLED_EVERY} = 0 AND amounts.type IN ('real', 'integer') GROUP BY 1, 2, 3"""
        names = ("run_id", "quarter", "channel", "count", "total")
        values = {"after": after, "upto": upto, "run_id": run_id}
        with self._reading("pages"), self._engine.begin() as connection:
            raw = connection.execute(text(query), values).all()
        return [ChannelSum(**dict(zip(names, row, strict=True))) for row in raw if isinstance(row[1], int)]

    def search(
        self, wanted: PageQuery, *, before: int | None = None, limit: int = 100, damaged: Damaged = refuse
    ) -> list[Written]:
        """Return the pages that meet the conditions, the latest written first; before: only those of lower rows."""
        conditions = wanted.conditions()
        query = select(ROW, stored_pages)
        if wanted.of_runs:
            query = query.join(stored_runs, stored_runs.c.id == stored_pages.c.run_id)
        if before is not None:
            conditions.append(_row() < before)
        return self._written(query.where(*conditions).order_by(_row().desc()).limit(limit), damaged)

    def sheets(
        self, wanted: PageQuery, *, after: int = -1, limit: int = 100, damaged: Damaged = refuse
    ) -> list[Written]:
        """Return the pages of one run by sheet; after: only those of higher numbers."""
        conditions = [*wanted.conditions(), stored_pages.c.sheet > after]
        query = select(ROW, stored_pages).where(*conditions).order_by(stored_pages.c.sheet).limit(limit)
        return self._written(query, damaged)

    def _written(self, query: Select[Any], damaged: Damaged) -> list[Written]:
        with self._reading("pages"), self._engine.begin() as connection:
            raw = connection.execute(query).all()
        pages = []
        for row in raw:
            try:
                pages.append(Written(row=row.rowid, run_id=row.run_id, page=rows.page_record(row)))
            except ValueError as error:
                damaged(self._bad_row(f"run {row.run_id}, sheet {row.sheet}", error))
        return pages


def _row() -> Any:
    """Return the row's number for use in conditions, where a label is not allowed."""
    return literal_column("pages.rowid")


def _of_run(run_id: int | None) -> str:
    return "" if run_id is None else " AND pages.run_id = :run_id"


def _within(spans: tuple[RunSpan, ...]) -> ColumnElement[bool]:
    """Return the condition that a page lies in one of these parts of runs."""
    page = stored_pages.c
    whole = [span.run_id for span in spans if span.since_s is None and span.until_s is None]
    conditions: list[ColumnElement[bool]] = [page.run_id.in_(whole)]
    for span in spans:
        if span.since_s is not None or span.until_s is not None:
            bounds = [page.run_id == span.run_id]
            bounds += [] if span.since_s is None else [page.time_s >= span.since_s]
            bounds += [] if span.until_s is None else [page.time_s < span.until_s]
            conditions.append(and_(*bounds))
    return or_(*conditions)


def follow(path: Path, *, version: str) -> JournalFollower | None:
    """Open a journal for reading while it is written; None: there is none yet. JournalError: it is no journal."""
    from prooflight_line.journal.opening import open_database

    try:
        path.lstat()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise JournalError(
            path, f"cannot be examined ({error.strerror})", remedy="give another --journal"
        ) from error
    return JournalFollower(path, open_database(path, read_only=True, version=version))
