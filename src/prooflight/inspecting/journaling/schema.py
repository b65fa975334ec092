"""The journal's tables and its file: SQLite with a write-ahead log.

Schema history:
1: journal, runs, packs, pages.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    create_engine,
    event,
    insert,
    inspect,
    select,
)
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, DatabaseError

from prooflight.errors import InputError

if TYPE_CHECKING:
    from sqlalchemy import Connection, Engine

SCHEMA: Final = 1
BUSY_S: Final = 10.0
"""How long to wait for another connection's transaction."""
_ANOTHER: Final = "give another --journal"


class JournalError(InputError):
    """A journal cannot be used: damaged, of another schema, written by another process, or there is none."""


_tables = MetaData()
journal_table = Table(
    "journal",
    _tables,
    Column("schema", Integer, primary_key=True),
    Column("version", String, nullable=False),
)
runs_table = Table(
    "runs",
    _tables,
    Column("id", Integer, primary_key=True),
    Column("job", String, nullable=False),
    Column("job_digest", String, nullable=False),
    Column("press", String, nullable=False),
    Column("press_digest", String, nullable=False),
    Column("detector", String, nullable=False),
    Column("source", String, nullable=False),
    Column("started_s", Float, nullable=False),
    Column("sheets", Integer),
    Column("settings", JSON, nullable=False),
    Column("ended_s", Float),
    Column("ending", String),
    Column("detail", String),
    Column("counts", JSON(none_as_null=True)),
    Column("dropped_pages", Integer, nullable=False, default=0),
    Column("dropped_evidence", Integer, nullable=False, default=0),
)
packs_table = Table(
    "packs",
    _tables,
    Column("id", Integer, primary_key=True),
    Column("run_id", ForeignKey("runs.id"), nullable=False),
    Column("file", String, nullable=False, unique=True),
    Column("bytes", Integer, nullable=False),
)
pages_table = Table(
    "pages",
    _tables,
    Column("run_id", ForeignKey("runs.id"), primary_key=True),
    Column("sheet", Integer, primary_key=True),
    Column("job_page", Integer),
    Column("page", String, nullable=False),
    Column("verdict", String, nullable=False),
    Column("action", String, nullable=False),
    Column("kind", String),
    Column("probability", Float),
    Column("score", Float),
    Column("threshold", Float),
    Column("p_value", Float),
    Column("late", Boolean, nullable=False),
    Column("faulty", Boolean, nullable=False),
    Column("noted", Boolean, nullable=False),
    Column("first_line", Integer, nullable=False),
    Column("time_s", Float, nullable=False),
    Column("faults", JSON, nullable=False),
    Column("notes", JSON, nullable=False),
    Column("nuisance", JSON, nullable=False),
    Column("whole_verdict", JSON, nullable=False),
    Column("pack_id", ForeignKey("packs.id")),
    Index("pages_by_outcome", "run_id", "verdict", "late", "faulty", "noted"),
    Index("pages_by_pack", "pack_id"),
)


def default_journal() -> Path:
    """Where a journal lies unless somebody says otherwise: the user's data folder."""
    if sys.platform == "win32":
        data = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
    else:
        data = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(data) / "prooflight" / "journal.sqlite"


def journal_path(url: str) -> Path:
    """The file of a journal from a SQLAlchemy URL, sqlite:///runs.sqlite, or a plain path; JournalError."""
    if "://" not in url:
        return Path(url)
    remedy = "give sqlite:///FILE or the file itself"
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise JournalError(url, "is not a database URL", remedy=remedy) from error
    if parsed.get_backend_name() != "sqlite":
        what = f"is a database of {parsed.get_backend_name()}; evidence lies beside the database's file"
        raise JournalError(url, what, remedy=remedy)
    if parsed.database in (None, "", ":memory:") or parsed.query:
        raise JournalError(url, "names no file", remedy=remedy)
    return Path(str(parsed.database))


def open_database(path: Path, *, read_only: bool, version: str) -> Engine:
    """An engine on the journal's file, made if there is none; JournalError as there."""
    if read_only and not path.is_file():
        raise JournalError(
            path, "there is no journal", remedy=f"`prooflight watch` writes one, or {_ANOTHER}"
        )
    if not read_only:
        path.parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(
        URL.create("sqlite", database=str(path)), connect_args={"timeout": BUSY_S}, json_serializer=json_text
    )
    event.listen(engine, "connect", _prepare_reader if read_only else _prepare_writer)
    event.listen(engine, "begin", _begin)
    try:
        with (engine if read_only else writing(engine)).begin() as connection:
            _check(connection, path, create=not read_only, version=version)
    except DatabaseError as error:
        engine.dispose()
        what = f"cannot be opened as a journal ({str(error.orig).lower()})"
        raise JournalError(path, what, remedy=_ANOTHER) from error
    except JournalError:
        engine.dispose()
        raise
    return engine


def json_text(value: Any) -> str:
    """JSON of plain values, numbers of NumPy among them; NaN and infinity stay what they are."""
    return json.dumps(value, default=_plain)


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return str(value)


def _check(connection: Connection, path: Path, *, create: bool, version: str) -> None:
    names = inspect(connection).get_table_names()
    if not names and create:
        _tables.create_all(connection)
        connection.execute(insert(journal_table).values(schema=SCHEMA, version=version))
    elif journal_table.name not in names:
        raise JournalError(path, "is a database, but no journal", remedy=_ANOTHER)
    else:
        schema = connection.execute(select(journal_table.c.schema)).scalar_one()
        if schema != SCHEMA:
            what = f"has schema {schema}, this version reads schema {SCHEMA}"
            raise JournalError(path, what, remedy=f"export it with the version that wrote it, and {_ANOTHER}")


def _prepare_writer(connection: Any, _record: object) -> None:
    connection.isolation_level = None  # the driver would begin transactions late and end them early
    connection.execute("PRAGMA auto_vacuum = INCREMENTAL")  # counts only before the first table
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")  # a commit is on the disk when it returns
    connection.execute("PRAGMA foreign_keys = ON")


def _prepare_reader(connection: Any, _record: object) -> None:
    connection.isolation_level = None
    connection.execute("PRAGMA query_only = ON")


def _begin(connection: Connection) -> None:
    """Who writes waits for other writers at once, not halfway; who reads waits for nobody."""
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def writing(engine: Engine) -> Engine:
    """The same engine for transactions that write."""
    return engine.execution_options(writes=True)
