"""Sheets with two sides and two pages a side, as a user prints, watches and inspects them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prooflight.cli import run
from prooflight.pages.files import write_tiff
from prooflight.pages.raster import Page
from prooflight.simulation import ring
from prooflight_line.journal.journal import Journal

DPI = 500.0
PAGE_MM = (17.0, 30.0)
LAYOUT = "sides=2,n-up=2x1,gutter=2,pages-a-set=8"


@pytest.fixture(autouse=True)
def _few_prints(monkeypatch: pytest.MonkeyPatch) -> None:
    """The drum plays the job's four sides over and over: too few to start processes for."""
    monkeypatch.setattr(ring, "LEAST_PRINTS", 4)


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight pages of 17 x 30 mm, no two alike."""
    folder, rng = tmp_path_factory.mktemp("job"), np.random.default_rng(7)
    columns, rows = (round(extent / 25.4 * DPI) for extent in PAGE_MM)
    for number in range(1, 9):
        cmyk = np.zeros((rows, columns, 4), np.uint8)
        for line in range(60, rows - 60, 40):
            for word in range(30, columns - 60, 90):
                cmyk[line : line + 20, word : word + int(rng.integers(20, 80)), 3] = 255
        top = 60 + 50 * number
        cmyk[top : top + 80, 60:260, number % 3] = 100 + 10 * number
        page = Page(cmyk=cmyk, dpi=DPI, name=f"p{number:04d}", number=number)
        write_tiff(page, folder / f"{page.name}.tif")
    return folder


def called(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, list[dict[str, Any]], str]:
    code = run([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    rows = [
        json.loads(line)
        for line in captured.out.splitlines()
        if line.startswith(("{", "[")) and '"phase": ' not in line
    ]
    return code, rows, captured.err + captured.out


def watched(
    capsys: pytest.CaptureFixture[str], press: Path, job: Path, layout: str, *more: object
) -> tuple[int, list[dict[str, Any]], str]:
    return called(
        capsys, "watch", job, "--press", press, "--source", "drum", "--world", "ideal", "--layout", layout,
        "--json", *more,
    )  # fmt: skip


@pytest.mark.parametrize("order", ["alternate", "batch:2", "loop:2"])
def test_a_bad_back_spoils_its_sheet_and_its_set_and_names_its_page(
    order: str, press_file: Path, job: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Two copies of two sheets; every fourth side of the job, the back of its second sheet, has a streak."""
    journal = tmp_path / "runs.sqlite"
    code, rows, _ = watched(
        capsys, press_file, job, f"{LAYOUT},order={order}",
        "--sheets", 4, "--misprint", "streak:0.9", "--every", 4, "--seed", 2, "--journal", journal,
    )  # fmt: skip
    assert code == 1
    sides = [row for row in rows if "job_page" in row]
    sheets = [row["sheet_verdict"] for row in rows if "sheet_verdict" in row]
    sets = [row["set_verdict"] for row in rows if "set_verdict" in row]
    assert sorted(row["page"] for row in sides) == sorted(
        ["s0001-front", "s0001-back", "s0002-front", "s0002-back"] * 2
    )
    assert [sheet["verdict"] for sheet in sheets] == ["good", "misprint"] * 2
    for sheet in sheets[1::2]:
        front, back = sheet["sides"]
        assert (front["verdict"], back["verdict"]) == ("good", "misprint")
        bad = [page["page"] for page in back["pages"] if page["verdict"] == "misprint"]
        assert len(bad) == 1
        assert bad[0] in (7, 8)
        assert sheet["bad_pages"] == bad
    assert [(one["verdict"], one["complete"], one["bad"]) for one in sets] == [
        ("misprint", True, [1]),
        ("misprint", True, [3]),
    ]
    with Journal.open(str(journal), read_only=True) as opened:
        (facts,) = opened.runs()
        assert (facts.state, facts.pages, facts.misprints) == ("finished", 8, 2)
    code, (said,), _ = called(capsys, "run", "show", "--journal", journal, "--sheets", "--json")
    assert code == 0
    assert said["sheets"] == json.loads(json.dumps(sheets))
    assert said["sets"] == json.loads(json.dumps(sets))
    _, _, said_to_people = called(capsys, "run", "show", "--journal", journal)
    assert "4 sheets, 2 good, 2 misprints; 2 sets, 0 good, 2 misprints" in said_to_people


def test_scans_of_such_a_job_are_simulated_and_inspected(
    press_file: Path, job: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    scans = tmp_path / "scans"
    told = ("--press", press_file, "--layout", f"{LAYOUT},backs=turned")
    code, (truths,), _ = called(capsys, "simulate", job, *told, "-o", scans, "--json")
    assert code == 0
    assert [truth["page"] for truth in truths] == ["s0001-front", "s0001-back", "s0002-front", "s0002-back"]
    assert sorted(path.name for path in scans.glob("*.tif"))[0] == "s0001-back.tif"
    code, rows, _ = called(capsys, "inspect", job, scans, *told, "--json")
    assert code == 0
    assert [row["sheet_verdict"]["verdict"] for row in rows if "sheet_verdict" in row] == ["good", "good"]
    assert [row["set_verdict"]["verdict"] for row in rows if "set_verdict" in row] == ["good"]
    # Backs that the press did not turn are other pages.
    code, rows, _ = called(capsys, "inspect", job, scans, "--press", press_file, "--layout", LAYOUT, "--json")
    assert code != 0
    (scans / "s0002-back.tif").unlink()
    code, rows, _ = called(capsys, "inspect", job, scans, *told, "--json")
    assert code == 3
    assert [row["sheet_verdict"]["verdict"] for row in rows if "sheet_verdict" in row] == [
        "good",
        "not-inspected",
    ]


def test_a_side_that_does_not_come_leaves_sheet_and_set_open(
    press_file: Path, job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Faults of the paper path in turn: blank, repeated, missing, out of order, ..."""
    code, rows, _ = watched(
        capsys, press_file, job, LAYOUT, "--sheets", 10, "--fault-every", 4, "--journal", "none"
    )
    assert code in (1, 3)
    sheets = [row["sheet_verdict"] for row in rows if "sheet_verdict" in row]
    sets = [row["set_verdict"] for row in rows if "set_verdict" in row]
    assert [sheet["sheet"] for sheet in sheets] == list(range(10))
    assert {sheet["verdict"] for sheet in sheets} >= {"good", "not-inspected"}
    assert any(one["doubled"] for one in sets)
    assert any(not one["complete"] for one in sets)


@pytest.fixture(scope="module")
def five_pages(job: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first five of the eight: of the second sheet half the front and the whole back stay blank."""
    folder = tmp_path_factory.mktemp("five")
    for number in range(1, 6):
        (folder / f"p{number:04d}.tif").symlink_to(job / f"p{number:04d}.tif")
    return folder


@pytest.mark.parametrize("backs", ["upright", "turned"])
def test_what_the_pages_leave_of_the_last_sheet_is_expected_to_be_blank(
    backs: str,
    press_file: Path,
    five_pages: Path,
    job: Path,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    scans, told = tmp_path / "scans", ("--press", press_file, "--layout", f"{LAYOUT},backs={backs}")
    code, _, said = called(capsys, "simulate", five_pages, *told, "-o", scans, "--json")
    assert code == 0
    assert "the last of the job's 2 sheets has 4 places, of which 3 must stay blank" in said
    code, rows, _ = called(capsys, "inspect", five_pages, scans, *told, "--json")
    assert code == 0
    sheets = [row["sheet_verdict"] for row in rows if "sheet_verdict" in row]
    assert [sheet["verdict"] for sheet in sheets] == ["good", "good"]
    assert [[page["page"] for page in side["pages"]] for side in sheets[1]["sides"]] == [[5], []]
    assert [row["set_verdict"]["verdict"] for row in rows if "set_verdict" in row] == ["good"]
    # A sheet that shows three pages more is none of this job.
    full = tmp_path / "full"
    called(capsys, "simulate", job, *told, "-o", full, "--json")
    report = tmp_path / "report"
    code, rows, _ = called(capsys, "inspect", five_pages, full, *told, "--json", "--report", report)
    assert code != 0
    assert '<tr id="of-sheet1"' in (report / "report.html").read_text(encoding="utf-8")
    sheets = [row["sheet_verdict"] for row in rows if "sheet_verdict" in row]
    assert [sheet["verdict"] == "good" for sheet in sheets] == [True, False]
    assert all(side["verdict"] != "good" for side in sheets[1]["sides"])


def test_a_blank_back_passes_in_a_run_and_ink_on_it_spoils_the_sheet_and_no_page(
    press_file: Path, five_pages: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Three copies of two sheets; every fourth side, the blank back, has scum."""
    told = ("--sheets", 6, "--seed", 2, "--journal", tmp_path / "runs.sqlite")
    code, rows, _ = watched(capsys, press_file, five_pages, LAYOUT, *told)
    sheets = [row["sheet_verdict"] for row in rows if "sheet_verdict" in row]
    assert code == 0
    assert [sheet["verdict"] for sheet in sheets] == ["good"] * 6
    assert sum("set_verdict" in row for row in rows) == 3
    code, rows, _ = watched(
        capsys, press_file, five_pages, LAYOUT, *told, "--misprint", "scum:1", "--every", 4
    )
    assert code == 1
    sheets = [row["sheet_verdict"] for row in rows if "sheet_verdict" in row]
    assert [sheet["verdict"] for sheet in sheets] == ["good", "misprint"] * 3
    assert [sheet["bad_pages"] for sheet in sheets] == [[]] * 6


@pytest.mark.parametrize(
    ("layout", "said"),
    [
        ("sides=2,pages-a-set=6", "the 8 pages of the job fill 4 sheets, and a set takes 3 sheets"),
        ("sides=2,n-up=2x1,sheet=30x40", "2 x 1 pages need 34.0 x 30.0 mm, and the sheet has 30 x 40 mm"),
        ("sides=2,n-up=2x1,pages-a-set=6", "a set takes 6 pages, and a sheet 4"),
        ("duplex", "'duplex' is none of sides, order"),
        ("n-up=4x4,repeat=yes", "a side is 68.1 x 120.1 mm, and this press sees 42.2 mm across"),
    ],
)
def test_what_cannot_be_laid_out_is_refused_in_one_line(
    layout: str, said: str, press_file: Path, job: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    journal = tmp_path / "runs.sqlite"
    code, _, told = watched(capsys, press_file, job, layout, "--journal", journal)
    assert code == 2
    assert said in told
    assert len([line for line in told.splitlines() if not line.startswith('{"phase": ')]) == 1
    assert not journal.exists()
