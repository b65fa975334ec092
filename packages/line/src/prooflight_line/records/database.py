"""Connection to the database of records, its migrations, and who may read which plant.

The journal of each press stays the durable truth; what is here can be shipped again from it at any time. Rows of
plants that a role may not read are hidden by PostgreSQL itself (row-level security), whatever the query.
"""

from __future__ import annotations

import os
import re
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    import psycopg
    from alembic.config import Config

SCHEMA: Final = "0001"
"""Revision of the tables that this version reads and writes."""
VARIABLE: Final = "PROOFLIGHT_RECORDS"
"""Environment variable with the database's URL, so that no password stands among a process's arguments."""
CONNECT_S: Final = 10
INSTALL: Final = 'pip install "prooflight-line[records]"'
UPGRADE: Final = "run `prooflight records upgrade` with the same URL"


class RecordsError(InputError):
    """A database of records that cannot be used: unreachable, of another schema, or not permitted."""


class UnreachableError(RecordsError):
    """A server that does not answer, or lets nobody in, now."""


def shown(url: str) -> str:
    """Return a database's URL for a message, without its password."""
    hidden = re.sub(r"//([^/@:]*):[^/@]*@", r"//\1:***@", url)
    return re.sub(r"(?i)(password=)(?:'[^']*'|\S+)", r"\1***", hidden)


def url_or_variable(url: str | None) -> str:
    """Return the URL that was given, or that of the environment; RecordsError: neither is there."""
    chosen = url or os.environ.get(VARIABLE)
    if not chosen:
        remedy = f"give --to postgresql://HOST/DATABASE, or set {VARIABLE}"
        raise RecordsError("records", "no database is named", remedy=remedy)
    return chosen


def connect(url: str, *, upgraded: bool = True) -> psycopg.Connection[Any]:
    """Open a connection in which each statement is a transaction unless one is begun.

    upgraded: whether the tables must be of ``SCHEMA``. RecordsError: psycopg is missing, the URL is none, the server
    does not answer or refuses, the database's texts are not in UTF-8, or the tables are of another schema.
    """
    try:
        import psycopg
    except ImportError as error:
        raise RecordsError("records", "psycopg is not installed", remedy=INSTALL) from error
    try:
        connection = psycopg.connect(
            url, autocommit=True, connect_timeout=CONNECT_S, application_name="prooflight", keepalives_idle=30
        )
    except psycopg.Error as error:
        remedy = "give a URL as postgresql://USER@HOST/DATABASE of a server that runs"
        raise UnreachableError(
            shown(url), f"cannot be reached ({first_line(error)})", remedy=remedy
        ) from error
    try:
        _check_encoding(connection, url)
        if upgraded:
            _check_schema(connection, url)
    except BaseException:
        connection.close()
        raise
    return connection


def first_line(error: Exception) -> str:
    """Return the first line of a server's message."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


@contextmanager
def refused(url: str, what: str) -> Iterator[None]:
    """Convert errors of the server within the block to RecordsError. what: the action, for the message."""
    import psycopg

    try:
        yield
    except psycopg.Error as error:
        remedy = "see the server's log, or ask its administrator"
        raise RecordsError(shown(url), f"{what}: {first_line(error)}", remedy=remedy) from error


def upgrade(url: str) -> tuple[str | None, str]:
    """Bring the tables to ``SCHEMA``, in one transaction; return the revisions before and after. RecordsError."""
    try:
        from alembic import command
        from alembic.runtime.migration import MigrationContext
        from alembic.util import CommandError
        from sqlalchemy import create_engine, text
        from sqlalchemy.exc import SQLAlchemyError
    except ImportError as error:
        raise RecordsError("records", "Alembic is not installed", remedy=INSTALL) from error
    connect(url, upgraded=False).close()  # one clear line if there is no server
    engine = create_engine("postgresql+psycopg://", creator=lambda: _plain_connection(url))
    try:
        with engine.begin() as connection:
            connection.execute(text("SELECT pg_advisory_xact_lock(hashtext('prooflight records'))"))
            before = MigrationContext.configure(connection).get_current_revision()
            command.upgrade(_alembic(connection), "head")
            after = MigrationContext.configure(connection).get_current_revision()
    except (SQLAlchemyError, CommandError) as error:
        what = f"cannot be upgraded ({first_line(error)})"
        raise RecordsError(shown(url), what, remedy="upgrade Prooflight, or ask its administrator") from error
    finally:
        engine.dispose()
    return before, str(after)


def allow(url: str, role: str, plant: str) -> None:
    """Let a role of the server read the records of one plant. RecordsError: there is no such role, or no right to."""
    from psycopg import sql

    with (
        connect(url) as connection,
        refused(url, f"{role} could not be given access"),
        connection.transaction(),
    ):
        names = sql.SQL(", ").join(map(sql.Identifier, ("presses", "runs", "sheets", "labels", "members")))
        connection.execute(sql.SQL("GRANT SELECT ON {} TO {}").format(names, sql.Identifier(role)))
        connection.execute(sql.SQL("GRANT SELECT ON alembic_version TO {}").format(sql.Identifier(role)))
        connection.execute(
            "INSERT INTO members (role, plant) VALUES (%s, %s) ON CONFLICT DO NOTHING", (role, plant)
        )


def _check_encoding(connection: psycopg.Connection[Any], url: str) -> None:
    """Refuse a database of another encoding, as of a server that was set up without a locale: it returns bytes."""
    encoding = connection.info.parameter_status("server_encoding")
    if encoding != "UTF8":
        remedy = "create one by `createdb --encoding UTF8 --template template0 NAME`"
        raise RecordsError(shown(url), f"is a database of encoding {encoding}, not UTF8", remedy=remedy)


def _check_schema(connection: psycopg.Connection[Any], url: str) -> None:
    import psycopg

    try:
        row = connection.execute("SELECT version_num FROM alembic_version").fetchone()
    except psycopg.errors.UndefinedTable:
        row = None
    except psycopg.Error as error:
        raise RecordsError(shown(url), f"cannot be read ({first_line(error)})", remedy=UPGRADE) from error
    if row is None:
        raise RecordsError(shown(url), "contains no records of Prooflight", remedy=UPGRADE)
    if row[0] != SCHEMA:
        what = f"has schema {row[0]}, this version reads schema {SCHEMA}"
        remedy = UPGRADE if row[0] < SCHEMA else "upgrade Prooflight on this machine"
        raise RecordsError(shown(url), what, remedy=remedy)


def _alembic(connection: Any) -> Config:
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", "prooflight_line.records:migrations")
    config.attributes["connection"] = connection
    return config


def _plain_connection(url: str) -> psycopg.Connection[Any]:
    import psycopg

    return psycopg.connect(url, connect_timeout=CONNECT_S)
