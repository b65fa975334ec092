"""Two runs of a press with a camera a side, put together to sheets as a user does."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from packages.line.tests.journal.sample_rows import facts, good, misprint

from prooflight.cli import run
from prooflight.detectors.verdict import Verdict
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from prooflight_line.journal.records import PageRecord

OF_JOB = 4
"""Sheets of a copy: eight pages."""


def write(path: Path, rows: Iterable[PageRecord], **more: Any) -> None:
    with Journal.open(str(path)) as journal:
        run_id = journal.begin_run(facts(**more))
        for row in rows:
            page = f"p{(row.job_page or 0) % OF_JOB + 1:04}"
            journal.record(run_id, replace(row, verdict=replace(row.verdict, page=page)))
        journal.commit()


def paired(capsys: pytest.CaptureFixture[str], folder: Path, *more: str) -> tuple[int, Any, str]:
    told = ("--journal", str(folder / "fronts.sqlite"), "--backs-journal", str(folder / "backs.sqlite"))
    code = run(["run", "pair", "last", "last", *told, *more])
    captured = capsys.readouterr()
    facts_ = json.loads(captured.out) if captured.out.startswith("{") else None
    return code, facts_, captured.err + captured.out


def test_a_bad_back_spoils_its_sheet_and_its_set_and_pages_are_those_of_the_whole_job(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "fronts.sqlite", map(good, range(8)))
    write(tmp_path / "backs.sqlite", (misprint(at) if at == 5 else good(at) for at in range(8)))
    code, told, _ = paired(capsys, tmp_path, "--pages-a-set", "4", "--json")
    assert code == 1
    assert [one["verdict"] for one in told["sheets"]] == ["good"] * 5 + ["misprint"] + ["good"] * 2
    bad = told["sheets"][5]
    assert (bad["name"], bad["copy"], bad["bad_pages"]) == ("s0002", 2, [4])
    assert [(one["name"], one["rows"]) for one in bad["sides"]] == [("p0003", [5]), ("p0004", [5])]
    assert [one["verdict"] for one in told["sets"]] == ["good", "good", "misprint", "good"]
    code, _, said = paired(capsys, tmp_path)
    assert (code, "8 sheets, 7 good, 1 misprint" in said) == (1, True)


def test_sides_are_paired_by_their_place_where_a_camera_lost_a_sheet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The backs lack sheet 2: the run knows from the page that came next, and its rows are numbered on."""
    write(tmp_path / "fronts.sqlite", (misprint(at) if at == 6 else good(at) for at in range(8)))
    places = [at for at in range(8) if at != 2]
    lacking = (
        replace(misprint(sheet) if place == 6 else good(sheet), job_page=place)
        for sheet, place in enumerate(places)
    )
    write(tmp_path / "backs.sqlite", lacking)
    code, told, _ = paired(capsys, tmp_path, "--json")
    assert code == 3
    assert [one["verdict"] for one in told["sheets"]] == [
        *("good", "good", "not-inspected", "good", "good", "good"),
        *("misprint", "good"),
    ]
    assert told["sheets"][2]["why"] == ["back: the sheet was not detected"]
    assert [one["rows"] for one in told["sheets"][6]["sides"]] == [[6], [5]]


def test_a_run_that_ended_earlier_leaves_sheets_without_that_side(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "fronts.sqlite", map(good, range(6)))
    nowhere = replace(good(4), job_page=None, verdict=Verdict.skipped("p0001", "blank"))
    write(tmp_path / "backs.sqlite", [*map(good, range(4)), nowhere])
    code, told, _ = paired(capsys, tmp_path, "--json")
    assert (code, [one["verdict"] for one in told["sheets"]]) == (3, ["good"] * 4 + ["not-inspected"] * 2)


def test_what_cannot_be_paired_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("fronts", "backs"):
        write(tmp_path / f"{name}.sqlite", map(good, range(8)))
    code, _, said = paired(capsys, tmp_path, "--pages-a-set", "3")
    assert (code, "a set takes 3 pages, and a sheet 2" in said) == (2, True)
    same = str(tmp_path / "fronts.sqlite")
    assert run(["run", "pair", "1", "last", "--journal", same]) == 2
    assert "run 1 is given for fronts and for backs" in capsys.readouterr().err
    write(tmp_path / "backs.sqlite", map(good, range(2)), settings={"layout": {"words": "sides=2"}})
    code, _, said = paired(capsys, tmp_path)
    assert (code, "run 2 of the backs was watched with --layout" in said) == (2, True)
