"""Opening of the journal's file: examined before it is opened, and never changed unless it is a journal.

SQLite changes files by opening them (a write-ahead log is made, played back, removed). A file is therefore
examined first in a mode that cannot write; not a byte of a file that is no journal changes, and nothing appears
next to it.
"""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
import stat
import tempfile
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import create_engine, event, insert
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, SQLAlchemyError
from sqlalchemy.pool import NullPool, QueuePool

from prooflight.files.user_folders import user_folder
from prooflight_line.journal.schema import PREVIOUS, SCHEMA, JournalError, all_tables, journal_table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sqlalchemy import Connection, Engine

BUSY_S: Final = 10.0
"""Time to wait for another connection's transaction."""
MOST_ROW_BYTES: Final = 16_000_000
"""Limit of the size of any value and any row; a damaged file may state a thousand times as much."""
_NEW_BYTES, _LOG_BYTES = 1_000_000, 64_000_000
"""Limits of the sizes of a file and its log that are copied to be examined: a new journal may have its tables
in the log."""
ANOTHER: Final = "give another --journal"
UNREADABLE: Final = (SQLAlchemyError, sqlite3.Error, OverflowError, UnicodeError, RecursionError, MemoryError)
"""Errors that a query of a damaged database may raise."""


def default_journal() -> Path:
    """Return the default path of a journal, in the user's data folder."""
    return user_folder("data") / "journal.sqlite"


def journal_path(url: str) -> Path:
    """Return the file of a journal from a SQLAlchemy URL, sqlite:///runs.sqlite, or a plain path; JournalError."""
    if "://" not in url:
        return Path(url)
    remedy = "give sqlite:///FILE or the file itself"
    shown = re.sub("//[^/]*@", "//***@", url)  # a password must not be shown
    try:
        parsed = make_url(url)
    except (ArgumentError, ValueError) as error:
        raise JournalError(shown, "is not a database URL", remedy=remedy) from error
    if parsed.get_backend_name() != "sqlite":
        what = f"is a database of {parsed.get_backend_name()}; evidence is stored next to the database's file"
        raise JournalError(shown, what, remedy=remedy)
    if parsed.host or parsed.username or parsed.query or parsed.database in (None, "", ":memory:"):
        raise JournalError(shown, "names no file", remedy=remedy)
    return Path(str(parsed.database))


def why(error: BaseException) -> str:
    """Return the message of a system or SQLite error, in a few words."""
    message = getattr(error, "orig", None) or getattr(error, "strerror", None) or error
    return (str(message) or type(message).__name__).splitlines()[0].lower()


def examine(path: Path, *, read_only: bool) -> bool:
    """Refuse a file that is no journal, without changing it; return whether there is a journal. JournalError."""
    status = _status(path)
    log = _side_file(path, "-wal")
    if (status is None or not status.st_size) and _size(log):  # SQLite would remove the log
        what = f"is missing, but its log {log.name} is there with the last changes"
        raise JournalError(path, what, remedy="put the journal back, or move its log away")
    if status is None and not read_only:
        return False
    missing = f"`prooflight watch` writes one, or {ANOTHER}"
    if status is None:
        raise JournalError(path, "there is no journal", remedy=missing)
    sides = [side for suffix in ("-wal", "-journal") if _size(side := _side_file(path, suffix))]
    try:
        empty = _is_empty(path, path)
        trouble = None
    except (JournalError, *UNREADABLE) as error:
        empty, trouble = True, error
    small = status.st_size <= _NEW_BYTES and all(_size(side) <= _LOG_BYTES for side in sides)
    if empty and sides and small and not isinstance(trouble, JournalError):
        with _copied(path, sides) as copy, _as_journal_error(path):
            empty, trouble = _is_empty(copy, path), None
    if trouble is not None:
        with _as_journal_error(path):
            raise trouble
    if empty and read_only:
        raise JournalError(path, "contains no journal", remedy=missing)
    return not empty


def open_database(path: Path, *, read_only: bool, version: str) -> Engine:
    """Return an engine on the file of a journal, which is created if there is none. JournalError."""
    with _as_journal_error(path):
        if not examine(path, read_only=read_only):
            _create(path, version)
        mode = _reading_mode(path) if read_only else "mode=rw"
        engine = _engine(path, mode)
        event.listen(engine, "connect", _prepare_reader if read_only else _prepare_writer)
        event.listen(engine, "begin", _begin)
        try:
            with (engine if read_only else writing(engine)).begin() as connection:
                check(connection.connection.driver_connection, path)
                if not read_only:
                    _bring_up_to_date(connection)
        except BaseException as error:
            engine.dispose()
            if mode == "mode=ro" and isinstance(error, UNREADABLE):
                what = f"its log {path.name}-wal cannot be read in a folder without write permission ({why(error)})"
                raise JournalError(path, what, remedy="copy both to a folder that can be written") from error
            raise
    return engine


def check(connection: Any, path: Path) -> bool:
    """Return whether a database of the driver's is empty; JournalError if it is anything but that or a journal."""
    objects = connection.execute("SELECT type, name, sql FROM sqlite_master").fetchall()
    if not objects:
        return True
    of_type = {name: (kind, str(sql).upper()) for kind, name, sql in objects if kind != "index"}
    if journal_table.name not in of_type:
        raise JournalError(path, "is a database, but not a journal", remedy=ANOTHER)
    versions = connection.execute("SELECT schema FROM journal LIMIT 2").fetchall()
    if len(versions) != 1 or not isinstance(versions[0][0], int):
        raise JournalError(path, "does not state its schema", remedy=ANOTHER)
    if versions[0][0] not in (PREVIOUS, SCHEMA):
        what = f"has schema {versions[0][0]}, this version reads schema {SCHEMA}"
        raise JournalError(path, what, remedy=f"export it with the version that wrote it, and {ANOTHER}")
    for table in all_tables.sorted_tables:
        kind, sql = of_type.pop(table.name, ("", ""))
        columns = {row[1] for row in connection.execute(f"PRAGMA main.table_info({table.name})")}
        if versions[0][0] == PREVIOUS and "action" in columns:
            columns |= {"disposition", "decided_by"}
        if kind != "table" or "VIRTUAL" in sql or not columns.issuperset(table.columns.keys()):
            what = f"is damaged (its table {table.name} is not that of a journal)"
            raise JournalError(path, what, remedy=ANOTHER)
    if others := [name for name, (kind, _) in of_type.items() if kind != "table"]:
        raise JournalError(path, f"contains {others[0]!r}, which is not part of a journal", remedy=ANOTHER)
    return False


def writing(engine: Engine) -> Engine:
    """Return the same engine for transactions that write."""
    return engine.execution_options(writes=True)


# --- parts ---


@contextmanager
def _as_journal_error(path: Path) -> Iterator[None]:
    """Convert every error of opening a database to JournalError."""
    try:
        yield
    except (OSError, *UNREADABLE) as error:
        raise JournalError(path, f"cannot be opened as a journal ({why(error)})", remedy=ANOTHER) from error


def _status(path: Path) -> os.stat_result | None:
    """Return the status of a plain file; None: there is nothing. JournalError: it is something else."""
    try:
        status = path.lstat()
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise JournalError(path, f"cannot be examined ({why(error)})", remedy=ANOTHER) from error
    if stat.S_ISLNK(status.st_mode):  # two names would be two locks, and evidence at two places
        raise JournalError(path, "is a link", remedy="give the file that it points to")
    if not stat.S_ISREG(status.st_mode):
        what = "is a folder" if stat.S_ISDIR(status.st_mode) else "is not a file"
        raise JournalError(path, what, remedy="give a file, as in sqlite:///FILE")
    return status


def _side_file(path: Path, suffix: str) -> Path:
    return path.with_name(path.name + suffix)


def _size(path: Path) -> int:
    try:
        return path.lstat().st_size
    except OSError:
        return 0


def _is_empty(examined: Path, path: Path) -> bool:
    mode = "immutable=1" if examined == path else "mode=rw"
    with closing(_connect(examined, mode)) as connection:
        return check(connection, path)


@contextmanager
def _copied(path: Path, sides: list[Path]) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="prooflight-") as name:
        for file in (path, *sides):
            shutil.copyfile(file, Path(name) / file.name, follow_symlinks=False)
        yield Path(name) / path.name


def _reading_mode(path: Path) -> str:
    """Return the mode to open a file for reading; without SQLite's side files if nothing can be written there."""
    if os.access(path, os.W_OK) and os.access(path.parent, os.W_OK):
        return "mode=rw"
    log, shared = _side_file(path, "-wal"), _side_file(path, "-shm")
    return "mode=ro" if _size(log) or shared.exists() else "immutable=1"


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    # As a URI, so that no character of a name is special.
    uri = f"{path.absolute().as_uri()}?{mode}"
    connection = sqlite3.connect(uri, uri=True, timeout=BUSY_S, check_same_thread=False)
    connection.isolation_level = None  # the driver would begin transactions late and end them early
    connection.text_factory = _text
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_ROW_BYTES)
    connection.execute("PRAGMA trusted_schema = OFF")
    return connection


def _text(stored: bytes) -> str:
    """Decode a text; invalid UTF-8 must fail where rows are checked and named, not in the driver."""
    return stored.decode("utf-8", "surrogateescape")


def _engine(path: Path, mode: str) -> Engine:
    pool = NullPool if mode == "mode=rwc" else QueuePool
    return create_engine("sqlite://", creator=lambda: _connect(path, mode), poolclass=pool)


def _create(path: Path, version: str) -> None:
    """Create the tables before the log: a journal that has a log has its tables in its own file."""
    engine = _engine(path, "mode=rwc")
    event.listen(engine, "connect", lambda raw, _: raw.execute("PRAGMA auto_vacuum = INCREMENTAL"))
    event.listen(engine, "begin", _begin)
    with writing(engine).begin() as connection:
        if check(connection.connection.driver_connection, path):
            all_tables.create_all(connection)
            connection.execute(insert(journal_table).values(schema=SCHEMA, version=version))


def _prepare_writer(connection: Any, _record: object) -> None:
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")  # a commit is on the disk when it returns
    connection.execute("PRAGMA foreign_keys = ON")


def _bring_up_to_date(connection: Connection) -> None:
    """Add the columns of ``SCHEMA`` to a journal of schema ``PREVIOUS``; its rows stay as they were written."""
    if connection.exec_driver_sql("SELECT schema FROM journal").scalar() == PREVIOUS:
        connection.exec_driver_sql("ALTER TABLE pages RENAME COLUMN action TO disposition")
        connection.exec_driver_sql("ALTER TABLE pages ADD COLUMN decided_by VARCHAR")
        connection.exec_driver_sql(f"UPDATE journal SET schema = {SCHEMA}")


def _prepare_reader(connection: Any, record: Any) -> None:
    if connection.execute("SELECT schema FROM main.journal").fetchall() == [(PREVIOUS,)]:
        columns = [row[1] for row in connection.execute("PRAGMA main.table_info(pages)")]
        shown = ", ".join("action AS disposition" if name == "action" else name for name in columns)
        connection.execute(
            f"CREATE TEMP VIEW pages AS SELECT rowid AS rowid, {shown}, NULL AS decided_by FROM main.pages"
        )
        record.info["shown"] = True
    connection.execute("PRAGMA query_only = ON")


def _show_as_written(connection: Connection) -> None:
    """Drop the compatibility view if a writer has updated the journal since this connection was made."""
    schema = connection.exec_driver_sql("SELECT schema FROM main.journal").scalar()
    if schema == SCHEMA:
        connection.exec_driver_sql("PRAGMA query_only = OFF")
        connection.exec_driver_sql("DROP VIEW temp.pages")
        connection.exec_driver_sql("PRAGMA query_only = ON")
        connection.info["shown"] = False


def _begin(connection: Connection) -> None:
    """Begin a transaction: a writer waits for other writers at once, not halfway; a reader waits for nobody."""
    writes = connection.get_execution_options().get("writes", False)
    if connection.info.get("shown"):
        _show_as_written(connection)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
