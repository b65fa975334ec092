"""The interface for programs: lists by pages, words, evidence, pictures that have not changed, problems."""

from __future__ import annotations

import io
import sqlite3
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.console.tests.consoles import Served, served, write_run
from packages.line.tests.journal.sample_rows import good, misprint

from prooflight_console.accounts.roles import Role
from prooflight_console.middleware import FIXED
from prooflight_console.problems import MEDIA_TYPE
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import RunEnd

if TYPE_CHECKING:
    from pathlib import Path

    from starlette.testclient import TestClient

API = "/api/v1"


@pytest.fixture
def viewer(console: Served) -> TestClient:
    return console.client(Role.VIEWER)


def all_of(client: TestClient, path: str, cursor: str, **asked: Any) -> list[dict[str, Any]]:
    """Every page of a list."""
    found: list[dict[str, Any]] = []
    while True:
        answer = client.get(API + path, params=asked)
        assert answer.status_code == 200, answer.text
        told = answer.json()
        found += told["items"]
        if told["next"] is None:
            return found
        asked[cursor] = told["next"]


def test_lists_come_page_by_page_and_none_comes_twice(console: Served, viewer: TestClient) -> None:
    write_run(console.journal, sheets=7, bad=(1,), job="second")
    assert [run["id"] for run in all_of(viewer, "/runs", "before", limit=1)] == [2, 1]
    sheets = all_of(viewer, "/runs/1/sheets", "after", limit=7)
    assert [one["sheet"] for one in sheets] == list(range(30))
    found = all_of(viewer, "/sheets", "before", limit=4)
    assert [(one["run"], one["sheet"]) for one in found] == [
        *((2, sheet) for sheet in reversed(range(7))),
        *((1, sheet) for sheet in reversed(range(30))),
    ]


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ({"verdict": "misprint"}, [(2, 1), (1, 12), (1, 11), (1, 10)]),
        ({"kind": "spots-voids", "job": "cata"}, [(1, 12), (1, 11), (1, 10)]),
        ({"page": "p0001"}, [(2, 0), (1, 0)]),
        ({"press": "ri", "to_review": True, "job": "second"}, [(2, 1)]),
        ({"job": "%"}, []),
        ({"since": "1970-01-01T00:30:00Z", "verdict": "misprint"}, [(2, 1)]),
        ({"until": "1970-01-01T00:30:00Z", "page": "p0001"}, [(1, 0)]),
    ],
)
def test_what_is_searched_is_found(
    console: Served, viewer: TestClient, asked: dict[str, Any], found: list[tuple[int, int]]
) -> None:
    write_run(console.journal, sheets=3, bad=(1,), job="second", started_s=5000.0)
    sheets = all_of(viewer, "/sheets", "before", **asked)
    assert [(one["run"], one["sheet"]) for one in sheets] == found


def test_last_names_the_last_run(console: Served, viewer: TestClient) -> None:
    write_run(console.journal, sheets=3, bad=(), job="second")
    assert viewer.get(f"{API}/runs/last").json()["job"] == "second"


def test_the_counts_of_a_run_that_goes_on_are_those_of_now(console: Served, viewer: TestClient) -> None:
    with Journal.open(str(console.journal)) as journal:
        assert viewer.get(f"{API}/runs/1").json()["state"] == "running"
        journal.record(1, misprint(30))
        journal.commit()
        assert viewer.get(f"{API}/runs/1").json()["misprints"] == 4
        journal.end_run(1, RunEnd(ended_s=2000.0, ending="finished", counts={"stages": {}}))
    told = viewer.get(f"{API}/runs/1").json()
    assert (told["state"], told["misprints"], told["ended"]) == ("finished", 4, "1970-01-01T00:33:20+00:00")


@pytest.mark.parametrize(
    ("path", "status", "kind"),
    [
        ("/runs/99", 404, "not-found"),
        ("/runs/x", 404, "not-found"),
        ("/runs/1/sheets/30", 404, "not-found"),
        ("/runs/1/sheets/5/evidence", 404, "not-found"),
        ("/runs/1/incidents/9", 404, "not-found"),
        ("/runs/1/sheets/10/replay", 409, "no-press"),
        ("/runs/1/sheets/10/pictures/scan/20/0/0", 404, "not-found"),
        ("/runs/1/sheets/10/pictures/other/0/0/0", 404, "not-found"),
        ("/runs?limit=0", 422, "invalid"),
        ("/runs?limit=many", 422, "invalid"),
        ("/nothing", 404, "not-found"),
    ],
)
def test_what_cannot_be_answered_says_why(viewer: TestClient, path: str, status: int, kind: str) -> None:
    answer = viewer.get(API + path)
    assert (answer.status_code, answer.headers["content-type"]) == (status, MEDIA_TYPE)
    told = answer.json()
    assert (told["status"], told["type"]) == (status, f"urn:prooflight:{kind}")
    assert told["title"]
    assert told["detail"]


def test_a_method_that_is_none_says_so(viewer: TestClient) -> None:
    answer = viewer.put(f"{API}/runs")
    assert (answer.status_code, answer.headers["content-type"]) == (405, MEDIA_TYPE)


def test_a_fault_of_our_own_tells_nothing_of_its_inside(
    console: Served, viewer: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise RuntimeError("the secret inside")

    monkeypatch.setattr(console.console.reading, "runs", fails)
    answer = viewer.get(f"{API}/runs")
    assert (answer.status_code, answer.json()["type"]) == (500, "urn:prooflight:fault")
    assert "secret" not in answer.text
    page = viewer.get("/report")
    assert (page.status_code, "secret" in page.text) == (500, False)
    for headers in (answer.headers, page.headers):
        assert {name.decode(): value.decode() for name, value in FIXED.items()}.items() <= headers.items()
        assert headers["cache-control"] == "no-store"
        assert headers["x-request-id"]


def test_words_are_added_and_the_last_one_counts(console: Served, viewer: TestClient) -> None:
    operator, path = console.client(Role.OPERATOR), f"{API}/runs/1/incidents/1"
    assert viewer.get(path).json() | {"labels": []} == viewer.get(path).json()
    for word in ("seen", "misprint", "false-alarm"):
        console.clock.now_s += 60
        answer = operator.post(f"{path}/labels", json={"label": word, "note": f"it is {word}"})
        assert answer.status_code == 201
    told = viewer.get(path).json()
    assert (told["label"], told["seen"], told["count"]) == ("false-alarm", True, 3)
    assert [(one["label"], one["by"], one["at_s"]) for one in told["labels"]] == [
        ("seen", "operator", 1_000_060.0),
        ("misprint", "operator", 1_000_120.0),
        ("false-alarm", "operator", 1_000_180.0),
    ]
    assert operator.post(f"{path}/labels", json={"label": "maybe"}).status_code == 422
    assert operator.post(f"{API}/runs/1/sheets/10/labels", json={"label": "unknown"}).status_code == 201
    sheet = viewer.get(f"{API}/runs/1/sheets/10").json()
    assert ([one["label"] for one in sheet["labels"]], sheet["incident"]) == (["unknown"], 1)


def test_what_people_call_a_false_alarm_is_not_printed_again(console: Served, viewer: TestClient) -> None:
    """The run broke off with 30 of its 40 sheets: the other ten were not printed."""
    path = f"{API}/runs/1/reprint"
    told = viewer.get(path).json()
    assert [one["run_sheet"] for one in told["sheets"]] == [10, 11, 12, *range(30, 40)]
    assert (told["count"], told["unprinted"], told["by"], told["trays_from"]) == (13, 10, "verdicts", None)
    assert viewer.get(f"{API}/now").json()["to_print_again"] == 13
    console.client(Role.OPERATOR).post(f"{API}/runs/1/incidents/1/labels", json={"label": "false-alarm"})
    told = viewer.get(path).json()
    assert [one["run_sheet"] for one in told["sheets"]] == list(range(30, 40))
    report = viewer.get(f"{API}/runs/1/report").json()
    assert (report["false_alarms"], report["labelled"], report["to_print_again"]) == (3, 1, 10)
    assert report["false_alarms_per_good_sheet"] == pytest.approx(3 / 30)
    assert report["labels_by_user"] == {"operator": {"false-alarm": 1}}


def test_words_stay_with_their_run_where_a_journal_begins_anew(tmp_path: Path) -> None:
    console = served(tmp_path)
    console.client(Role.OPERATOR).post(f"{API}/runs/1/incidents/1/labels", json={"label": "false-alarm"})
    console.close()
    for file in tmp_path.glob("journal.sqlite*"):
        if file.is_file() and "console" not in file.name:
            file.unlink()
    write_run(console.journal, started_s=9000.0)
    again = served(tmp_path, run=False)
    told = again.client(Role.VIEWER).get(f"{API}/runs/1/incidents/1").json()
    assert (told["label"], told["labels"]) == (None, [])
    again.close()


def test_evidence_is_told_and_given_to_engineers(console: Served, viewer: TestClient) -> None:
    told = viewer.get(f"{API}/runs/1/sheets/10/evidence").json()
    assert {one["name"]: one["shape"] for one in told["arrays"]} == {
        "cut0": [1, 120, 120],
        "cut0_mm": [4],
        "wrong_page": [],
    }
    assert told["cuts"] == [{"name": "cut0", "box_mm": [100.0, 50.0, 12.0, 12.0]}]
    assert viewer.get(f"{API}/runs/1/sheets/10/evidence.npz").status_code == 403
    file = console.client(Role.ENGINEER).get(f"{API}/runs/1/sheets/10/evidence.npz").content
    with np.load(io.BytesIO(file)) as arrays:
        assert arrays["cut0"][0, 50, 50] == 400


def test_a_picture_that_has_not_changed_is_not_sent_again(viewer: TestClient) -> None:
    told = viewer.get(f"{API}/runs/1/sheets/10/pictures").json()
    path = f"{API}/runs/1/sheets/10/pictures/scan/{told['levels'] - 1}/1/0"
    first = viewer.get(path)
    assert (first.status_code, first.headers["content-type"]) == (200, "image/webp")
    again = viewer.get(path, headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["etag"] == first.headers["etag"]
    assert viewer.get(path, headers={"If-None-Match": '"other"'}).status_code == 200


def test_damaged_rows_are_counted_and_the_others_given(console: Served, viewer: TestClient) -> None:
    with sqlite3.connect(console.journal) as connection:
        connection.execute("UPDATE pages SET score = 5 WHERE sheet = 20")
    told = viewer.get(f"{API}/runs/1/sheets", params={"limit": 500}).json()
    assert ([one["sheet"] for one in told["items"]], told["damaged"]) == (
        [sheet for sheet in range(30) if sheet != 20],
        1,
    )


def test_a_file_that_is_no_journal_is_a_problem_and_no_fault(tmp_path: Path) -> None:
    console = served(tmp_path, run=False)
    console.journal.write_text("no journal at all")
    client = console.client(Role.VIEWER)
    answer = client.get(f"{API}/runs")
    assert (answer.status_code, answer.json()["type"]) == (503, "urn:prooflight:journal")
    assert "journal.sqlite" in answer.json()["detail"]
    console.close()


def test_drift_in_bins_keeps_mean_and_extremes(console: Served, viewer: TestClient) -> None:
    told = viewer.get(f"{API}/runs/1/drift", params={"points": 3}).json()
    assert told["sheets"] == [0, 10, 20]
    black = next(one for one in told["channels"] if one["name"] == "gain-black")
    assert (black["unit"], black["tolerance"]) == ("%", pytest.approx(7.0))
    assert black["mean"] == pytest.approx([0.45, 1.45, 2.45])
    assert black["least"] == pytest.approx([0.0, 1.0, 2.0])
    assert black["greatest"] == pytest.approx([0.9, 1.9, 2.9])
    one = viewer.get(f"{API}/runs/1/drift", params={"channel": "shift-x"}).json()
    assert [channel["name"] for channel in one["channels"]] == ["shift-x"]


def test_latencies_are_counted_each_once(viewer: TestClient) -> None:
    told = viewer.get(f"{API}/runs/1/latency").json()
    assert sum(told["counts"]) == 30
    assert (told["median_ms"], told["greatest_ms"]) == (80.0, 110.0)


def test_two_runs_are_compared_by_the_numbers_of_the_page(console: Served, viewer: TestClient) -> None:
    write_run(console.journal, sheets=20, bad=(3,), job="second")
    with Journal.open(str(console.journal)) as journal:
        journal.record(2, good(20, late=True, faults=("lost-lines",)))
        journal.end_run(2, RunEnd(ended_s=2000.0, ending="finished", counts={"elapsed_s": 7.0, "stages": {}}))
    told = viewer.get(f"{API}/runs/1/compared", params={"against": "last"}).json()
    for part, run in (("run", 1), ("against", 2)):
        page = viewer.get(f"/press/{run}/course").json()
        assert told[part]["run"] == viewer.get(f"{API}/runs").json()["items"][2 - run]
        assert {name: told[part][name] for name in ("charts", "troubles", "latency", "sheets")} == {
            name: page[name] for name in ("charts", "troubles", "latency", "sheets")
        }
    figures = told["against"]["figures"]
    names = ("pages", "misprints", "late", "lost_lines", "sheets_per_s", "inspection_median_ms")
    assert [figures[name] for name in names] == [21, 1, 1, 1, 3.0, 80.0]
    assert (told["run"]["figures"]["pages"], told["run"]["figures"]["sheets_per_s"]) == (30, None)
    assert viewer.get(f"{API}/runs/1/compared").status_code == 422
    assert viewer.get(f"{API}/runs/1/compared", params={"against": "9"}).status_code == 404


def test_the_schema_is_openapi_3_1_of_the_api_alone(viewer: TestClient) -> None:
    told = viewer.get(f"{API}/openapi.json").json()
    assert told["openapi"].startswith("3.1")
    assert all(path.startswith("/api/v1/") for path in told["paths"])
    assert "ProblemBody" in told["components"]["schemas"]


def test_a_sheet_of_no_page_and_one_without_a_place_can_be_looked_at(
    console: Served, viewer: TestClient
) -> None:
    with Journal.open(str(console.journal)) as journal:
        journal.record(1, good(30, job_page=None))
        journal.record(1, misprint(31, kept=False))
    for sheet, layers in ((30, []), (31, [])):
        told = viewer.get(f"{API}/runs/1/sheets/{sheet}/pictures").json()
        assert told["layers"] == layers
        assert viewer.get(f"/runs/1/sheets/{sheet}").status_code == 200
        assert viewer.get(f"/runs/1/sheets/{sheet}/thumbnail").headers["content-type"] == "image/svg+xml"


def test_a_run_that_goes_on_is_counted_on_as_if_all_were_counted(console: Served) -> None:
    """Also where a sheet is recorded again, a page has a note, and another run begins."""
    reading = console.console.reading
    with Journal.open(str(console.journal)) as journal:
        steps = [
            [misprint(30), good(31, late=True)],
            [],
            [good(32, faults=("slip",))],
            [misprint(5)],
            [good(33, notes=("the lamp fades",))],
            [good(34)],
        ]
        for step in steps:
            for record in step:
                journal.record(1, record)
            journal.commit()
            assert reading.run(1) == journal.run(1)
        other = journal.begin_run(replace(journal.run(1).facts, started_s=3000.0))
        journal.record(other, misprint(0))
        journal.commit()
        assert reading.run(other) == journal.run(other)
        assert reading.run(1) == journal.run(1)
