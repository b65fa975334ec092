"""`prooflight job check`, and where the warnings of a job are told: before the first sheet, and kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

from PIL import Image
from tests.cli.calls import call
from tests.cli.warning_jobs import PAGE, TEXT, rows_of, two_pages
from tests.pages.conftest import one_page

if TYPE_CHECKING:
    from pathlib import Path


TURNED = PAGE + "/Rotate 45"


def test_a_job_without_a_warning_ends_well_and_each_page_is_a_row(
    tmp_path: Path, press_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = two_pages(tmp_path / "job.pdf")
    code, out, _ = call(capsys, "job", "check", job, "--press", press_file, "--json")
    assert code == 0
    rows = rows_of(out)
    assert [row["page"] for row in rows] == ["p0001", "p0002"]
    assert rows[0]["box"] == "MediaBox"
    assert rows[0]["width_mm"] == pytest.approx(36, abs=0.1)
    assert rows[0]["coverage_percent"]["black"] == pytest.approx(100 * 2400 / 8670, abs=1)
    assert (rows[0]["warnings"], rows[0]["refused"]) == ([], "")
    code, out, _ = call(capsys, "job", "check", job, "--press", press_file, "--pages", "2")
    assert code == 0
    assert "1 page, 0 warnings" in out
    assert "p0002" in out


def test_a_warning_ends_with_1(
    tmp_path: Path, warning_press: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = two_pages(tmp_path / "job.pdf")
    code, out, _ = call(capsys, "job", "check", job, "--press", warning_press, "--json")
    assert code == 1
    first, second = rows_of(out)
    assert first["warnings"] == []
    assert [one["kind"] for one in second["warnings"]] == ["rip-message"]
    assert second["warnings"][0]["page"] == 2


def test_a_page_that_cannot_be_used_ends_with_3_and_a_job_that_cannot_with_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "job"
    folder.mkdir()
    (folder / "a.pdf").write_bytes(one_page(TEXT, page=PAGE))
    (folder / "b.pdf").write_bytes(one_page(TEXT, page=TURNED))
    code, out, said = call(capsys, "job", "check", folder)
    assert code == 3
    assert "2 pages, 0 warnings, 1 cannot be used" in out
    assert "p0002 cannot be used and would not be inspected: " in said
    (folder / "b.pdf").write_bytes(b"no PDF")
    code, out, said = call(capsys, "job", "check", folder)
    assert (code, out) == (2, "")
    assert len(said.splitlines()) == 1


def test_pictures_of_the_pages_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    job = two_pages(tmp_path / "job.pdf")
    code, _, _ = call(capsys, "job", "check", job, "--pictures", tmp_path / "pictures")
    assert code == 0
    with Image.open(tmp_path / "pictures" / "p0002.png") as picture:
        middle, corner = picture.getpixel((picture.width // 2, picture.height // 2)), picture.getpixel((0, 0))
    assert max(middle) < 80
    assert corner == (255, 255, 255)


def test_inspect_tells_warnings_before_the_first_page_and_in_its_report(
    tmp_path: Path, warning_press: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job, scans = two_pages(tmp_path / "job.pdf"), tmp_path / "scans"
    on_press = ("--press", warning_press)
    assert call(capsys, "simulate", job, *on_press, "-o", scans)[0] == 0
    code, out, _ = call(capsys, "inspect", job, scans, *on_press, "--json")
    assert code == 0
    rows = rows_of(out)
    assert ["warning" in row for row in rows] == [True, False, False]
    assert "toner is low" in rows[0]["warning"]["message"]
    code, _, said = call(capsys, "inspect", job, scans, *on_press, "--report", tmp_path / "out")
    assert code == 0
    assert said.count("prooflight: warning: p0002: ") == 1
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "1 warning of the job" in report
    assert "toner is low" in report
