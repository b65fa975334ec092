"""An index of the journal for searches and statistics over all runs, in a file next to the console's own.

The journal answers questions about one run. The index stores what questions over all runs need: each sheet that needs
review, with its own time, its defects and the label in force; and the number of all sheets by run and quarter of an
hour. It is derived from the journal and from the labels: it follows both row by row, and a file that is missing,
damaged, of another schema or of another journal is replaced by a new one.

A sheet that is recorded again has a number that its run has passed; then this run is indexed anew.
"""

from __future__ import annotations

import contextlib
import sqlite3
import threading
import time
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight_console.problems import Problem
from prooflight_line.journal.labels import Labels, key_of, run_key
from prooflight_line.journal.rows import needs_no_review

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from prooflight_console.reading.incidents import RunIncidents
    from prooflight_console.reading.runs import Reading
    from prooflight_line.journal.columns import RunColumns
    from prooflight_line.journal.following import JournalFollower, Written
    from prooflight_line.journal.labels import LabelStore
    from prooflight_line.journal.schema import JournalError

SCHEMA: Final = 1
SUFFIX: Final = ".search"
ROWS_A_STEP: Final = 50_000
"""Rows of the journal in one transaction: some tenths of a second, during which nothing else is delayed."""
BUSY_S: Final = 10.0
MOST_LABELS: Final = 5000
_TABLES: Final = (
    "CREATE TABLE position (schema INTEGER, row INTEGER, page TEXT, label INTEGER, damaged INTEGER)",
    "CREATE TABLE runs (id INTEGER PRIMARY KEY, key TEXT, job TEXT, press TEXT, digest TEXT, customer TEXT,"
    " started_s REAL, start_s REAL, last_sheet INTEGER, ended INTEGER)",
    "CREATE TABLE sheets (run_id INTEGER, sheet INTEGER, row INTEGER, at_s REAL, page TEXT, verdict TEXT, kind TEXT,"
    " to_review INTEGER, accepted INTEGER, size_mm REAL, label TEXT, PRIMARY KEY (run_id, sheet)) WITHOUT ROWID",
    "CREATE INDEX sheets_by_time ON sheets (at_s)",
    "CREATE INDEX sheets_by_verdict ON sheets (verdict, at_s)",
    "CREATE INDEX sheets_by_kind ON sheets (kind, at_s)",
    "CREATE INDEX sheets_by_label ON sheets (label, at_s) WHERE label IS NOT NULL",
    "CREATE TABLE defects (run_id INTEGER, sheet INTEGER, number INTEGER, kind TEXT, ink TEXT, x_mm REAL, y_mm REAL,"
    " width_mm REAL, height_mm REAL, PRIMARY KEY (run_id, sheet, number)) WITHOUT ROWID",
    # Holds all columns, so that a place is sought in the index alone.
    "CREATE INDEX defects_by_ink ON defects (ink, kind, x_mm, y_mm, width_mm, height_mm)",
    "CREATE TABLE counts (run_id INTEGER, quarter INTEGER, sheets INTEGER, misprints INTEGER, not_inspected INTEGER,"
    " PRIMARY KEY (run_id, quarter)) WITHOUT ROWID",
    "CREATE TABLE amounts (run_id INTEGER, quarter INTEGER, channel TEXT, count INTEGER, total REAL,"
    " PRIMARY KEY (run_id, quarter, channel)) WITHOUT ROWID",
)
_OF_RUNS: Final = ("runs", "sheets", "defects", "counts", "amounts")
_ADD_COUNTS: Final = """INSERT INTO counts VALUES (?, ?, ?, ?, ?) ON CONFLICT DO UPDATE SET
    sheets = sheets + excluded.sheets, misprints = misprints + excluded.misprints,
    not_inspected = not_inspected + excluded.not_inspected"""
_ADD_AMOUNTS: Final = """INSERT INTO amounts VALUES (?, ?, ?, ?, ?) ON CONFLICT DO UPDATE SET
    count = count + excluded.count, total = total + excluded.total"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How far the index has got."""

    row: int
    last_row: int
    left_s: float | None
    """Time that the rest takes at the speed so far; None: it is not known yet. [s]"""

    @property
    def percent(self) -> int:
        """Share of the rows that are indexed. [%]"""
        return 100 * self.row // max(self.last_row, 1)


class SearchIndex:
    """The index of one journal; safe for several threads. JournalError if the journal cannot be read."""

    def __init__(
        self, path: Path, reading: Reading, incidents: RunIncidents, label_store: LabelStore
    ) -> None:
        self.path = path
        self._reading, self._incidents, self._label_store = reading, incidents, label_store
        self._guard = threading.Lock()
        self._seen: tuple[object, int] | None = None
        self._checked = False
        self._begun: tuple[float, int] | None = None
        self._closing = threading.Event()
        self.progress: Progress | None = None
        """How far it has got; None: it is complete."""

    # --- following the journal ---

    def follow(self, *, every_s: float = 2.0) -> None:
        """Keep the index up to date until ``close``; for a thread of its own."""
        while not self._closing.is_set():
            more = False
            with contextlib.suppress(Exception):  # the page that needs the index reports what is wrong
                more = self.step()
            self._closing.wait(0.0 if more else every_s)

    def close(self) -> None:
        """End ``follow``."""
        self._closing.set()

    def catch_up(self, *, within_s: float = 1.0) -> bool:
        """Index what is new, for about as long; return whether it is complete."""
        until = time.monotonic() + within_s
        while self.step():
            if time.monotonic() > until:
                return False
        return True

    def step(self) -> bool:
        """Index the next rows and labels of the journal in one transaction; return whether more is left."""
        with self._guard:
            follower = self._reading.follower
            if follower is None:
                return False
            heads, last_label = follower.heads(), self._label_store.last()
            if self._seen == (heads, last_label):
                return False
            with self._writing() as connection:
                upto, label = self._advance(connection, follower, heads.row, last_label)
            more = upto < heads.row or label < last_label
            self._seen = None if more else (heads, last_label)
            self._note_progress(upto, heads.row, more=more)
            return more

    def _note_progress(self, row: int, last_row: int, *, more: bool) -> None:
        now = time.monotonic()
        if not more:
            self._begun = self.progress = None
            return
        if self._begun is None:
            self._begun = now, row
        rows, seconds = row - self._begun[1], now - self._begun[0]
        left_s = seconds * (last_row - row) / rows if rows > 0 else None
        self.progress = Progress(row=row, last_row=last_row, left_s=left_s)

    def _advance(
        self, connection: sqlite3.Connection, follower: JournalFollower, last_row: int, last_label: int
    ) -> tuple[int, int]:
        """Index some rows; return the row and the label up to which the index then reaches."""
        row, page, label = connection.execute("SELECT row, page, label FROM position").fetchone()
        if row > last_row or (not self._checked and row and self._page_at(row) != page):
            for table in _OF_RUNS:
                connection.execute(f"DELETE FROM {table}")
            connection.execute("UPDATE position SET damaged = 0")
            row, label = 0, 0
        self._checked = True
        self._write_runs(connection, follower)
        upto = min(last_row, row + ROWS_A_STEP)
        touched = self._write_rows(connection, follower, after=row, upto=upto)
        upto_label = label
        if upto == last_row:
            upto_label = self._write_labels(connection, touched, after=label)
        page = self._page_at(upto) if upto != row else page
        connection.execute("UPDATE position SET row = ?, page = ?, label = ?", (upto, page, upto_label))
        return upto, last_label if upto_label >= last_label else upto_label

    def _write_runs(self, connection: sqlite3.Connection, follower: JournalFollower) -> None:
        """Add new runs, note which have ended, and remove those that the journal no longer has."""
        indexed = dict(connection.execute("SELECT id, key FROM runs"))
        pending = [n for (n,) in connection.execute("SELECT id FROM runs WHERE NOT ended OR start_s IS NULL")]
        present = set(follower.run_ids(limit=2**31))
        for number in indexed.keys() - present:
            self._remove(connection, number)
        for run in follower.run_rows(
            after=max(indexed.keys() & present, default=0), also=pending, damaged=lambda _: None
        ):
            self._write_run(connection, follower, run, indexed.get(run.id))

    def _write_run(
        self,
        connection: sqlite3.Connection,
        follower: JournalFollower,
        run: RunColumns,
        key_before: str | None,
    ) -> None:
        key = key_of(run.id, run.started_s)
        if key_before is not None and key_before != key:
            self._remove(connection, run.id)
            key_before = None
        first_s = follower.first_time_s(run.id)
        start_s = None if first_s is None else run.started_s - first_s
        if key_before is not None:
            values = (start_s, run.ended_s is not None, run.id)
            connection.execute("UPDATE runs SET start_s = ?, ended = ? WHERE id = ?", values)
            return
        customer = run.settings.get("customer")
        connection.execute(
            "INSERT INTO runs VALUES (?, ?, ?, ?, ?, ?, ?, ?, -1, ?)",
            (
                *(run.id, key, run.job, run.press, run.press_digest),
                *(customer if isinstance(customer, str) else "", run.started_s, start_s),
                run.ended_s is not None,
            ),
        )

    def _write_rows(
        self, connection: sqlite3.Connection, follower: JournalFollower, *, after: int, upto: int
    ) -> set[int]:
        """Index the journal's rows above one and up to another; return the runs that got sheets to review."""
        if upto <= after:
            return set()
        runs = {
            n: (0.0 if s is None else s, last)
            for n, s, last in connection.execute("SELECT id, start_s, last_sheet FROM runs")
        }
        tallies = [one for one in follower.tallies(after=after, upto=upto) if one.run_id in runs]
        first: dict[int, int] = {}
        last: dict[int, int] = {}
        for one in tallies:
            first[one.run_id] = min(first.get(one.run_id, one.first_sheet), one.first_sheet)
            last[one.run_id] = max(last.get(one.run_id, -1), one.last_sheet)
        again = {number for number, sheet in first.items() if sheet <= runs[number][1]}
        for number in again:
            for table in _OF_RUNS[1:]:
                connection.execute(f"DELETE FROM {table} WHERE run_id = ?", (number,))
        # Of a run that is indexed anew all rows are read, of the others the new ones.
        parts: list[tuple[int, int | None]] = [(0, number) for number in again]
        if first.keys() - again:
            parts.append((after, None))
        touched: set[int] = set()
        damaged: list[JournalError] = []
        for begin, only in parts:
            counted = tallies if only is None else follower.tallies(after=begin, upto=upto, run_id=only)
            sums = follower.channel_sums(after=begin, upto=upto, run_id=only)
            review = follower.to_review_between(
                after=begin, upto=upto, run_id=only, damaged=damaged.append if only is None else _nothing
            )
            skip: set[int] = again if only is None else set()
            connection.executemany(
                _ADD_COUNTS,
                [
                    (t.run_id, t.quarter, t.sheets, t.misprints, t.not_inspected)
                    for t in counted
                    if t.run_id not in skip
                ],
            )
            connection.executemany(
                _ADD_AMOUNTS,
                [
                    (s.run_id, s.quarter, s.channel, s.count, s.total)
                    for s in sums
                    if s.run_id in runs and s.run_id not in skip
                ],
            )
            for written in review:
                if written.run_id in runs and written.run_id not in skip:
                    _write_sheet(connection, written, runs[written.run_id][0])
                    touched.add(written.run_id)
        connection.execute("UPDATE position SET damaged = damaged + ?", (len(damaged),))
        for number, sheet in last.items():
            connection.execute(
                "UPDATE runs SET last_sheet = max(last_sheet, ?) WHERE id = ?", (sheet, number)
            )
        return touched

    def _write_labels(self, connection: sqlite3.Connection, touched: set[int], *, after: int) -> int:
        """Write the labels in force of runs with new labels, and of labelled runs with new sheets."""
        labels = self._label_store.written_after(after, limit=MOST_LABELS)
        keys = {one.run for one in labels}
        labelled = {
            n for (n,) in connection.execute("SELECT DISTINCT run_id FROM sheets WHERE label NOT NULL")
        }
        wanted = [
            number
            for number, key in connection.execute("SELECT id, key FROM runs")
            if key in keys or number in labelled & touched
        ]
        for number in wanted:
            self._label_run(connection, number)
        return labels[-1].id if labels else after

    def _label_run(self, connection: sqlite3.Connection, number: int) -> None:
        run = self._reading.run(number)
        label_of = self._incidents.labels(run)
        (start_s,) = connection.execute("SELECT start_s FROM runs WHERE id = ?", (number,)).fetchone()
        present = dict(connection.execute("SELECT sheet, label FROM sheets WHERE run_id = ?", (number,)))
        for sheet in set(Labels(self._label_store.of_run(run_key(run))).sheets) - present.keys():
            with contextlib.suppress(Problem):  # of a sheet that the journal does not have
                written = self._reading.written(number, sheet)
                _write_sheet(connection, written, start_s or 0.0)
                present[sheet] = None
        changes = []
        for sheet, label in present.items():
            given = label_of(sheet)
            if (word := None if given is None else given.word) != label:
                changes.append((word, number, sheet))
        connection.executemany("UPDATE sheets SET label = ? WHERE run_id = ? AND sheet = ?", changes)

    def _remove(self, connection: sqlite3.Connection, number: int) -> None:
        connection.execute("DELETE FROM runs WHERE id = ?", (number,))
        for table in _OF_RUNS[1:]:
            connection.execute(f"DELETE FROM {table} WHERE run_id = ?", (number,))

    def _page_at(self, row: int) -> str:
        """Return what identifies the page of a row; empty if there is none."""
        rows = self._reading.written_after(row - 1, limit=1, damaged=lambda _: None)
        if not rows or rows[0].row != row:
            return ""
        return f"{rows[0].run_id}/{rows[0].page.sheet}/{rows[0].page.time_s!r}"

    @property
    def damaged(self) -> int:
        """Number of sheets to review that cannot be read, and are therefore left out."""
        return sum(number for (number,) in self.query("SELECT damaged FROM position"))

    # --- the file ---

    def query(self, sql: str, values: Sequence[Any] = ()) -> list[tuple[Any, ...]]:
        """Return the rows of a query; none if nothing was indexed yet."""
        if not self.path.exists():
            return []
        uri = f"{self.path.absolute().as_uri()}?mode=ro"
        with closing(sqlite3.connect(uri, uri=True, timeout=BUSY_S)) as connection:
            connection.execute("PRAGMA mmap_size = 268435456")
            return connection.execute(sql, values).fetchall()

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        with closing(self._opened()) as connection:
            connection.execute("BEGIN IMMEDIATE")
            try:
                yield connection
            except BaseException:
                connection.execute("ROLLBACK")
                raise
            connection.execute("COMMIT")

    def _opened(self) -> sqlite3.Connection:
        """Open the file; one that cannot be used is replaced, as nothing in it is lost."""
        for attempt in range(2):
            connection = sqlite3.connect(self.path, timeout=BUSY_S, isolation_level=None)
            try:
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute("PRAGMA synchronous = NORMAL")
                tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
                if not tables:
                    self._create(connection)
                if connection.execute("SELECT schema FROM position").fetchone() == (SCHEMA,):
                    return connection
            except sqlite3.OperationalError as error:
                if "locked" in str(error) or attempt:
                    connection.close()
                    raise
            except sqlite3.DatabaseError:
                if attempt:
                    connection.close()
                    raise
            connection.close()
            for suffix in ("", "-wal", "-shm"):
                self.path.with_name(self.path.name + suffix).unlink(missing_ok=True)
        raise AssertionError  # a new file has this schema

    def _create(self, connection: sqlite3.Connection) -> None:
        connection.execute("BEGIN IMMEDIATE")
        for statement in _TABLES:
            connection.execute(statement)
        connection.execute("INSERT INTO position VALUES (?, 0, '', 0, 0)", (SCHEMA,))
        connection.execute("COMMIT")


def _nothing(_error: JournalError) -> None:
    """Ignore a damaged row of a run that is indexed anew: it was counted before."""


def _write_sheet(connection: sqlite3.Connection, written: Written, start_s: float) -> None:
    """Write a sheet and its defects. start_s: Unix time at the zero of the source's clock. [s]"""
    page, verdict = written.page, written.page.verdict
    key = written.run_id, page.sheet
    sizes = [max(region.width_mm, region.height_mm) for region in verdict.regions]
    connection.execute(
        "INSERT OR REPLACE INTO sheets VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, NULL)",
        (
            *(*key, written.row, start_s + page.time_s, verdict.page, verdict.verdict, verdict.kind),
            *(not needs_no_review(page), page.disposition == "accept", max(sizes, default=None)),
        ),
    )
    connection.executemany(
        "INSERT OR REPLACE INTO defects VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
        [
            (*key, number, one.kind, one.ink, one.x_mm, one.y_mm, one.width_mm, one.height_mm)
            for number, one in enumerate(verdict.regions)
        ],
    )
