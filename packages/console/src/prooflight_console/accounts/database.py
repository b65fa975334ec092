"""The console's own file: people, sessions, shelved alarms and the audit. The journal is never written.

Schema history:
1: console, people, links, sessions, tokens, audit.
2: identities, of people who sign in at an OpenID provider.
3: shelvings of alarms, and notes of hand-over. An older file gets its missing tables when it is opened.
4: notes on the history of a press; kiosks, their sessions, and the PINs and badges of people.
"""

from __future__ import annotations

import os
import sqlite3
import stat
from contextlib import closing
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    Float,
    ForeignKey,
    Integer,
    MetaData,
    String,
    Table,
    create_engine,
    event,
)
from sqlalchemy.pool import QueuePool

from prooflight.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from sqlalchemy import Connection, Engine

SCHEMA: Final = 4
BUSY_S: Final = 10.0


class ConsoleFileError(InputError):
    """The console's own file cannot be used: it is damaged, of another schema, or no such file at all."""


def _filled(kind: Any, *names: str) -> list[Column[Any]]:
    return [Column(name, kind, nullable=False) for name in names]


tables = MetaData()
console_table = Table("console", tables, Column("schema", Integer, primary_key=True))
people_table = Table(
    "people",
    tables,
    Column("id", Integer, primary_key=True),
    Column("name", String, nullable=False, unique=True),
    *_filled(String, "role"),
    Column("password", String),
    *_filled(Boolean, "locked"),
    Column("language", String),
    *_filled(Float, "created_s"),
)
identities_table = Table(
    "identities",
    tables,
    Column("issuer", String, primary_key=True),
    Column("subject", String, primary_key=True),
    Column("person_id", ForeignKey("people.id"), nullable=False, unique=True),
)
links_table = Table(
    "links",
    tables,
    Column("digest", String, primary_key=True),
    Column("person_id", ForeignKey("people.id"), nullable=False),
    *_filled(Float, "ends_s"),
)
sessions_table = Table(
    "sessions",
    tables,
    Column("digest", String, primary_key=True),
    Column("person_id", ForeignKey("people.id"), nullable=False),
    *_filled(String, "csrf"),
    *_filled(Float, "began_s", "ends_s"),
)
tokens_table = Table(
    "tokens",
    tables,
    Column("id", Integer, primary_key=True),
    Column("digest", String, nullable=False, unique=True),
    Column("person_id", ForeignKey("people.id"), nullable=False),
    *_filled(String, "name"),
    *_filled(JSON, "scopes"),
    *_filled(Float, "created_s", "ends_s"),
    Column("revoked_s", Float),
)
audit_table = Table(
    "audit",
    tables,
    Column("id", Integer, primary_key=True),
    *_filled(Float, "at_s"),
    *_filled(String, "who", "what", "target"),
    Column("before", String),
    Column("after", String),
    *_filled(String, "previous", "digest"),
)
shelvings_table = Table(
    "shelvings",
    tables,
    Column("id", Integer, primary_key=True),
    *_filled(String, "run"),
    *_filled(Integer, "incident"),
    *_filled(String, "priority", "reason", "by"),
    *_filled(Float, "at_s", "ends_s"),
    Column("ended_by", String),
    Column("ended_s", Float),
)
handovers_table = Table(
    "handovers",
    tables,
    Column("id", Integer, primary_key=True),
    *_filled(Float, "at_s"),
    *_filled(String, "by", "text"),
    *_filled(JSON, "summary"),
)
chart_notes_table = Table(
    "chart_notes",
    tables,
    Column("id", Integer, primary_key=True),
    *_filled(Float, "at_s", "written_s"),
    *_filled(String, "by", "text"),
    Column("removed_by", String),
)
kiosks_table = Table(
    "kiosks",
    tables,
    Column("id", Integer, primary_key=True),
    Column("digest", String, nullable=False, unique=True),
    *_filled(String, "name", "by"),
    *_filled(Float, "enrolled_s"),
    Column("revoked_s", Float),
)
kiosk_keys_table = Table(
    "kiosk_keys",
    tables,
    Column("person_id", ForeignKey("people.id"), primary_key=True),
    Column("pin", String),
    Column("badge", String, unique=True),
    *_filled(Integer, "failed"),
)
kiosk_sessions_table = Table(
    "kiosk_sessions",
    tables,
    Column("digest", ForeignKey("sessions.digest", ondelete="CASCADE"), primary_key=True),
    Column("kiosk_id", ForeignKey("kiosks.id"), nullable=False),
    *_filled(Boolean, "full"),
)
kiosk_salt_table = Table("kiosk_salt", tables, Column("salt", String, primary_key=True))
_APPEND_ONLY: Final = tuple(
    f"CREATE TRIGGER {table}_{way} BEFORE {way} ON {table} BEGIN SELECT RAISE(ABORT, '{table} is append-only'); END"
    for table in ("audit",)
    for way in ("update", "delete")
)


def open_file(path: Path) -> Engine:
    """Return an engine on the console's file, created if missing and readable by its owner alone.

    Raises ConsoleFileError if the file cannot be used.
    """
    try:
        _check_file(path)
        engine = create_engine("sqlite://", creator=lambda: _connect(path), poolclass=QueuePool, pool_size=16)
        event.listen(engine, "begin", _begin)
        with writing(engine).begin() as connection:
            _make(connection, path)
    except (OSError, sqlite3.Error) as error:
        raise _refusal(path, str(error)) from error
    except Exception as error:
        if isinstance(error, ConsoleFileError):
            raise
        raise _refusal(path, str(getattr(error, "orig", error)).splitlines()[0]) from error
    return engine


def writing(engine: Engine) -> Engine:
    """Return the same engine for transactions that write."""
    return engine.execution_options(writes=True)


def _check_file(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        os.close(os.open(path, os.O_CREAT | os.O_WRONLY | os.O_EXCL, 0o600))
        return
    if not stat.S_ISREG(mode):
        raise _refusal(path, "is not a regular file")


def _make(connection: Connection, path: Path) -> None:
    names = set(connection.exec_driver_sql("SELECT name FROM sqlite_master WHERE type = 'table'").scalars())
    if not names:
        tables.create_all(connection)
        for trigger in _APPEND_ONLY:
            connection.exec_driver_sql(trigger)
        connection.exec_driver_sql("INSERT INTO console VALUES (?)", (SCHEMA,))
        return
    if console_table.name not in names:
        raise _refusal(path, "is a database, but not that of a console")
    schema = connection.exec_driver_sql("SELECT schema FROM console").scalar()
    if not isinstance(schema, int) or schema not in range(1, SCHEMA + 1):
        raise _refusal(path, f"has schema {schema}, this version reads schema {SCHEMA}")
    if schema < SCHEMA:
        tables.create_all(connection)  # those that are missing
        connection.exec_driver_sql("UPDATE console SET schema = ?", (SCHEMA,))


def _connect(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, timeout=BUSY_S, check_same_thread=False)
    connection.isolation_level = None
    connection.create_function("lower", 1, lambda text: None if text is None else str(text).lower())
    with closing(connection.cursor()) as cursor:
        cursor.execute("PRAGMA journal_mode = WAL")
        cursor.execute("PRAGMA synchronous = FULL")
        cursor.execute("PRAGMA foreign_keys = ON")
        cursor.execute("PRAGMA trusted_schema = OFF")
    return connection


def _begin(connection: Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _refusal(path: Path, what: str) -> ConsoleFileError:
    return ConsoleFileError(path, what, remedy="give another file with --data")
