"""`prooflight queue`, and `watch` that takes its jobs from there."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.cli.calls import call
from tests.stand_ins import SHARED

from prooflight.pages.files import write_tiff
from prooflight.pages.raster import Page
from prooflight.simulation import ring
from prooflight_line.job_queue.examining import examine
from prooflight_line.job_queue.hot_folder import HotFolder

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.press.artefact import Press

CASES = {
    "pdf_cases/01a_alpha_in_nonisolated_group.pdf": "",
    "pdf_cases/03b_truncated_jpeg_is_black.pdf": "p0001: page 1: image I (object 5)",
    "data/pages/d003.pdf": "",
}
"""How the reason begins for which a file is rejected; empty: it is queued."""


@pytest.fixture(autouse=True)
def _few_prints(monkeypatch: pytest.MonkeyPatch) -> None:
    """The drum plays three prints over and over: too few to start processes for."""
    monkeypatch.setattr(ring, "LEAST_PRINTS", 3)


def page(path: Path, *, height_mm: float = 30.0) -> Path:
    """A job of one page of 36 mm, as wide as the small press sees."""
    cmyk = np.zeros((round(height_mm / 25.4 * 500), 708, 4), np.uint8)
    cmyk[60:300:40, 60:600, 3] = 255
    write_tiff(Page(cmyk=cmyk, dpi=500.0, name="p0001", number=1), path)
    return path


def stages(folder: Path) -> dict[str, str]:
    return {
        entry.file.name: entry.stage for entry in HotFolder.open(folder).entries("queued", "done", "rejected")
    }


def test_jobs_are_taken_in_prepared_and_listed(
    tmp_path: Path, press_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page(tmp_path / "a.tif")
    shutil.copy(tmp_path / "a.tif", tmp_path / "b.tif")
    (tmp_path / "notes\x1b.txt").write_text("no job")
    (tmp_path / "cut.tif").write_bytes((tmp_path / "a.tif").read_bytes()[:5000])
    (tmp_path / "c.tif.part").write_bytes(b"half")
    code, out, err = call(capsys, "queue", "fill", tmp_path, "--press", press_file, "--settle", 0.1, "--once")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert (
        "queued 1 a.tif: 1 page, 0 warnings, nothing can be stored for this press: each run prepares the job"
        in lines
    )
    assert any(line.startswith("rejected 2 b.tif: the same content is queued as 000001-") for line in lines)
    assert stages(tmp_path) == {
        "a.tif": "queued", "b.tif": "rejected", "cut.tif": "rejected", "notes\x1b.txt": "rejected"
    }  # fmt: skip
    assert (tmp_path / "c.tif.part").is_file()
    code, out, _ = call(capsys, "queue", "list", tmp_path, "--json")
    rows = json.loads(out)
    assert (rows[0]["number"], rows[0]["stage"]) == (1, "queued")
    assert all(row["reason"] for row in rows[1:])
    code, out, _ = call(capsys, "queue", "list", tmp_path)
    assert "notes\\x1b.txt" in out


def test_the_log_for_programs_names_each_job(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page(tmp_path / "a.tif")
    (tmp_path / "notes.txt").write_text("no job")
    options = ("--settle", 0.1, "--once", "--log", "json")
    code, out, log = call(capsys, "queue", "fill", tmp_path, *options)
    assert (code, out) == (0, "")
    rows = {row["job"]: row for row in map(json.loads, log.splitlines())}
    assert {row["event"] for row in rows.values()} == {"job"}
    assert [(rows[name]["stage"], rows[name]["level"]) for name in ("a.tif", "notes.txt")] == [
        ("queued", "info"),
        ("rejected", "warning"),
    ]
    assert rows["notes.txt"]["reason"]


def test_a_page_that_does_not_fit_the_press_is_rejected(
    tmp_path: Path, press_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wide = np.zeros((1000, 1000, 4), np.uint8)
    write_tiff(Page(cmyk=wide, dpi=500.0, name="p0001", number=1), tmp_path / "wide.tif")
    call(capsys, "queue", "fill", tmp_path, "--press", press_file, "--settle", 0.1, "--once")
    (entry,) = HotFolder.open(tmp_path).entries("rejected")
    assert entry.reason.startswith("p0001: ")
    assert "mm" in entry.reason


@pytest.mark.skipif(not SHARED.is_dir(), reason="there is no folder of shared cases")
def test_real_files_are_queued_as_they_are_and_rejected_cut(tmp_path: Path) -> None:
    for name, refused in CASES.items():
        if not (SHARED / name).is_file():
            pytest.skip(f"{name} is not there")
        whole = examine(SHARED / name, processes=1)
        assert whole.pages == 1
        assert whole.refused.startswith(refused)
        assert bool(whole.refused) is bool(refused)
        cut = tmp_path / "cut.pdf"
        cut.write_bytes((SHARED / name).read_bytes()[: (SHARED / name).stat().st_size // 2])
        assert examine(cut, processes=1).refused


def test_watch_takes_the_next_job_and_puts_it_where_it_belongs(
    tmp_path: Path, press: Press, press_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page(tmp_path / "first.tif")
    page(tmp_path / "second.tif", height_mm=31.0)
    call(capsys, "queue", "fill", tmp_path, "--settle", 0.1, "--once")
    trigger = press.geometry.lines(round(30.0 / 25.4 * 500) / 500 * 25.4)
    given = ("--queue", "--press", press_file, "--journal", "none", "--json")
    code, _, err = call(capsys, "watch", tmp_path, *given, "--source", f"raw:{tmp_path / 'no-lines'}")
    assert code == 2
    assert stages(tmp_path) == {"first.tif": "queued", "second.tif": "queued"}
    code, _, err = call(
        capsys,
        "watch",
        tmp_path,
        *given,
        "--source",
        "drum",
        "--sheets",
        2,
        "--trigger",
        trigger,
        "--world",
        "ideal",
    )
    assert code == 0, err
    assert stages(tmp_path) == {"first.tif": "done", "second.tif": "queued"}
    ticket = (
        '<XJDF xmlns="http://www.CIP4.org/JDFSchema_2_0" JobID="J-17" Types="Product">'
        '<GeneralID IDUsage="prooflight:layout" IDValue="pages-a-set=1"/>'
        '<ProductList><Product Amount="3"/></ProductList></XJDF>'
    )
    (tmp_path / "second.xjdf").write_text(ticket)
    call(capsys, "queue", "fill", tmp_path, "--settle", 0.1, "--once")
    code, out, err = call(capsys, "queue", "list", tmp_path, "--json")
    rows = {row["job"]: row for row in json.loads(out)}
    assert rows["second.tif"]["ticket"] == {"job_id": "J-17", "copies": 3, "layout": "pages-a-set=1"}
    code, out, _ = call(capsys, "queue", "list", tmp_path)
    assert "J-17, 3 copies" in " ".join(out.split())
    trigger = press.geometry.lines(round(31.0 / 25.4 * 500) / 500 * 25.4)
    run = ("--source", "drum", "--trigger", trigger, "--world", "ideal")
    code, out, err = call(capsys, "watch", tmp_path, *given, *run)
    assert code == 0, err
    sets = [json.loads(line) for line in out.splitlines() if "set_verdict" in line]
    assert [one["set_verdict"]["verdict"] for one in sets] == ["good"] * 3
    assert stages(tmp_path) == {"first.tif": "done", "second.tif": "done"}
    page(tmp_path / "third.tif", height_mm=32.0)
    call(capsys, "queue", "fill", tmp_path, "--settle", 0.1, "--once")
    HotFolder.open(tmp_path).entries("queued")[0].file.unlink()
    code, _, err = call(capsys, "watch", tmp_path, *given, "--source", "drum")
    assert code == 2
    assert "has no job in it; put the file back" in err
