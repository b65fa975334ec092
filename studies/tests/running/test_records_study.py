"""The study of records measures what the product does: searches by its functions, and lags that faults explain."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("psycopg", reason='needs pip install "prooflight-line[records]"')
pytest.importorskip("alembic", reason='needs pip install "prooflight-line[records]"')

from prooflight_line.testing.postgres import server_programs
from prooflight_studies.records.backlog import LEAST_RUN, MOST_RUN, _runs, measure_backlog
from prooflight_studies.records.migrating import REVISIONS, measure_migrations
from prooflight_studies.records.presses import sheet
from prooflight_studies.records.searching import RUNS, measure_searches
from prooflight_studies.records.shipping import SETTLED_S, _lags


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
def test_a_backlog_is_shipped_whole_while_the_press_goes_on() -> None:
    with tempfile.TemporaryDirectory(prefix="prooflight-backlog-") as folder:  # a socket's path must be short
        Path(folder).chmod(0o755)
        figures = measure_backlog(
            Path(folder),
            sheets=3 * LEAST_RUN,
            tried_s=0.0,
            followed_s=1.0,
            rng=np.random.default_rng(31),
            progress=lambda line: None,
        )
    assert (figures["lost"], figures["doubled"], figures["other_runs"]) == (0, 0, 0)
    assert figures["recorded"] > figures["sheets"] == 3 * LEAST_RUN
    assert figures["shipped"] > figures["sheets"]
    assert figures["peak_bytes"] >= figures["waiting_bytes"] > 0


def test_runs_of_a_week_have_all_its_sheets() -> None:
    runs = _runs(100_000, np.random.default_rng(31))
    assert sum(runs) == 100_000
    assert all(LEAST_RUN <= one < MOST_RUN for one in runs[:-1])
