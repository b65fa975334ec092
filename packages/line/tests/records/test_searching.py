"""Search finds what it should, page by page, quickly, and only what the reader may see."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest
from packages.line.tests.journal.journals import facts, record
from packages.line.tests.records.conftest import misprint
from packages.line.tests.records.test_shipping import rows_of, shipped

from prooflight_line.journal.journal import Journal
from prooflight_line.records.database import RecordsError, allow, connect, upgrade
from prooflight_line.records.searching import SheetQuery, find, find_all, presses
from prooflight_line.records.shipping import Shipper


@pytest.fixture
def two_presses(tmp_path: Path, shipper: Callable[..., Shipper]) -> None:
    for number, plant in enumerate(("north", "south")):
        path = tmp_path / f"{plant}.sqlite"
        with Journal.open(str(path)) as journal:
            run = journal.begin_run(facts(job=f"job_{number}.pdf", started_s=1000.0 + number))
            for sheet in range(20):
                one = record(sheet, time_s=0.25 * (sheet // 2))  # sheets in pairs of one time
                journal.record(
                    run, misprint(one, "streak" if sheet == 4 else "spot") if sheet % 4 == 0 else one
                )
        shipped(shipper(press=plant, path=path, plant=plant))


@pytest.mark.usefixtures("two_presses")
def test_each_condition_selects(records: str) -> None:
    with connect(records) as connection:

        def count(**conditions: object) -> int:
            return len(find(connection, SheetQuery(**conditions)))  # type: ignore[arg-type]

        assert count() == 40
        assert count(press="north") == count(plant="north") == count(job="job_0") == 20
        assert count(job="job%") == 0  # no pattern: a name that begins so
        assert count(verdict="misprint") == 10
        assert count(kind="streak") == 2
        assert count(kind="streak", press="south") == 1
        # Of the press in the north sheets 8 and later, of that in the south, a second later, all.
        assert count(since=datetime.fromtimestamp(1001, UTC)) == 32
        assert count(until=datetime.fromtimestamp(1001, UTC)) == 8


@pytest.mark.usefixtures("two_presses")
def test_pages_of_hits_miss_and_repeat_nothing(records: str) -> None:
    with connect(records) as connection:
        whole = find(connection, SheetQuery())
        assert [hit.at for hit in whole] == sorted((hit.at for hit in whole), reverse=True)
        paged, before = [], None
        while hits := find(connection, SheetQuery(), before=before, limit=3):
            paged += hits
            before = hits[-1].position
        assert paged == whole == list(find_all(connection, SheetQuery()))


@pytest.mark.usefixtures("two_presses")
def test_presses_are_counted_since_a_time(records: str) -> None:
    with connect(records) as connection:
        states = presses(connection, since=datetime.fromtimestamp(1001, UTC))
    assert [(one.press, one.running, one.sheets, one.misprints) for one in states] == [
        ("north", "job_0.pdf", 12, 3),
        ("south", "job_1.pdf", 20, 5),
    ]
    with connect(records) as connection:
        later = presses(connection, since=datetime.fromtimestamp(9e9, UTC))
    assert [one.last_at for one in later] == [one.last_at for one in states]
    assert all(one.sheets == 0 and one.last_at is not None for one in later)


@pytest.mark.usefixtures("two_presses")
def test_a_role_sees_its_plants_and_nothing_else(records: str) -> None:
    with connect(records) as connection:
        connection.execute("DROP ROLE IF EXISTS reader")
        connection.execute("CREATE ROLE reader LOGIN")
    allow(records, "reader", "south")
    reader = records.replace("postgres@", "reader@")
    for table in ("presses", "runs", "sheets"):
        assert rows_of(reader, f"SELECT count(*) FROM {table}") == [(20 if table == "sheets" else 1,)]
    with connect(reader) as connection:
        assert {hit.press for hit in find(connection, SheetQuery())} == {"south"}
    with pytest.raises(RecordsError, match="permission denied"):
        allow(reader, "reader", "north")
    with connect(records) as connection:
        connection.execute("DROP OWNED BY reader")
        connection.execute("DROP ROLE reader")


def test_a_database_without_tables_says_what_to_do(database: str) -> None:
    with pytest.raises(
        RecordsError, match="contains no records of Prooflight; run `prooflight records upgrade`"
    ):
        connect(database)


def test_an_upgrade_is_done_once_and_a_later_schema_is_refused(database: str) -> None:
    assert upgrade(database) == (None, "0001")
    assert upgrade(database) == ("0001", "0001")
    with connect(database) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    with pytest.raises(RecordsError, match="has schema 9999"):
        connect(database)
    with pytest.raises(RecordsError, match="cannot be upgraded"):
        upgrade(database)


def test_a_password_is_never_shown() -> None:
    with pytest.raises(RecordsError) as refusal:
        connect("postgresql://ada:secret@127.0.0.1:1/none")
    assert "secret" not in str(refusal.value)


def test_no_search_reads_all_sheets(records: str, two_presses: None) -> None:
    """With 200,000 more sheets the planner reads by an index, whatever the conditions."""
    with connect(records) as connection:
        connection.execute(
            """INSERT INTO sheets (run_id, sheet, press_id, at, page, verdict, disposition, kind, late, first_line,
                   faults, notes)
               SELECT 1 + n % 2, 100 + n / 2, 1 + n % 2, to_timestamp(2000 + n), 'p0001',
                   CASE WHEN n % 50 = 0 THEN 'misprint' ELSE 'good' END, 'accept',
                   CASE WHEN n % 50 = 0 THEN 'spot' END, false, 0, '[]', '[]'
               FROM generate_series(1, 200000) AS n"""
        )
        connection.execute("ANALYZE")
        queries = (
            SheetQuery(),
            SheetQuery(press="north"),
            SheetQuery(kind="streak"),
            SheetQuery(verdict="misprint", press="south"),
            SheetQuery(job="job_1", verdict="misprint"),
            SheetQuery(job="job_1", since=datetime.fromtimestamp(1001, UTC)),
        )
        for query in queries:
            text, values = query.sql(before=find(connection, query, limit=2)[-1].position, limit=100)
            plan = connection.execute(f"EXPLAIN {text}", values, prepare=False).fetchall()
            assert not any("Seq Scan on sheets" in line for (line,) in plan), (query, plan)
