"""What people say of sheets and of incidents: one file beside the journal, to which words are added and nothing else.

It lies beside the journal, not in it, for whoever watches a press holds the journal's lock, and words come meanwhile
from the console, from programs and from the command line. SQLite lets one process write at a time and keeps others
waiting. A run is known by its number and by when it began, so that words stay with their run where a journal begins
anew. Tidying the journal leaves words alone: press artefacts rest on them.
"""

from __future__ import annotations

import os
import sqlite3
import unicodedata
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import RequestError
from prooflight.journal.opening import why
from prooflight.journal.schema import JournalError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from prooflight.journal.records import RunRow

SCHEMA: Final = 1
BUSY_S: Final = 10.0
SUFFIX: Final = ".words.sqlite"
MISPRINT, GOOD, FALSE_ALARM, UNKNOWN, SEEN = ("misprint", "good", "false-alarm", "unknown", "seen")
WORDS: Final = (MISPRINT, GOOD, FALSE_ALARM, UNKNOWN, SEEN)
"""false-alarm: good, said of an incident; seen: it need not sound any more, and says nothing of the sheet."""
OF_GOOD: Final = frozenset({GOOD, FALSE_ALARM})
MOST_NOTE: Final = 1000
MOST_NAME: Final = 60
ANOTHER: Final = "move it away, and say again what it held"
_TABLES: Final = (
    "CREATE TABLE store (kind TEXT NOT NULL, schema INTEGER NOT NULL)",
    "CREATE TABLE words (id INTEGER PRIMARY KEY, run TEXT NOT NULL, sheet INTEGER, incident TEXT, word TEXT NOT NULL,"
    ' note TEXT NOT NULL, "by" TEXT NOT NULL, at_s REAL NOT NULL)',
    "CREATE INDEX words_of_runs ON words (run, id)",
    *(
        f"CREATE TRIGGER words_{way} BEFORE {way} ON words BEGIN SELECT RAISE(ABORT, 'words is append-only'); END"
        for way in ("update", "delete")
    ),
)
_KIND: Final = "prooflight words"


@dataclass(frozen=True, slots=True, kw_only=True)
class Word:
    """What somebody said of a sheet or an incident."""

    id: int
    run: str
    """``run_key``."""
    sheet: int | None
    incident: str | None
    """Its number."""
    word: str
    note: str
    by: str
    at_s: float
    """Unix time. [s]"""


def run_key(run: RunRow) -> str:
    """By which words know a run, also where a journal begins anew with run 1."""
    return f"{run.id}@{run.facts.started_s:.0f}"


def words_path(journal: Path) -> Path:
    """Where the words on a journal's sheets lie."""
    return journal.with_name(journal.name + SUFFIX)


class Words:
    """The words on one journal's sheets; may be asked from several threads and processes. JournalError: it cannot."""

    def __init__(self, journal: Path) -> None:
        self.path = words_path(journal)

    def say(
        self,
        word: str,
        *,
        run: str,
        by: str,
        at_s: float,
        sheet: int | None = None,
        incident: str | None = None,
        note: str = "",
    ) -> Word:
        """Add one; it is on the disk when this returns. RequestError: there is no such word, or nobody said it.

        at_s: Unix time. [s]
        """
        if word not in WORDS:
            raise RequestError("word", f"there is no {word[:40]!r}", remedy=f"say {', '.join(WORDS)}")
        name = unicodedata.normalize("NFC", " ".join(by.split()))
        if not 0 < len(name) <= MOST_NAME or not name.isprintable():
            remedy = f"give 1 to {MOST_NAME} letters that can be printed"
            raise RequestError("name", f"{name[:MOST_NAME]!r} is none", remedy=remedy)
        word = FALSE_ALARM if word == GOOD and incident is not None else word
        held = (run, sheet, incident, word, note[:MOST_NOTE], name, float(at_s))
        with closing(self._opened(made=True)) as connection, connection:
            connection.execute("BEGIN IMMEDIATE")
            added = connection.execute(
                'INSERT INTO words (run, sheet, incident, word, note, "by", at_s) VALUES (?, ?, ?, ?, ?, ?, ?)',
                held,
            )
            number = added.lastrowid
        assert number is not None
        return Word(
            id=number, run=run, sheet=sheet, incident=incident, word=word, note=held[4], by=name, at_s=held[6]
        )

    def of_run(self, run: str) -> list[Word]:
        """All that was said of a run, in order."""
        query = 'SELECT id, run, sheet, incident, word, note, "by", at_s FROM words WHERE run = ? ORDER BY id'
        return [
            Word(id=number, run=key, sheet=sheet, incident=incident, word=word, note=note, by=by, at_s=at_s)
            for number, key, sheet, incident, word, note, by, at_s in self._asked(query, (run,))
        ]

    def last(self) -> int:
        """Number of the latest word on any run; 0: nobody said any."""
        return int(next(iter(self._asked("SELECT max(id) FROM words", ())), (0,))[0] or 0)

    def _asked(self, query: str, values: Sequence[Any]) -> list[Any]:
        if not self.path.exists():
            return []
        with closing(self._opened(made=False)) as connection:
            try:
                return connection.execute(query, values).fetchall()
            except sqlite3.Error as error:
                raise self._refusal(f"cannot be read ({why(error)})") from error

    def _opened(self, *, made: bool) -> sqlite3.Connection:
        """made: whether it is made where there is none."""
        try:
            if made and not os.path.lexists(self.path):
                self.path.parent.mkdir(parents=True, exist_ok=True)
            mode = "rwc" if made else "rw" if os.access(self.path, os.W_OK) else "ro"
            uri = f"{self.path.absolute().as_uri()}?mode={mode}"
            connection = sqlite3.connect(uri, uri=True, timeout=BUSY_S, isolation_level=None)
        except (OSError, sqlite3.Error) as error:
            raise self._refusal(f"cannot be opened ({why(error)})") from error
        try:
            connection.execute("PRAGMA trusted_schema = OFF")
            connection.execute("PRAGMA synchronous = FULL")
            self._check(connection, made=made)
        except BaseException as error:
            connection.close()
            if isinstance(error, sqlite3.Error):
                raise self._refusal(f"is no file of words ({why(error)})") from error
            raise
        return connection

    def _check(self, connection: sqlite3.Connection, *, made: bool) -> None:
        held = "SELECT count(*) FROM sqlite_master"
        if made and not connection.execute(held).fetchone()[0]:
            connection.execute("BEGIN IMMEDIATE")
            if not connection.execute(held).fetchone()[0]:  # no other process was first
                for statement in _TABLES:
                    connection.execute(statement)
                connection.execute("INSERT INTO store VALUES (?, ?)", (_KIND, SCHEMA))
            connection.execute("COMMIT")
        found = connection.execute("SELECT kind, schema FROM store").fetchone()
        if found is None or found[0] != _KIND:
            raise self._refusal("is a database, but holds no words")
        if found[1] != SCHEMA:
            raise self._refusal(f"has schema {found[1]}, this version reads schema {SCHEMA}")

    def _refusal(self, what: str) -> JournalError:
        return JournalError(self.path, what, remedy=ANOTHER)


def last_words(words: Sequence[Word]) -> tuple[Mapping[int, Word], Mapping[int, Word]]:
    """By sheet, and by incident: the last that says what it was, of words in order."""
    of_sheets: dict[int, Word] = {}
    of_incidents: dict[int, Word] = {}
    for word in words:
        if word.word == SEEN:
            continue
        if word.sheet is not None:
            of_sheets[word.sheet] = word
        elif word.incident is not None and word.incident.isdigit():
            of_incidents[int(word.incident)] = word
    return of_sheets, of_incidents
