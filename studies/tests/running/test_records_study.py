"""The study of records measures what the product does: searches by its functions, and lags that faults explain."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("psycopg", reason='needs pip install "prooflight-line[records]"')
pytest.importorskip("alembic", reason='needs pip install "prooflight-line[records]"')

from prooflight_line.records.database import connect, upgrade
from prooflight_line.records.service import ShippingService
from prooflight_line.testing.postgres import local_postgres, server_programs
from prooflight_studies.records.backlog import LEAST_RUN, MOST_RUN, _compared, _runs
from prooflight_studies.records.migrating import REVISIONS, measure_migrations, write_journal
from prooflight_studies.records.searching import RUNS, measure_searches
from prooflight_studies.records.shipping import SETTLED_S, _lags, sheet


@pytest.mark.skipif(server_programs() is None, reason="PostgreSQL is not installed")
def test_searches_find_what_the_database_holds() -> None:
    figures = measure_searches(sheets=20 * RUNS, searches=40, seed=3, progress=lambda line: None)
    assert figures["sheets"] == 20 * RUNS
    counts = {row["role"]: row["count"] for row in figures["rows"] if row["search"] == "all"}
    # A role of one plant of four gets fewer hits, and so fewer second pages.
    assert counts["owner"] >= counts["one plant"] >= 40
    assert any("Limit" in line for line in figures["plan"])


@pytest.mark.skipif(server_programs() is None, reason="PostgreSQL is not installed")
def test_upgrades_keep_every_row_of_records_and_journal() -> None:
    figures = measure_migrations(sheets=RUNS, progress=lambda line: None)
    assert [row["step"] for row in figures["records"]][2:] == [name for name, _ in REVISIONS]
    assert all(row["cpu_s"] > 0 for row in (*figures["records"], *figures["journal"]))
    assert {row["bytes"] for row in figures["journal"]} != {0}


def test_lags_near_a_fault_are_stated_apart() -> None:
    lags = [(10.0, 0.2), (20.0, 0.4), (101.0, 8.0), (100.0 + SETTLED_S, 0.3)]
    figures = _lags(lags, [(100.0, 103.0, "server killed")])["lags"]
    assert (figures["all"]["rows"], figures["all"]["greatest_s"]) == (4, 8.0)
    assert (figures["undisturbed"]["rows"], figures["undisturbed"]["greatest_s"]) == (3, 0.4)
    assert _lags([], [])["lags"] == {"all": None, "undisturbed": None}


def test_one_sheet_in_fifty_is_a_misprint() -> None:
    assert sum(sheet(number, 0.0).verdict.verdict == "misprint" for number in range(500)) == 10


@pytest.mark.skipif(server_programs() is None, reason="PostgreSQL is not installed")
def test_what_is_missing_or_twice_in_a_backlog_is_counted(tmp_path: Path) -> None:
    journal = tmp_path / "journal.sqlite"
    write_journal(journal, [3000, 500], begun_s=1e9, progress=lambda line: None)
    with local_postgres("fsync=off") as server:
        upgrade(server.url)
        service = ShippingService(
            url=server.url, press="p", plant="p", journal=journal, pictures=None, announce=pytest.fail
        )
        while service.once():
            pass
        service.close()
        assert _compared(journal, server.url, within_s=0.0) == {
            "recorded": 3500,
            "lost": 0,
            "doubled": 0,
            "other_runs": 0,
        }
        with connect(server.url) as connection:
            connection.execute("DELETE FROM sheets WHERE run_id = 1 AND sheet < 3")
            connection.execute("UPDATE sheets SET sheet = 9999 WHERE run_id = 2 AND sheet = 0")
        with closing(sqlite3.connect(journal)) as raw, raw:
            raw.execute("DELETE FROM pages WHERE run_id = 1 AND sheet >= 2995")
        changed = _compared(journal, server.url, within_s=0.0)
        assert (changed["lost"], changed["doubled"], changed["other_runs"]) == (0, 2, 2)


def test_runs_of_a_week_have_all_its_sheets() -> None:
    runs = _runs(100_000, np.random.default_rng(31))
    assert sum(runs) == 100_000
    assert all(LEAST_RUN <= one < MOST_RUN for one in runs[:-1])
