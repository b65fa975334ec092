"""People's labels of sheets and incidents, in one append-only file next to the journal.

A label on an incident covers the sheets that the person saw: those up to ``upto``. A label is undone by another
row that names it; of the remaining ones, the last is in force. A label states what a misprint was. A sheet that
was not inspected is good only if a person has vouched for it, one sheet at a time and with a reason.

A legal hold of a run is a row as well, and so is its end: who, when, why. Tidying removes nothing of a run on hold.

The file is separate from the journal because a process that watches a press holds the journal's lock, while
labels come from the console, from programs and from the command line. SQLite lets one process write at a time and
keeps others waiting. A run is identified by its number and its start, so that labels stay with their run if a
journal restarts with run 1. Tidying the journal does not touch labels: press artefacts depend on them.

Schema history:
1: words.
2: ``upto`` and ``undoes``; a file of schema 1 gets them when a word is added.
   Its labels on incidents cover all sheets.
"""

from __future__ import annotations

import os
import sqlite3
import unicodedata
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import RequestError
from prooflight_line.journal.opening import why
from prooflight_line.journal.schema import JournalError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from prooflight_line.journal.records import RunRow

SCHEMA: Final = 2
BUSY_S: Final = 10.0
SUFFIX: Final = ".words.sqlite"
MISPRINT, GOOD, FALSE_ALARM, UNKNOWN, SEEN = ("misprint", "good", "false-alarm", "unknown", "seen")
LABELS: Final = (MISPRINT, GOOD, FALSE_ALARM, UNKNOWN, SEEN)
"""Labels that may be given; false-alarm: good, for an incident; seen: acknowledged, so that it sounds no
more, without a statement about the sheet."""
VOUCHED: Final = "vouched"
"""Label of a single sheet that a person has in hand and found good."""
UNDONE: Final = "undone"
"""Label of a row that withdraws the label it names."""
HOLD, LIFTED = ("hold", "lifted")
"""Rows of a run: a legal hold, and its end."""
NO_LABEL: Final = frozenset({UNDONE, HOLD, LIFTED})
"""Rows that are no label of a sheet or an incident."""
OF_GOOD: Final = frozenset({GOOD, FALSE_ALARM, VOUCHED})
MOST_NOTE: Final = 1000
MOST_NAME: Final = 60
ANOTHER: Final = "move it away, and enter its labels again"
_TABLES: Final = (
    "CREATE TABLE store (kind TEXT NOT NULL, schema INTEGER NOT NULL)",
    "CREATE TABLE words (id INTEGER PRIMARY KEY, run TEXT NOT NULL, sheet INTEGER, incident TEXT, word TEXT NOT NULL,"
    ' note TEXT NOT NULL, "by" TEXT NOT NULL, at_s REAL NOT NULL, upto INTEGER, undoes INTEGER)',
    "CREATE INDEX words_of_runs ON words (run, id)",
    *(
        f"CREATE TRIGGER words_{way} BEFORE {way} ON words BEGIN SELECT RAISE(ABORT, 'words is append-only'); END"
        for way in ("update", "delete")
    ),
)
_SINCE_2: Final = ("upto", "undoes")
_COLUMNS: Final = ("id", "run", "sheet", "incident", "word", "note", '"by"', "at_s")
_KIND: Final = "prooflight words"


@dataclass(frozen=True, slots=True, kw_only=True)
class Label:
    """A label of a sheet or an incident, by a person."""

    id: int
    run: str
    """Key of the run, by ``run_key``."""
    sheet: int | None
    incident: str | None
    word: str
    note: str
    by: str
    at_s: float
    """Unix time. [s]"""
    upto: int | None = None
    """The last sheet of an incident that the person saw; None: all of them."""
    undoes: int | None = None

    def covers(self, sheet: int) -> bool:
        """Return whether the person saw this sheet of the incident."""
        return self.upto is None or sheet <= self.upto


def run_key(run: RunRow) -> str:
    """Return the key by which labels identify a run, distinct even if a journal restarts with run 1."""
    return key_of(run.id, run.facts.started_s)


def key_of(run_id: int, started_s: float) -> str:
    """Return ``run_key`` of a run with this number and start, in Unix time. [s]"""
    return f"{run_id}@{started_s:.0f}"


def sheet_id(key: str, sheet: int) -> str:
    """Return the name of a sheet of the run with this key, by which logs and traces of all processes know it."""
    return f"{key}/{sheet}"


def labels_path(journal: Path) -> Path:
    """Return the file of the labels of a journal's sheets."""
    return journal.with_name(journal.name + SUFFIX)


class LabelStore:
    """Labels of one journal's sheets; safe for several threads and processes. JournalError: the file is unusable."""

    def __init__(self, journal: Path) -> None:
        self.path = labels_path(journal)

    def say(
        self,
        label: str,
        *,
        run: str,
        by: str,
        at_s: float,
        sheet: int | None = None,
        incident: str | None = None,
        note: str = "",
        upto: int | None = None,
    ) -> Label:
        """Add a label, durable when this returns. RequestError: there is no such label, or the name is invalid.

        at_s: Unix time. [s] upto: for an incident, the last of its sheets that the person saw; None: all of them.
        """
        if label not in LABELS:
            raise RequestError("word", f"there is no label {label[:40]!r}", remedy=f"use {', '.join(LABELS)}")
        label = FALSE_ALARM if label == GOOD and incident is not None else label
        fields = {"run": run, "sheet": sheet, "incident": incident, "word": label, "note": note, "upto": upto}
        return self._add(fields, by=by, at_s=at_s)

    def say_of_incidents(
        self, label: str, *, run: str, by: str, at_s: float, upto: Mapping[int, int]
    ) -> list[Label]:
        """Add one label to several incidents, all or none. RequestError: as ``say``.

        at_s: Unix time. [s] upto: by incident, the last of its sheets that the person saw.
        """
        if label not in LABELS:
            raise RequestError("word", f"there is no label {label[:40]!r}", remedy=f"use {', '.join(LABELS)}")
        rows = [
            {"run": run, "incident": str(number), "word": label, "upto": last}
            for number, last in upto.items()
        ]
        return self._add_all(rows, by=by, at_s=at_s)

    def say_of_sheets(
        self, sheets: Mapping[str, Mapping[str, Sequence[int]]], *, by: str, at_s: float, note: str = ""
    ) -> list[Label]:
        """Add labels to many sheets, all or none. RequestError: as ``say``.

        sheets: numbers of sheets by label, and by the key of their run; at_s: Unix time. [s]
        """
        for label in sheets.keys() - set(LABELS):
            raise RequestError("word", f"there is no label {label[:40]!r}", remedy=f"use {', '.join(LABELS)}")
        rows = [
            {"run": run, "sheet": sheet, "word": label, "note": note}
            for label, runs in sheets.items()
            for run, numbers in runs.items()
            for sheet in numbers
        ]
        return self._add_all(rows, by=by, at_s=at_s)

    def undo_between(self, first: int, last: int, *, by: str, at_s: float) -> list[Label]:
        """Undo all labels of sheets that a person gave with these numbers and that are in force, all or none.

        RequestError: there is none, or one is somebody else's. at_s: Unix time. [s]
        """
        given = self._read("id BETWEEN ? AND ? AND sheet IS NOT NULL ORDER BY id", (first, last))
        undone = {one.undoes for one in self._read("undoes BETWEEN ? AND ?", (first, last))}
        rows = [
            {"run": one.run, "sheet": one.sheet, "word": UNDONE, "undoes": one.id}
            for one in given
            if one.word not in NO_LABEL and one.id not in undone
        ]
        if not rows or any(one.by != by for one in given):
            raise RequestError(
                "word",
                f"none of yours from {first} to {last} is in force",
                remedy="see the labels of the run",
            )
        return self._add_all(rows, by=by, at_s=at_s)

    def vouch(self, *, run: str, sheet: int, by: str, at_s: float, reason: str) -> Label:
        """Add the label that a person has this sheet in hand and that it is good. RequestError: no reason is given.

        at_s: Unix time. [s]
        """
        if not reason.strip():
            remedy = "state in a few words how you know that the sheet is good"
            raise RequestError("reason", f"none is given for sheet {sheet}", remedy=remedy)
        fields = {"run": run, "sheet": sheet, "word": VOUCHED, "note": " ".join(reason.split())}
        return self._add(fields, by=by, at_s=at_s)

    def hold(self, *, run: str, by: str, at_s: float, reason: str, lift: bool = False) -> Label:
        """Put a run on legal hold, or lift it. RequestError: no reason is given, or it is so already.

        at_s: Unix time. [s]
        """
        if not reason.strip():
            raise RequestError("reason", "none is given", remedy="state the reason in a few words")
        if (run in self.on_hold()) != lift:
            what = "is not on hold" if lift else "is on hold already"
            raise RequestError(f"run {run.partition('@')[0]}", what, remedy="see `prooflight run show`")
        fields = {"run": run, "word": LIFTED if lift else HOLD, "note": " ".join(reason.split())}
        return self._add(fields, by=by, at_s=at_s)

    def on_hold(self) -> dict[str, Label]:
        """Return the legal holds in force, by the key of their run."""
        holds = self._read("word IN (?, ?) ORDER BY id", (HOLD, LIFTED))
        return {run: one for run, one in {one.run: one for one in holds}.items() if one.word == HOLD}

    def undo(self, number: int, *, run: str, by: str, at_s: float) -> Label:
        """Undo a label. RequestError: no such label of this run is in force.

        number: of the label; at_s: Unix time. [s]
        """
        in_force = {one.id: one for one in standing(self.of_run(run))}
        if number not in in_force:
            remedy = "see the labels of the run"
            raise RequestError("word", f"no label {number} of the run is in force", remedy=remedy)
        one = in_force[number]
        fields = {"run": run, "sheet": one.sheet, "incident": one.incident, "word": UNDONE, "undoes": number}
        return self._add(fields, by=by, at_s=at_s)

    def _add(self, fields: Mapping[str, Any], *, by: str, at_s: float) -> Label:
        (label,) = self._add_all([fields], by=by, at_s=at_s)
        return label

    def _add_all(self, rows: Sequence[Mapping[str, Any]], *, by: str, at_s: float) -> list[Label]:
        name = unicodedata.normalize("NFC", " ".join(by.split()))
        if not 0 < len(name) <= MOST_NAME or not name.isprintable():
            remedy = f"give 1 to {MOST_NAME} letters that can be printed"
            raise RequestError("name", f"{name[:MOST_NAME]!r} is not a name", remedy=remedy)
        empty: dict[str, Any] = {"sheet": None, "incident": None, "note": "", "upto": None, "undoes": None}
        added: list[Label] = []
        with closing(self._opened(create=True)) as connection, connection:
            connection.execute("BEGIN IMMEDIATE")
            for fields in rows:
                row = empty | dict(fields) | {"by": name, "at_s": float(at_s)}
                row["note"] = row["note"][:MOST_NOTE]
                names = ", ".join(f'"{name}"' for name in row)
                number = connection.execute(
                    f"INSERT INTO words ({names}) VALUES ({', '.join('?' * len(row))})", tuple(row.values())
                ).lastrowid
                assert number is not None
                added.append(Label(id=number, **row))
        return added

    def of_run(self, run: str) -> list[Label]:
        """Return all labels of a run, in order."""
        return self._read("run = ? ORDER BY id", (run,))

    def _read(self, condition: str, values: tuple[Any, ...]) -> list[Label]:
        """Return the rows that meet a condition of SQL."""
        if not self.path.exists():
            return []
        with closing(self._opened(create=False)) as connection:
            try:
                columns = {row[1] for row in connection.execute("PRAGMA table_info(words)")}
                more = [name for name in _SINCE_2 if name in columns]
                query = f"SELECT {', '.join((*_COLUMNS, *more))} FROM words WHERE {condition}"
                rows = connection.execute(query, values).fetchall()
            except sqlite3.Error as error:
                raise self._refusal(f"cannot be read ({why(error)})") from error
        names = [name.strip('"') for name in (*_COLUMNS, *more)]
        return [Label(**dict(zip(names, row, strict=True))) for row in rows]

    def written_after(self, number: int, *, limit: int = 500) -> list[Label]:
        """Return the labels of all runs above a number, in order."""
        return self._read("id > ? ORDER BY id LIMIT ?", (number, limit))

    def last(self) -> int:
        """Return the number of the latest label of any run; 0: there is none."""
        if not self.path.exists():
            return 0
        with closing(self._opened(create=False)) as connection:
            try:
                return int(connection.execute("SELECT max(id) FROM words").fetchone()[0] or 0)
            except sqlite3.Error as error:
                raise self._refusal(f"cannot be read ({why(error)})") from error

    def _opened(self, *, create: bool) -> sqlite3.Connection:
        """Open the file; create: whether it is created if there is none."""
        try:
            if create and not os.path.lexists(self.path):
                self.path.parent.mkdir(parents=True, exist_ok=True)
            mode = "rwc" if create else "rw" if os.access(self.path, os.W_OK) else "ro"
            uri = f"{self.path.absolute().as_uri()}?mode={mode}"
            connection = sqlite3.connect(uri, uri=True, timeout=BUSY_S, isolation_level=None)
        except (OSError, sqlite3.Error) as error:
            raise self._refusal(f"cannot be opened ({why(error)})") from error
        try:
            connection.execute("PRAGMA trusted_schema = OFF")
            connection.execute("PRAGMA synchronous = FULL")
            self._check(connection, create=create)
        except BaseException as error:
            connection.close()
            if isinstance(error, sqlite3.Error):
                raise self._refusal(f"is not a file of labels ({why(error)})") from error
            raise
        return connection

    def _check(self, connection: sqlite3.Connection, *, create: bool) -> None:
        count_objects = "SELECT count(*) FROM sqlite_master"
        if create and not connection.execute(count_objects).fetchone()[0]:
            connection.execute("BEGIN IMMEDIATE")
            if not connection.execute(count_objects).fetchone()[0]:  # no other process was first
                for statement in _TABLES:
                    connection.execute(statement)
                connection.execute("INSERT INTO store VALUES (?, ?)", (_KIND, SCHEMA))
            connection.execute("COMMIT")
        store = connection.execute("SELECT kind, schema FROM store").fetchone()
        if store is None or store[0] != _KIND:
            raise self._refusal("is a database, but contains no labels")
        if store[1] not in (1, SCHEMA):
            raise self._refusal(f"has schema {store[1]}, this version reads schema {SCHEMA}")
        if create and store[1] == 1:
            connection.execute("BEGIN IMMEDIATE")
            if (
                connection.execute("SELECT schema FROM store").fetchone()[0] == 1
            ):  # no other process was first
                for name in _SINCE_2:
                    connection.execute(f"ALTER TABLE words ADD COLUMN {name} INTEGER")
                connection.execute("UPDATE store SET schema = ?", (SCHEMA,))
            connection.execute("COMMIT")

    def _refusal(self, what: str) -> JournalError:
        return JournalError(self.path, what, remedy=ANOTHER)


def standing(labels: Sequence[Label]) -> list[Label]:
    """Return the labels, in order, that were not undone; a legal hold is none."""
    undone = {label.undoes for label in labels}
    return [label for label in labels if label.word not in NO_LABEL and label.id not in undone]


class Labels:
    """The label in force for each sheet of a run: its own last one, else the last on its incident that covers it.

    ``seen`` is no label, for it states nothing about the sheet.
    """

    def __init__(self, labels: Sequence[Label]) -> None:
        """Choose the labels in force. labels: all labels of the run, in order."""
        self._of_sheets: dict[int, Label] = {}
        self._of_incidents: dict[int, list[Label]] = {}
        for label in standing(labels):
            if label.word == SEEN:
                continue
            if label.sheet is not None:
                self._of_sheets[label.sheet] = label
            elif label.incident is not None and label.incident.isdigit():
                self._of_incidents.setdefault(int(label.incident), []).append(label)

    @property
    def sheets(self) -> list[int]:
        """Sheets with a label of their own."""
        return sorted(self._of_sheets)

    def of(self, sheet: int, incident: int | None = None) -> Label | None:
        """Return the label in force; None: there is none. incident: to which the sheet belongs."""
        if (own := self._of_sheets.get(sheet)) is not None:
            return own
        on_incident = [] if incident is None else self._of_incidents.get(incident, [])
        return next((label for label in reversed(on_incident) if label.covers(sheet)), None)
