"""Sheets and sets in the console, and what is printed again."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from packages.console.tests.consoles import served
from packages.line.tests.journal.sample_rows import facts, good, misprint

from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan
from prooflight_console.accounts.roles import Role
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import RunEnd
from prooflight_line.plant.gate.log import GateLog, log_path
from prooflight_line.plant.gate.registers import Code, Result

if TYPE_CHECKING:
    from pathlib import Path

API = "/api/v1"
PLAN = SheetPlan(
    layout=Layout.parse("sides=2,n-up=2x1,pages-a-set=8"), sides=4, sheets=6, page_mm=(100.0, 140.0)
)


def write(journal: Path, *, bad: int) -> int:
    """Six sheets of two sides, of which one side is a misprint."""
    with Journal.open(str(journal)) as opened:
        run = opened.begin_run(facts(sheets=12, settings={"layout": PLAN.facts}))
        for at in range(12):
            made = misprint(at) if at == bad else good(at)
            name = PLAN.layout.side_name(PLAN.number_at(at))
            opened.record(run, replace(made, verdict=replace(made.verdict, page=name)))
        opened.commit()
        opened.end_run(run, RunEnd(ended_s=2000.0, ending="finished"))
        return run


@pytest.fixture
def console(tmp_path: Path) -> Any:
    write(tmp_path / "journal.sqlite", bad=7)
    made = served(tmp_path, run=False)
    yield made
    made.close()


def test_a_bad_back_is_told_with_its_sheet_and_its_set(console: Any) -> None:
    viewer = console.client(Role.VIEWER)
    told = viewer.get(f"{API}/runs/1/report").json()["layout_counts"]
    assert told["counts"] == {
        "sheets": {"misprint": 1, "not-inspected": 0, "good": 5},
        "sets": {"misprint": 1, "not-inspected": 0, "good": 2},
        "sets_spoiled": 1,
    }
    (sheet,), (own,) = told["sheets"], told["sets"]
    assert (sheet["sheet"], sheet["name"], sheet["copy"]) == (3, "s0002", 2)
    assert [side["verdict"] for side in sheet["sides"]] == ["good", "misprint"]
    assert (own["set_number"], own["bad"], own["complete"]) == (1, [3], True)
    assert viewer.get(f"{API}/now").json()["layout_counts"] == told["counts"]


@pytest.mark.parametrize(
    ("language", "words"), [("en", ["Sheets and sets", "back"]), ("de", ["Bogen und Sätze", "Rückseite"])]
)
def test_pages_show_them_in_both_languages(console: Any, language: str, words: list[str]) -> None:
    viewer = console.client(Role.VIEWER)
    text = viewer.get("/report/1", headers={"Accept-Language": language}).text
    assert all(word in text for word in words)
    assert {"en": "good: 5", "de": "gut: 5"}[language] in viewer.get(
        "/", headers={"Accept-Language": language}
    ).text


def test_without_a_gate_a_spoiled_set_is_printed_again_by_its_verdicts(console: Any) -> None:
    viewer, operator = console.client(Role.VIEWER), console.client(Role.OPERATOR)
    told = viewer.get(f"{API}/runs/1/reprint").json()
    assert told["by"] == "verdicts"
    assert [(one["page"], one["copy"], one["pages"], one["take_out"]) for one in told["sheets"]] == [
        ("s0001", 2, [1, 2, 3, 4], True),
        ("s0002", 2, [5, 6, 7, 8], False),
    ]
    assert [one["behind"] for one in told["sheets"]] == ["s0002", "s0002"]
    page = viewer.get("/runs/1/reprint").text
    assert '<td class="n">2</td><td>5, 6, 7, 8</td><td>s0002</td>' in page
    operator.post(f"{API}/runs/1/incidents/1/labels", json={"label": "false-alarm"})
    assert viewer.get(f"{API}/runs/1/reprint").json()["sheets"] == []


def test_with_a_gate_the_list_is_that_of_the_trays(console: Any) -> None:
    """What lies in the reject tray is printed again, whatever people say of the alarm, and so is what was lost."""
    with GateLog(log_path(console.journal, 1)) as log:
        log.add(
            "run",
            run=1,
            job_pages=4,
            settings={},
            layout=replace(PLAN, layout=Layout.parse("sides=2,n-up=2x1")).facts,
        )
        for sheet in range(6):
            result, code = (Result.DIVERT, Code.MISPRINT) if sheet == 3 else (Result.ACCEPT, Code.GOOD)
            tag = 2 * sheet + 2
            log.add(
                "decision", tag=tag, sheet=tag - 1, came=True, result=int(result), code=int(code), job_page=sheet,
                page=PLAN.name(sheet), set=sheet, why="", position=None, rows=[tag - 2, tag - 1],
            )  # fmt: skip
            log.add("tray", tag=tag, tray="reject" if sheet in (3, 5) else "good", session=1)
    viewer = console.client(Role.VIEWER)
    console.client(Role.OPERATOR).post(f"{API}/runs/1/incidents/1/labels", json={"label": "false-alarm"})
    told = viewer.get(f"{API}/runs/1/reprint").json()
    assert told["by"] == "trays"
    assert [(one["page"], one["copy"], one["why"]) for one in told["sheets"]] == [
        ("s0002", 2, "the sheet is a misprint"),
        ("s0002", 3, "the controller reported no tray"),
    ]
