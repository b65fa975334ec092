"""A PostgreSQL server for all tests of records, with an empty database for each."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from prooflight.detectors.verdict import Verdict
from prooflight_line.journal.following import follow
from prooflight_line.records.database import connect, upgrade
from prooflight_line.records.shipping import Shipper
from prooflight_line.testing.postgres import LocalPostgres, local_postgres, server_programs

if TYPE_CHECKING:
    from prooflight_line.journal.records import PageRecord


@pytest.fixture(scope="session")
def server() -> Iterator[LocalPostgres]:
    for package in ("psycopg", "alembic", "obstore"):
        pytest.importorskip(package)
    if server_programs() is None:
        pytest.skip("PostgreSQL is not installed")
    with local_postgres("fsync=off") as started:
        yield started


@pytest.fixture
def database(server: LocalPostgres) -> str:
    """The URL of a new database without tables."""
    name = f"t{secrets.token_hex(6)}"
    with connect(server.url, upgraded=False) as connection:
        connection.execute(f"CREATE DATABASE {name}")
    return server.url.replace("/postgres?", f"/{name}?")


@pytest.fixture
def records(database: str) -> str:
    """The URL of a new database with its tables."""
    upgrade(database)
    return database


@pytest.fixture
def shipper(records: str, tmp_path: Path) -> Iterator[Callable[..., Shipper]]:
    """Opens shippers, which are closed at the end."""
    opened: list[Shipper] = []

    def make(press: str = "one", path: Path = tmp_path / "journal.sqlite", plant: str = "north") -> Shipper:
        journal = follow(path, version="0")
        assert journal is not None
        opened.append(
            Shipper.open(records, press=press, plant=plant, journal=journal, announce=lambda line: None)
        )
        return opened[-1]

    yield make
    for one in opened:
        one.close()
        one.journal.close()


def misprint(page: PageRecord, kind: str = "streak") -> PageRecord:
    """The same page, as a misprint."""
    verdict = Verdict(
        page=page.verdict.page, verdict="misprint", score=9.0, threshold=1.0, kind=kind, reason="test"
    )
    return replace(page, verdict=verdict)
