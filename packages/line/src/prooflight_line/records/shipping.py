"""Shipping of a press's journal into the database of records: at least once, in order, idempotent.

The journal is only read. Each step is one transaction with the rows and the position up to which the journal was
read, so that a step that is cut off anywhere has either happened or not, and happens again. A sheet that was
recorded again in the journal replaces the earlier row here. A run is identified by its number and its start, as for
labels, so that a journal that was replaced or restored never mixes with the earlier one: if the page at the position
is not the page that was shipped, all is shipped again, which changes nothing that is there.
"""

from __future__ import annotations

import json
import re
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

from prooflight_line.journal.labels import LabelStore, key_of, sheet_id
from prooflight_line.journal.schema import finite, plain
from prooflight_line.records.database import RecordsError, UnreachableError, connect, first_line, shown

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path
    from typing import Self

    import psycopg

    from prooflight_line.journal.columns import RunColumns
    from prooflight_line.journal.following import JournalFollower, Written
    from prooflight_line.journal.labels import Label
    from prooflight_line.journal.schema import JournalError
    from prooflight_line.records.pictures import ObjectStore

NUL: Final = re.compile(r"(?<!\\)((?:\\\\)*)\\u0000")
"""The character NUL in JSON, where its backslash is no escaped one; PostgreSQL stores it nowhere."""
ROWS_A_STEP: Final = 1000
"""Assumed: some half a megabyte, which a slow link takes in a second or two."""
_COLUMNS: Final = (
    *(
        "run_id",
        "sheet",
        "press_id",
        "at",
        "job_page",
        "page",
        "verdict",
        "disposition",
        "decided_by",
        "kind",
    ),
    *("score", "threshold", "p_value", "probability", "late", "first_line", "faults", "notes", "details"),
    "evidence",
)
_NAMES: Final = ", ".join(_COLUMNS)
_CHANGES: Final = ", ".join(f"{name} = excluded.{name}" for name in _COLUMNS[2:])
_UPSERT: Final = (
    f"INSERT INTO sheets ({_NAMES}) SELECT {_NAMES} FROM incoming"
    f" ON CONFLICT (run_id, sheet) DO UPDATE SET {_CHANGES}"
)
_RUN: Final = """
    INSERT INTO runs (press_id, key, number, job, job_digest, press_digest, detector, source, started, sheets,
        settings, ended, ending, detail, dropped_pages, dropped_evidence, first_time_s)
    VALUES (%(press_id)s, %(key)s, %(id)s, %(job)s, %(job_digest)s, %(press_digest)s, %(detector)s, %(source)s,
        %(started)s, %(sheets)s, %(settings)s, %(ended)s, %(ending)s, %(detail)s, %(dropped_pages)s,
        %(dropped_evidence)s, %(first_time_s)s)
    ON CONFLICT (press_id, key) DO UPDATE SET ended = excluded.ended, ending = excluded.ending,
        detail = excluded.detail, dropped_pages = excluded.dropped_pages,
        dropped_evidence = excluded.dropped_evidence,
        first_time_s = coalesce(runs.first_time_s, excluded.first_time_s)
    RETURNING id, first_time_s"""
_LABEL: Final = """
    INSERT INTO labels (press_id, run_key, id, sheet, incident, label, note, by, at, upto, undoes)
    VALUES (%s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s) ON CONFLICT DO NOTHING"""


class LinkDownError(OSError):
    """The server or the store of pictures cannot be reached or cannot write now; the same step is tried again."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """Result of one step."""

    ids: tuple[str, ...] = ()
    """The sheets that were shipped, by ``labels.sheet_id``."""
    labels: int = 0
    seconds: float = 0.0
    more: bool = False
    """Whether the journal held more than one step takes."""

    @property
    def sheets(self) -> int:
        """Number of sheets that were shipped."""
        return len(self.ids)


@dataclass(frozen=True, kw_only=True)
class _Run:
    """A run as the database knows it."""

    id: int
    key: str
    started_s: float
    first_time_s: float | None


@dataclass(kw_only=True)
class Shipper:
    """The shipper of one press; ``open`` it, call ``step`` until nothing is left, and again when the journal grows."""

    url: str
    connection: psycopg.Connection[Any]
    press_id: int
    journal: JournalFollower
    pictures: ObjectStore | None
    announce: Callable[[str], None]
    _runs: dict[int, _Run] = field(default_factory=dict)
    _open_runs: set[int] = field(default_factory=set)
    _row: int = 0
    _label: int = 0

    @classmethod
    def open(
        cls,
        url: str,
        *,
        press: str,
        plant: str,
        journal: JournalFollower,
        pictures: ObjectStore | None = None,
        announce: Callable[[str], None],
    ) -> Self:
        """Connect, and find the position. RecordsError: not to be used; UnreachableError, LinkDownError: not now.

        press: the press's name, unique among all; announce: called with a line about rows that cannot be shipped.
        """
        connection = connect(url)
        try:
            with _link(url):
                _take_press(connection, url, press)
                press_id, row, page, label = _position(connection, press, plant)
            shipper = cls(
                url=url,
                connection=connection,
                press_id=press_id,
                journal=journal,
                pictures=pictures,
                announce=announce,
            )
            shipper._row = row if row and shipper._page_at(row) == page else 0
            shipper._label = label if LabelStore(journal.path).last() >= label else 0
            shipper._read_runs()
        except BaseException:
            connection.close()
            raise
        return shipper

    def close(self) -> None:
        """Close the connection."""
        self.connection.close()

    @property
    def waiting_rows(self) -> int:
        """Number of rows that the journal has written since the last one that was shipped, at most."""
        return max(0, self.journal.heads().row - self._row)

    def step(self) -> Step:
        """Ship the next rows and labels, in one transaction. LinkDownError: nothing happened, try again later.

        RecordsError: the server refuses what no repetition would change. JournalError: the journal cannot be read.
        """
        begun_s = time.monotonic()
        upto = self.journal.row_after(self._row, count=ROWS_A_STEP)
        damaged: list[JournalError] = []
        written = self.journal.written_after(self._row, limit=ROWS_A_STEP, damaged=damaged.append)
        written = [one for one in written if one.row <= upto]  # not what was written since the line before
        labels = LabelStore(self.journal.path).written_after(self._label, limit=ROWS_A_STEP)
        runs = self.journal.run_rows(after=max(self._runs, default=0), also=self._open_runs)
        runs = [run for run in runs if self._changed(run)]
        if upto == self._row and not (labels or runs):
            return Step()
        evidence = self._stored_evidence(written)
        before = dict(self._runs), set(self._open_runs)
        try:
            with _link(self.url), self.connection.transaction():
                self._write_runs(runs)
                self._write_sheets(written, evidence)
                for label in labels:
                    self.connection.execute(_LABEL, self._label_row(label))
                # At a damaged row there is no page to compare with: a later shipper ships all again.
                whole = bool(written) and written[-1].row == upto
                page = None if upto == self._row else self._page_of(written[-1]) if whole else ""
                last = labels[-1].id if labels else self._label
                self.connection.execute(
                    "UPDATE presses SET shipped_row = %s, shipped_page = coalesce(%s, shipped_page),"
                    " shipped_label = %s, shipped_at = now() WHERE id = %s",
                    (upto, page, last, self.press_id),
                )
        except BaseException:
            self._runs, self._open_runs = before
            raise
        self._row, self._label = upto, last
        for error in damaged:
            self.announce(str(error))
        return Step(
            ids=tuple(
                sheet_id(run.key, one.page.sheet)
                for one in written
                if (run := self._runs.get(one.run_id)) is not None
            ),
            labels=len(labels),
            seconds=time.monotonic() - begun_s,
            more=len(written) + len(damaged) == ROWS_A_STEP or len(labels) == ROWS_A_STEP,
        )

    def note_reach(self) -> None:
        """Note that the press is within reach, though there is nothing to ship. LinkDownError: it is not."""
        with _link(self.url):
            self.connection.execute("UPDATE presses SET shipped_at = now() WHERE id = %s", (self.press_id,))

    # --- inside ---

    def _read_runs(self) -> None:
        """Read which runs of this journal the database knows, and which of them had not ended."""
        keys = {key_of(run.id, run.started_s): run for run in self.journal.run_rows(after=0)}
        query = "SELECT id, key, ended IS NULL, first_time_s FROM runs WHERE press_id = %s"
        with _link(self.url):
            for number, key, unfinished, first_time_s in self.connection.execute(query, (self.press_id,)):
                if (run := keys.get(key)) is not None:
                    self._runs[run.id] = _Run(
                        id=number, key=key, started_s=run.started_s, first_time_s=first_time_s
                    )
                    if unfinished:
                        self._open_runs.add(run.id)
        # A run between two that are known was never shipped: one after the other would miss it.
        self._open_runs |= {run.id for run in keys.values() if run.id not in self._runs}

    def _changed(self, run: RunColumns) -> bool:
        shipped = self._runs.get(run.id)
        return shipped is None or run.ended_s is not None or shipped.first_time_s is None

    def _write_runs(self, runs: Sequence[RunColumns]) -> None:
        for run in runs:
            row = run.model_dump() | {
                "press_id": self.press_id,
                "key": key_of(run.id, run.started_s),
                "started": moment(run.started_s),
                "settings": json_text(run.settings),
                "ended": None if run.ended_s is None else moment(run.ended_s),
                "first_time_s": self.journal.first_time_s(run.id),
            }
            row = {name: plain_text(value) for name, value in row.items()}
            stored = self.connection.execute(_RUN, row).fetchone()
            assert stored is not None
            self._runs[run.id] = _Run(
                id=stored[0], key=row["key"], started_s=run.started_s, first_time_s=stored[1]
            )
            (self._open_runs.discard if run.ended_s is not None else self._open_runs.add)(run.id)

    def _write_sheets(self, written: Sequence[Written], evidence: dict[int, str]) -> None:
        if not written:
            return
        self.connection.execute("CREATE TEMP TABLE incoming (LIKE sheets) ON COMMIT DROP")
        with self.connection.cursor().copy(f"COPY incoming ({_NAMES}) FROM STDIN") as copy:
            for one in written:
                if (run := self._runs.get(one.run_id)) is not None:
                    copy.write_row(self._sheet_row(run, one, evidence.get(one.row)))
        self.connection.execute(_UPSERT)

    def _sheet_row(self, run: _Run, one: Written, evidence: str | None) -> tuple[Any, ...]:
        page, verdict = one.page, one.page.verdict
        since_s = 0.0 if run.first_time_s is None else page.time_s - run.first_time_s
        values = (
            *(run.id, page.sheet, self.press_id, moment(run.started_s + since_s), page.job_page),
            *(verdict.page, verdict.verdict, page.disposition, page.decided_by, verdict.kind),
            *(verdict.score, verdict.threshold, verdict.p_value, verdict.probability, page.late),
            *(page.first_line, json_text(page.faults), json_text(page.notes), _details(one), evidence),
        )
        return tuple(plain_text(value) for value in values)

    def _stored_evidence(self, written: Sequence[Written]) -> dict[int, str]:
        """Store the evidence of these rows as objects; return their digests by row. LinkDownError."""
        if self.pictures is None or not written:
            return {}
        files = self.journal.evidence_files(after=self._row, upto=written[-1].row)
        digests: dict[Path, str | None] = {}
        for file in files.values():
            if file not in digests:
                try:
                    digests[file] = self.pictures.put(file)
                except OSError as error:
                    raise LinkDownError(str(error)) from error
        return {row: digest for row, file in files.items() if (digest := digests[file]) is not None}

    def _label_row(self, label: Label) -> tuple[Any, ...]:
        values = (
            *(self.press_id, label.run, label.id, label.sheet, label.incident, label.word, label.note),
            *(label.by, moment(label.at_s), label.upto, label.undoes),
        )
        return tuple(plain_text(value) for value in values)

    def _page_at(self, row: int) -> str | None:
        pages = self.journal.written_after(row - 1, limit=1, damaged=lambda error: None)
        return self._page_of(pages[0]) if pages and pages[0].row == row else None

    def _page_of(self, one: Written) -> str:
        runs = self.journal.run_rows(after=one.run_id - 1)[:1]
        keys = [key_of(run.id, run.started_s) for run in runs]
        return f"{''.join(keys)}/{one.page.sheet}/{one.page.time_s!r}"


def moment(unix_s: float) -> datetime:
    """Return a Unix time as PostgreSQL takes it; times that it cannot hold become the year 1970. [s]"""
    try:
        return datetime.fromtimestamp(unix_s, UTC)
    except (ValueError, OverflowError, OSError):
        return datetime.fromtimestamp(0, UTC)


def plain_text(value: Any) -> Any:
    """Replace the character NUL in texts, which PostgreSQL stores nowhere."""
    return value.replace("\0", "\N{REPLACEMENT CHARACTER}") if isinstance(value, str) else value


def json_text(value: Any) -> str:
    """Return JSON as PostgreSQL takes it: without the character NUL, and null for numbers that are not finite."""
    return NUL.sub(r"\1\\ufffd", json.dumps(finite(value), allow_nan=False))


def _details(one: Written) -> str | None:
    """Return what a person needs to see of a sheet that is not good; of good ones the journal has the rest."""
    if one.page.verdict.verdict == "good":
        return None
    return json_text(plain(one.page.verdict))


def _position(connection: psycopg.Connection[Any], press: str, plant: str) -> tuple[int, int, str, int]:
    """Return a press's number, and row, page and label up to which it was shipped; add it if it is new."""
    values = (plant, press)
    columns = "RETURNING id, shipped_row, shipped_page, shipped_label"
    # Not by ON CONFLICT, which would use up a number at each connection.
    row = connection.execute(f"UPDATE presses SET plant = %s WHERE name = %s {columns}", values).fetchone()
    if row is None:
        new = f"INSERT INTO presses (plant, name) VALUES (%s, %s) {columns}"
        row = connection.execute(new, values).fetchone()
    assert row is not None
    number, shipped_row, page, label = row
    return number, shipped_row, page, label


def _take_press(connection: psycopg.Connection[Any], url: str, press: str) -> None:
    """Let no other process ship the same press while this connection lives; UnreachableError: one still does."""
    query = "SELECT pg_try_advisory_lock(hashtext('prooflight press'), hashtext(%s))"
    taken = connection.execute(query, (press,)).fetchone()
    if taken is None or not taken[0]:
        remedy = "end that process, or give this press its own name with --press"
        raise UnreachableError(shown(url), f"another process ships press {press!r}", remedy=remedy)


@contextmanager
def _link(url: str) -> Iterator[None]:
    """Convert errors that pass (no connection, a full disk, a server that restarts) to LinkDownError, others not."""
    import psycopg

    try:
        yield
    except (psycopg.OperationalError, psycopg.InterfaceError) as error:
        raise LinkDownError(f"{shown(url)}: {first_line(error)}") from error
    except psycopg.Error as error:
        remedy = "run `prooflight records upgrade`, or see the server's log"
        raise RecordsError(shown(url), f"refuses the rows ({first_line(error)})", remedy=remedy) from error
