"""The console shows all presses whose records it is given, and none where it is given none."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("psycopg", reason='needs pip install "prooflight-line[records]"')
pytest.importorskip("alembic", reason='needs pip install "prooflight-line[records]"')

from packages.console.tests.consoles import Served, served, write_run

from prooflight import __version__
from prooflight_console.accounts.roles import Role
from prooflight_line.journal.following import follow
from prooflight_line.records.database import connect, upgrade
from prooflight_line.records.shipping import Shipper
from prooflight_line.testing.postgres import LocalPostgres, local_postgres, server_programs


@pytest.fixture(scope="module")
def server() -> Iterator[LocalPostgres]:
    if server_programs() is None:
        pytest.skip("PostgreSQL is not installed")
    with local_postgres("fsync=off") as started:
        upgrade(started.url)
        yield started


@pytest.fixture
def console(server: LocalPostgres, tmp_path: Path) -> Iterator[Served]:
    """A console that shows two presses of two plants."""
    with connect(server.url) as connection:
        connection.execute("TRUNCATE presses, runs, sheets, labels RESTART IDENTITY")
    for name, plant in (("press 1", "Bern"), ("press <2>", "Basel")):
        path = tmp_path / f"{plant}.sqlite"
        write_run(path, sheets=60, bad=tuple(range(5, 60)), job=f"{plant}.pdf")
        journal = follow(path, version=__version__)
        assert journal is not None
        shipper = Shipper.open(
            server.url, press=name, plant=plant, journal=journal, announce=lambda line: None
        )
        while shipper.step().more:
            pass
        shipper.close()
        journal.close()
    made = served(tmp_path, records=server.url)
    yield made
    made.close()


def test_the_overview_counts_the_sheets_of_each_press(console: Served, server: LocalPostgres) -> None:
    with connect(server.url) as connection:
        connection.execute("UPDATE sheets SET at = now()")
        connection.execute(
            "UPDATE presses SET shipped_at = to_timestamp(%s) - interval '2 minutes' WHERE plant = 'Bern'",
            [console.clock.now_s],
        )
    shown = console.client(Role.VIEWER).get("/presses").text
    assert shown.index("Basel") < shown.index("Bern")
    assert "press &lt;2&gt;" in shown
    assert shown.count('<td class="n">60</td>') == 2
    assert shown.count("91.67 %") == 2
    assert shown.count("running, but out of reach") == 1
    assert '<a href="/presses" aria-current="page">' in shown
    assert shown.count('aria-current="page"') == 1


def test_a_search_over_all_presses_is_paged(console: Served) -> None:
    client = console.client(Role.VIEWER)
    first = client.get("/presses/sheets").text
    assert first.count('class="main-cell"') == 50
    address = first.split('hx-get="')[1].split('"')[0].replace("&amp;", "&")
    rest, seen = client.get(address, headers={"HX-Request": "true"}).text, 50
    while True:
        seen += rest.count('class="main-cell"')
        if 'hx-get="' not in rest:
            break
        address = rest.split('hx-get="')[1].split('"')[0].replace("&amp;", "&")
        rest = client.get(address, headers={"HX-Request": "true"}).text
    assert seen == 110
    assert client.get("/presses/sheets?plant=Bern").text.count('class="main-cell"') == 50
    assert "No sheet matches" in client.get("/presses/sheets?since=2020-01-01").text
    assert client.get("/presses/sheets?before=1/2").status_code == 422
    assert client.get("/presses/sheets?before=2026T/1/2").status_code == 422


def test_a_database_that_is_away_is_a_problem_of_its_own(console: Served, tmp_path: Path) -> None:
    away = served(tmp_path / "other", records="postgresql://ada:secret@127.0.0.1:1/none")
    answer = away.client(Role.VIEWER).get("/presses")
    away.close()
    assert answer.status_code == 503
    assert "cannot be reached" in answer.text
    assert "secret" not in answer.text


def test_without_records_there_is_no_such_page(tmp_path: Path) -> None:
    alone = served(tmp_path)
    client = alone.client(Role.VIEWER)
    assert 'href="/presses"' not in client.get("/search").text
    assert client.get("/presses").status_code == 404
    alone.close()


def test_sheets_of_all_presses_are_sought_by_place_ink_and_size(console: Served) -> None:
    """Each misprint has one defect of 3 x 3 mm at (104, 54), of no single ink."""
    client = console.client(Role.VIEWER)
    first = "/presses/sheets?press=press+1"
    some, none = "job=Bern.pdf", "No sheet matches these criteria."
    for query in ("ink=none", "size=3", "x=107&y=57", "x=110&y=54&within=3", "x=100&width=5", "page=p0011"):
        assert none not in client.get(f"{first}&{query}").text, query
        assert none not in client.get(f"{first}&{some}&verdict=any&{query}").text, query
    for query in (
        "ink=C",
        "size=3.1",
        "x=108&y=57",
        "x=110&y=54&within=2.9",
        "y=58&height=100",
        "page=p0001",
    ):
        assert none in client.get(f"{first}&{query}").text, query
    assert client.get(f"{first}&x=far").status_code == 422
