"""The journal's commands as a user calls them."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import shutil
import sqlite3
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.cli.calls import call

from prooflight.cli.show import people
from prooflight.detectors.verdict import Region, Verdict
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.redeciding import evidence_to_store
from prooflight.rng import stream
from prooflight.simulation.scans import scan_page
from prooflight_line.cli.runs import command as runs
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunEnd, RunFacts

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

STREAK = Region(x_mm=83.0, y_mm=0.0, width_mm=1.0, height_mm=297.0, score=9.0, kind="streak")


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(people, "width", 160)


@pytest.fixture(scope="module")
def artefact(press: Press, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("press") / "rig.press"
    press.save(path)
    return path


@pytest.fixture(scope="module")
def journal(press: Press, page: Page, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run 1: sheet 0 judged and kept, 1 a streak that came late, 2 passed by, 3 good, 4 noted. Run 2: begun."""
    path = tmp_path_factory.mktemp("journal") / "j.sqlite"
    inspector = Inspector.of(press, "chi-square")
    prepared = inspector.prepare(page)
    scan = scan_page(
        page, press=press, request=None, others=(), fetch=lambda _: page, rng=stream(1, "print", 1)
    )
    inspection = inspector.inspect(prepared, scan.dn, scan_name="scan")
    bad = Verdict(
        page="p0002",
        verdict="misprint",
        score=np.inf,
        threshold=1.0,
        kind="streak",
        regions=(STREAK,),
    )
    good = Verdict(page="p0004", verdict="good", score=0.5, threshold=1.0, shift_mm=(0.1, -0.2))

    def record(sheet: int, verdict: Verdict, **more: object) -> PageRecord:
        told = {"late": False, "first_line": 3000 * sheet, "time_s": 0.2 * sheet} | more
        return PageRecord(sheet=sheet, job_page=sheet, verdict=verdict, **told)

    facts = RunFacts(
        job="[job].pdf",
        job_digest="j",
        press=press.name,
        press_digest=press.digest,
        detector="chi-square",
        source="drum:5",
        started_s=1.7e9,
        sheets=5,
    )
    with Journal.open(str(path)) as opened:
        first = opened.begin_run(facts)
        opened.record(
            first,
            record(
                0, inspection.verdict, evidence=evidence_to_store(inspection, prepared.page, inspector.press)
            ),
        )
        opened.record(first, record(1, bad, late=True, nuisance={"gain-C": 0.01}))
        passed = Verdict(page="p0003", verdict="not-inspected", reason="the machine is too slow")
        opened.record(first, record(2, passed, faults=("slip", "lost-lines")))
        opened.record(first, record(3, good))
        opened.record(first, record(4, good, notes=("black drifts",)))
        opened.end_run(first, RunEnd(ended_s=1.7e9 + 60, ending="stopped", detail="by hand"))
        opened.begin_run(facts)
    return path


def test_runs_are_listed(journal: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call(capsys, "runs", "--journal", journal, "--json")
    assert code == 0
    rows = json.loads(out)
    assert [(row["id"], row["state"], row["pages"]) for row in rows] == [
        (1, "stopped", 5),
        (2, "interrupted", 0),
    ]
    counts = ("misprints", "not_inspected", "late", "faulty", "dropped_pages", "dropped_evidence")
    assert [rows[0][name] for name in counts] == [1, 1, 1, 1, 0, 0]
    assert (rows[0]["started"], rows[0]["ended"]) == (
        "2023-11-14T22:13:20+00:00",
        "2023-11-14T22:14:20+00:00",
    )
    assert rows[1]["ended"] is None
    assert rows[0]["job"] == "[job].pdf"
    code, out, _ = call(capsys, "runs", "--journal", f"sqlite:///{journal}")
    assert code == 0
    assert "[job].pdf" in out
    assert "interrupted" in out
    assert json.loads(call(capsys, "runs", "--journal", journal, "--last", 1, "--json")[1])[0]["id"] == 2


def test_a_run_is_shown_by_the_pages_to_look_at(journal: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call(capsys, "run", "show", 1, "--journal", journal)
    assert code == 0
    assert "stopped: by hand" in out
    assert "5 of 5" in out
    for said in (
        "p0002",
        "streak",
        "in a streak 1 mm wide, 84 mm from the left edge; late",
        "The machine is too slow",
        "slip; lost-lines",
        "black drifts",
    ):
        assert said in out
    assert out.count("p0004") == 1  # the one with a note
    assert call(capsys, "run", "show", 1, "--journal", journal, "--all")[1].count("p0004") == 2
    out = call(capsys, "run", "show", 1, "--journal", journal, "--last", 1)[1]
    assert "2 pages before these" in out
    assert "streak" not in out
    assert "No pages" in call(capsys, "run", "show", "last", "--journal", journal)[1]


def test_rows_are_verdicts_as_inspect_gives_them_and_more(
    journal: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = call(capsys, "run", "show", 1, "--journal", journal, "--json")
    assert code == 0
    rows = json.loads(out, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert [row["sheet"] for row in rows] == [0, 1, 2, 3, 4]
    wanted = set(Verdict.__slots__) | {"late", "sheet", "job_page", "first_line", "time_s"}
    assert set(rows[0]) == wanted | {"disposition", "decided_by", "faults", "notes", "nuisance", "asked"}
    assert rows[1]["score"] is None  # infinity
    assert rows[1]["regions"][0]["x_mm"] == 83.0
    assert rows[2]["faults"] == ["slip", "lost-lines"]
    lines = call(capsys, "run", "export", 1, "--journal", journal, "--json")[1].splitlines()
    assert [json.loads(line) for line in lines] == rows


def test_csv_has_a_row_a_page(journal: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, out, _ = call(capsys, "run", "show", 1, "--journal", journal, "--csv")
    assert code == 0
    rows = list(csv.DictReader(io.StringIO(out)))
    assert [row["sheet"] for row in rows] == ["0", "1", "2", "3", "4"]
    streak, passed, good = rows[1:4]
    assert (streak["kind"], streak["regions"], streak["x_mm"], streak["height_mm"]) == (
        "streak",
        "1",
        "83.0",
        "297.0",
    )
    assert streak["score"] == ""  # infinite, and not that of its region
    assert json.loads(streak["nuisance"]) == {"gain-C": 0.01}
    assert passed["faults"].split("\n") == ["slip", "lost-lines"]
    assert (good["regions"], good["x_mm"], good["shift_x_mm"], good["shift_y_mm"]) == ("0", "", "0.1", "-0.2")
    assert call(capsys, "run", "export", 1, "--journal", journal, "-o", tmp_path / "run.csv")[0] == 0
    assert (tmp_path / "run.csv").read_text() == out
    assert call(capsys, "run", "export", 1, "--journal", journal)[1] == out


def test_a_verdict_is_replayed(journal: Path, artefact: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("run", "replay", 1, 0, "--press", artefact, "--journal", journal)
    code, out, _ = call(capsys, *arguments, "--json")
    assert code == 0
    told = json.loads(out)
    assert told["same"] is True
    assert told["figures"]["score"]["recorded"] == told["figures"]["score"]["again"] > 0
    code, out, _ = call(capsys, *arguments)
    assert code == 0
    assert out.count("same") == 5


def test_a_figure_that_differs_is_said_so(
    journal: Path, artefact: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """As if somebody had changed a row: evidence and score no longer belong together."""
    with Journal.open(str(journal), read_only=True) as opened:
        page, facts = opened.page(1, 0), opened.run(1).facts
    assert page.evidence is not None
    counts = dict(page.evidence)
    counts["tile_histogram"] = counts["tile_histogram"].copy()
    counts["tile_histogram"][0, 0, 0, 0] += 500
    changed = PageRecord(
        sheet=0, job_page=0, verdict=page.verdict, late=False, first_line=0, time_s=0.0, evidence=counts
    )
    other = tmp_path / "other.sqlite"
    with Journal.open(str(other)) as opened:
        opened.record(opened.begin_run(facts), changed)
    code, out, _ = call(capsys, "run", "replay", 1, 0, "--press", artefact, "--journal", other, "--json")
    assert code == 1
    assert json.loads(out)["same"] is False


def test_a_replay_that_cannot_be_is_one_line(
    journal: Path, artefact: Path, two_sensor_press: Press, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    two_sensor_press.save(tmp_path / "two.press")
    for arguments, said in (
        ((1, 0, "--press", tmp_path / "two.press"), "has digest"),
        ((1, 1, "--press", artefact), "no evidence of sheet 1 of run 1 is stored"),
        ((1, 77, "--press", artefact), "run 1 has no sheet 77"),
        ((8, 0, "--press", artefact), "there is no run 8; the last is run 2"),
        (("x", 0, "--press", artefact), "'x' is not a number"),
    ):
        code, out, err = call(capsys, "run", "replay", *arguments, "--journal", journal)
        assert (code, out) == (2, "")
        assert said in err
        assert err.count("\n") == 1


def test_what_cannot_be_asked_for_is_one_line(
    journal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, said in (
        (("runs", "--journal", tmp_path / "none.sqlite"), "there is no journal"),
        (("run", "show", 1, "--journal", "mysql://host/x"), "database of mysql"),
        (("run", "export", 1, "--csv", "--json", "--journal", journal), "choose one"),
    ):
        code, out, err = call(capsys, *arguments)
        assert (code, out) == (2, "")
        assert said in err
        assert err.count("\n") == 1


@pytest.mark.parametrize("number", ["-3", "0", "9" * 5000, str(10**20), "last run", "[/x]"])
def test_numbers_of_runs_that_cannot_be_are_one_line(
    journal: Path, number: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = call(capsys, "run", "show", "--journal", journal, "--", number)
    assert (code, out) == (2, "")
    assert "there is no run" in err or "is not a number" in err
    assert err.count("\n") == 1


def test_more_than_there_is_may_be_asked_for(journal: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "run", "show", 1, "--last", 10**20, "--journal", journal)[0] == 0
    assert call(capsys, "runs", "--last", 10**20, "--journal", journal)[0] == 0


def change(journal: Path, to: Path, statement: str) -> Path:
    shutil.copy(journal, to)
    with contextlib.closing(sqlite3.connect(to)) as connection, connection:
        connection.execute(statement)
    return to


def test_damaged_rows_are_named_after_the_others_are_shown(
    journal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = change(journal, tmp_path / "bad.sqlite", "UPDATE pages SET time_s = 'x' WHERE sheet = 1")
    for command, shown in (
        (("show", 1), "The machine is too slow"),
        (("show", 1, "--json"), "the machine is too slow"),
        (("export", 1), "the machine is too slow"),
        (("export", 1, "--json"), "the machine is too slow"),
    ):
        code, out, err = call(capsys, "run", *command, "--journal", bad)
        assert code == 2
        assert shown in out
        assert "streak" not in out
        assert "the row of run 1, sheet 1 is damaged (time_s: input should be a valid number)" in err
        assert err.count("\n") == 1
    code, _, err = call(capsys, "run", "export", 1, "--journal", bad, "-o", tmp_path / "run.csv")
    assert (code, err.count("\n")) == (2, 1)
    assert len((tmp_path / "run.csv").read_text().splitlines()) == 1 + 4 + 1  # a fault has a line of its own
    bad = change(journal, tmp_path / "bad.sqlite", "UPDATE runs SET started_s = 'x' WHERE id = 1")
    code, out, err = call(capsys, "runs", "--journal", bad, "--json")
    assert code == 2
    assert [row["id"] for row in json.loads(out)] == [2]
    assert "the row of run 1 is damaged" in err


def test_of_many_damaged_rows_some_are_named(
    journal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "DAMAGED_SHOWN", 2)
    bad = change(journal, tmp_path / "bad.sqlite", "UPDATE pages SET time_s = 'x'")
    code, out, err = call(capsys, "run", "show", 1, "--all", "--journal", bad)
    assert code == 2
    assert "Every page was good" not in out
    assert err.count("is damaged") == 2
    assert "3 more rows cannot be read" in err


def test_what_a_row_says_does_nothing_to_a_terminal(
    journal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    odd = change(journal, tmp_path / "[x].sqlite", "UPDATE runs SET job = '\x1b[31m[/x]\n' || x'07'")
    for command in (("runs",), ("run", "show", "1")):
        code, out, _ = call(capsys, *command, "--journal", odd)
        assert code == 0
        assert not {"\x1b", "\x07"} & set(out)
        assert "\\x1b[31m[/x]\\n" in out


@pytest.mark.parametrize("option", ["--days", "--megabytes"])
@pytest.mark.parametrize("value", ["nan", "inf", "1e300", "1e308", "-1", "0", "-inf"])
def test_any_number_may_be_given_to_tidying(
    journal: Path, tmp_path: Path, option: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = shutil.copy(journal, tmp_path / "copy.sqlite")
    code, _, err = call(capsys, "run", "tidy", option, value, "--journal", copy)
    assert code == (0 if value in ("inf", "1e300", "1e308") else 2)
    assert "Traceback" not in err
    with Journal.open(str(copy), read_only=True) as opened:
        assert len(opened.runs()) == 2


def test_tidying_says_what_stayed_and_what_was_put_aside(
    journal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = change(journal, tmp_path / "copy.sqlite", "UPDATE packs SET file = '../out/x'")
    evidence = shutil.copytree(f"{journal}.evidence", f"{copy}.evidence")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "x").write_text("mine")
    size = sum(file.stat().st_size for file in Path(evidence).rglob("*.npz"))
    code, out, err = call(capsys, "run", "tidy", "--days", 1, "--journal", copy, "--json")
    assert code == 2
    told = json.loads(out)
    assert (told["removed_runs"], told["removed_evidence"], told["runs"]) == ([1], 0, 1)
    assert told["put_aside"] == 1
    assert told["put_aside_megabytes"] == pytest.approx(size / 1e6, abs=1e-3)
    assert told["put_aside_in"] == f"{copy}.unclaimed"
    assert "'../out/x' is not the name of a pack of run 1" in told["refused"][0]
    assert err.count("\n") == 2
    assert "1 file (" in err
    assert "evidence 1 stays" in err
    assert (tmp_path / "out" / "x").read_text() == "mine"


def test_tidying_says_what_went(journal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = tmp_path / "copy.sqlite"
    copy.write_bytes(journal.read_bytes())
    code, out, _ = call(capsys, "run", "tidy", "--days", 1, "--journal", copy, "--json")
    assert code == 0
    told = json.loads(out)
    assert (told["removed_runs"], told["runs"]) == ([1], 1)
    assert told["megabytes"] > 0
    assert (told["removed_evidence"], told["refused"], told["put_aside"]) == (
        0,
        [],
        0,
    )  # only rows were copied
