"""`prooflight inspect` where a page, a scan or all of it fails: what was made is shown, the rest is named."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.cli.strange import StrangeFrom
from tests.cli.word_jobs import write_word_job

from prooflight.cli import run
from prooflight.inspection.guarantee import GuaranteeMonitor
from prooflight.inspection.job import InspectPage
from prooflight.pages.raster import Page

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.press.artefact import Press

PAGES = 6
TORN_PAGE, TORN_SCAN, NO_SCAN, NO_TIFF = 2, 3, 5, 6


@pytest.fixture(scope="module")
def made(press: Press, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``x.press``; ``job``, six pages of 36 x 30 mm; ``scans`` of them, page 1 and 4 good ones."""
    folder, rng = tmp_path_factory.mktemp("inspected"), np.random.default_rng(12)
    press.save(folder / "x.press")
    write_word_job(folder / "job", pages=PAGES, rng=rng, tinted=False)
    made = ["simulate", str(folder / "job"), "--press", str(folder / "x.press"), "-o", str(folder / "scans")]
    assert run([*made, "--seed", "3", "--json"]) == 0
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    """The same, each part damaged in a way of its own."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    for path in (tmp_path / "job" / f"p{TORN_PAGE:04d}.tif", tmp_path / "scans" / f"p{TORN_SCAN:04d}.tif"):
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    (tmp_path / "scans" / f"p{NO_SCAN:04d}.tif").unlink()
    (tmp_path / "scans" / f"p{NO_TIFF:04d}.tif").write_bytes(b"no TIFF")
    return tmp_path


@pytest.fixture
def inspect(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, list[dict[str, Any]], str]]:
    def call(*given: object) -> tuple[int, list[dict[str, Any]], str]:
        capsys.readouterr()
        try:
            code = run(["inspect", *(str(one) for one in given), "--json"])
        except RuntimeError:  # a defect of our own, where nobody above catches it
            code = 4
        captured = capsys.readouterr()
        return code, [json.loads(line) for line in captured.out.splitlines()], captured.err

    return call


WORDS = ["good", "not-inspected", "not-inspected", "good", "not-inspected", "not-inspected"]


def reasons(rows: list[dict[str, Any]], folder: Path) -> None:
    """Every reason names its file."""
    of_page = {int(row["page"][1:]): row["reason"] for row in rows}
    assert str(folder / "job" / "p0002.tif") in of_page[TORN_PAGE]
    assert "truncated" in of_page[TORN_PAGE]
    assert str(folder / "scans" / "p0003.tif") in of_page[TORN_SCAN]
    assert of_page[NO_SCAN] == f"the scan is missing (looked for p0005.tif in {folder / 'scans'})"
    assert str(folder / "scans" / "p0006.tif") in of_page[NO_TIFF]


def test_what_cannot_be_used_costs_its_own_page_alone(
    folder: Path,
    inspect: Callable[..., tuple[int, list[dict[str, Any]], str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Six pages are enough for worker processes."""
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    code, rows, said = inspect(folder / "job", folder / "scans", "--press", folder / "x.press")
    assert code == 3
    assert [row["verdict"] for row in rows] == WORDS
    reasons(rows, folder)
    assert said.startswith("prooflight: 4 of 6 pages were not inspected (the first p0002: ")
    assert said.count("\n") == 1


def test_the_report_shows_all_pages_and_why_some_were_not_inspected(
    folder: Path, inspect: Callable[..., tuple[int, list[dict[str, Any]], str]]
) -> None:
    code, rows, _ = inspect(
        folder / "job", folder / "scans", "--press", folder / "x.press", "--report", folder / "report"
    )
    assert code == 3
    assert [row["verdict"] for row in rows] == WORDS
    page = (folder / "report" / "report.html").read_text()
    assert (
        "2 pages inspected: 2 passed as good, no misprint found; 1 more page had no scan and is held" in page
    )
    assert "3 more pages could not be inspected and are held" in page
    for row in rows:
        assert row["reason"] in page
    assert page.count("<img") == PAGES - 1  # nobody knows what the torn page would look like


def test_with_a_golden_scan_as_well(
    folder: Path, made: Path, inspect: Callable[..., tuple[int, list[dict[str, Any]], str]]
) -> None:
    goldens = folder / "goldens"
    shutil.copytree(made / "scans", goldens)
    golden = goldens / "p0001.tif"
    golden.write_bytes(golden.read_bytes()[: golden.stat().st_size // 2])
    code, rows, said = inspect(
        folder / "job", folder / "scans", "--press", folder / "x.press", "--golden", goldens
    )
    assert code == 3
    assert [row["verdict"] for row in rows] == ["not-inspected", *WORDS[1:]]
    assert str(golden) in rows[0]["reason"]
    reasons(rows, folder)
    assert "5 of 6 pages" in said


def test_where_nothing_can_be_used_the_input_is_unusable(
    folder: Path, inspect: Callable[..., tuple[int, list[dict[str, Any]], str]]
) -> None:
    for number in (1, 4):
        (folder / "scans" / f"p{number:04d}.tif").unlink()
    code, rows, said = inspect(folder / "job", folder / "scans", "--press", folder / "x.press")
    assert (code, rows) == (2, [])
    assert "p0002.tif" in said  # not that the first page has no scan
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "code", "names"),
    [(KeyboardInterrupt(), 3, "was stopped before this page"), (RuntimeError("odd"), 4, "RuntimeError")],
)
def test_verdicts_already_made_are_shown_whatever_ends_the_inspection(
    error: BaseException,
    code: int,
    names: str,
    made: Path,
    inspect: Callable[..., tuple[int, list[dict[str, Any]], str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    analysed_modes = InspectPage.__call__

    def ended(self: InspectPage, pair: Any) -> Any:
        if pair[0] == 3:
            raise error
        return analysed_modes(self, pair)

    monkeypatch.setattr(InspectPage, "__call__", ended)
    found, rows, _ = inspect(made / "job", made / "scans", "--press", made / "x.press")
    assert found == code
    assert [row["verdict"] for row in rows] == ["good", "good", *["not-inspected"] * 4]
    assert all(names in row["reason"] for row in rows[2:])


@pytest.mark.parametrize("report", [False, True])
def test_a_job_whose_pages_are_not_like_the_presss_own_says_so(
    report: bool,
    folder: Path,
    inspect: Callable[..., tuple[int, list[dict[str, Any]], str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Pages 1 and 4 are inspected; nobody looked at those between, and they add nothing."""
    monkeypatch.setattr(
        GuaranteeMonitor, "of", lambda _detector, seed=0: GuaranteeMonitor(test=StrangeFrom(2))
    )
    inspected = InspectPage.inspection

    def summed(self: InspectPage, page: Page, scan: Any) -> Any:
        return replace(inspected(self, page, scan), summary=np.zeros(1))

    monkeypatch.setattr(InspectPage, "inspection", summed)
    more = ["--report", folder / "report"] if report else []
    code, rows, said = inspect(folder / "job", folder / "scans", "--press", folder / "x.press", *more)
    assert code == 3
    assert [row["verdict"] for row in rows] == WORDS
    assert [row["promise_suspended"] for row in rows] == [False] * 3 + [True] * 3
    why = "the promised false-alarm rate does not hold"
    assert said.count(why) == 1
    if report:
        page = (folder / "report" / "report.html").read_text()
        assert why in page
        assert page.count(", promise suspended") == 3


def test_a_job_like_the_presss_own_says_nothing_of_its_promise(
    made: Path, inspect: Callable[..., tuple[int, list[dict[str, Any]], str]], tmp_path: Path
) -> None:
    code, rows, said = inspect(
        made / "job", made / "scans", "--press", made / "x.press", "--report", tmp_path / "report"
    )
    assert (code, said) == (0, "")
    assert {row["promise_suspended"] for row in rows} == {False}
    assert "uspended" not in (tmp_path / "report" / "report.html").read_text()


def test_people_read_how_many_were_not_inspected(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        run(["inspect", str(folder / "job"), str(folder / "scans"), "--press", str(folder / "x.press")]) == 3
    )
    assert "6 pages, 0 misprints, 4 not inspected" in capsys.readouterr().out
