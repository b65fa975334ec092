"""Commands as a user calls them: output, exit codes, one line for bad input."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from tests.cli.calls import call

from prooflight.cli import run
from prooflight.cli.show import PlainConsole, verdict_table
from prooflight.detectors.verdict import Verdict
from prooflight.pages.files import write_tiff
from prooflight.pages.raster import Page
from prooflight.press.press_file import PressFile

PIXELS = 400  # 42 mm of paper


@pytest.fixture(scope="module")
def press(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("press")
    text = PressFile.prototype().text.replace("pixels = 2048 ", f"pixels = {PIXELS} ")
    (folder / "small.toml").write_text(text)
    assert (
        run(
            [
                "press",
                "build",
                str(folder / "small.toml"),
                "-o",
                str(folder / "small.press"),
                "--detector",
                "none",
            ]
        )
        == 0
    )
    return folder / "small.press"


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three pages of 36 x 50 mm: lines of black bars, a cyan tint, a magenta block."""
    folder = tmp_path_factory.mktemp("job")
    rng = np.random.default_rng(7)
    for number in range(1, 4):
        cmyk = np.zeros((984, 708, 4), np.uint8)  # 500 dpi
        for line in range(60, 900, 40):
            for word in range(60, 640, 90):
                cmyk[line : line + 20, word : word + int(rng.integers(20, 80)), 3] = 255
        cmyk[100:400, 400:600, number % 3] = 40 * number
        page = Page(cmyk=cmyk, dpi=500.0, name=f"p{number:04d}", number=number)
        write_tiff(page, folder / f"{page.name}.tif")
    return folder


def test_press_build_reports_digest_and_table_accuracy(
    press: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, out, _ = call(
        capsys,
        "press",
        "build",
        press.with_suffix(".toml"),
        "-o",
        tmp_path / "x.press",
        "--detector",
        "none",
        "--json",
    )
    answer = json.loads(out)
    assert code == 0
    assert set(answer) == {"press", "digest", "seconds", "detectors", "tables", "rip"}
    assert answer["rip"]["engine"] == "mupdf"
    assert answer["rip"]["differs"] == []
    assert answer["tables"][0]["white_sigma"] <= 0.03


def test_press_show_names_what_is_inside(press: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = call(capsys, "press", "show", press, "--json")
    facts = json.loads(out)
    assert code == 0
    assert facts["name"] == "small"
    assert facts["pixels_a_line"] == PIXELS
    assert facts["alpha"] == pytest.approx(0.101, abs=5e-4)


def test_good_scans_pass_with_exit_code_0(
    press: Path, job: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, out, _ = call(capsys, "simulate", job, "--press", press, "-o", tmp_path, "--seed", 3, "--json")
    truths = json.loads(out)
    assert code == 0
    assert [truth["misprint"] for truth in truths] == [None] * 3
    assert json.loads((tmp_path / "truth.json").read_text())["world"] == "ideal"
    scan = tifffile.imread(truths[0]["file"])
    assert scan.dtype == np.uint16
    assert scan.shape[-1] == PIXELS
    code, out, _ = call(capsys, "inspect", job, tmp_path, "--press", press, "--json")
    verdicts = [json.loads(line) for line in out.splitlines()]
    assert code == 0
    assert [verdict["page"] for verdict in verdicts] == ["p0001", "p0002", "p0003"]
    assert all(verdict["verdict"] == "good" and verdict["disposition"] == "accept" for verdict in verdicts)


@pytest.mark.parametrize("kind", ["missing-plane", "streak", "missing-content", "wrong-page"])
def test_misprints_end_with_exit_code_1_and_a_place(
    kind: str, press: Path, job: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ("simulate", job, "--press", press, "-o", tmp_path, "--misprint", f"{kind}:0.9", "--json")
    code, out, _ = call(capsys, *arguments)
    assert code == 0
    assert {truth["misprint"]["kind"] for truth in json.loads(out)} == {kind}
    code, out, _ = call(capsys, "inspect", job, tmp_path, "--press", press, "--json")
    verdicts = [json.loads(line) for line in out.splitlines()]
    assert code == 1
    assert [verdict["verdict"] for verdict in verdicts] == ["misprint"] * 3
    keys = {
        "page",
        "verdict",
        "disposition",
        "decided_by",
        "probability",
        "score",
        "threshold",
        "p_value",
        "kind",
        "regions",
    }
    more = {"shift_mm", "milliseconds", "detector", "family", "reason", "inks", "expected_cost"}
    more |= {"stopping_costs_more", "widened", "codes", "promise_suspended"}
    assert keys | more == set(verdicts[0])
    place = {"x_mm", "y_mm", "width_mm", "height_mm", "score", "kind"}
    assert set(verdicts[0]["regions"][0]) == place | {"ink", "darker_percent", "above_good_sd"}


def test_pages_without_scan_are_said_to_be_not_inspected(
    press: Path, job: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    call(capsys, "simulate", job, "--press", press, "-o", tmp_path, "--pages", "2", "--json")
    code, out, err = call(
        capsys, "inspect", job, tmp_path, "--press", press, "--json", "--report", tmp_path / "r"
    )
    assert code == 3
    rows = [json.loads(line) for line in out.splitlines()]
    assert [row["verdict"] for row in rows] == ["not-inspected", "good", "not-inspected"]
    assert rows[2]["reason"] == f"the scan is missing (looked for p0003.tif in {tmp_path})"
    assert err.startswith("prooflight: 2 of 3 pages were not inspected (the first p0001: the scan is missing")
    assert err.count("\n") == 1
    assert (tmp_path / "r" / "report.html").is_file()


def test_simulation_does_not_depend_on_which_other_pages_run(
    press: Path, job: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    call(capsys, "simulate", job, "--press", press, "-o", tmp_path / "all", "--json")
    call(capsys, "simulate", job, "--press", press, "-o", tmp_path / "one", "--pages", "3", "--json")
    assert (tmp_path / "all" / "p0003.tif").read_bytes() == (tmp_path / "one" / "p0003.tif").read_bytes()


def test_rip_writes_what_was_there(job: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, out, _ = call(capsys, "rip", job, "--dpi", 300, "-o", tmp_path, "--json")
    rows: list[dict[str, Any]] = json.loads(out)
    assert code == 0
    assert [row["page"] for row in rows] == ["p0001", "p0002", "p0003"]
    assert (tifffile.imread(rows[1]["file"]) == tifffile.imread(job / "p0002.tif")).all()


def test_a_person_reads_tables(
    press: Path, job: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert call(capsys, "simulate", job, "--press", press, "-o", tmp_path)[0] == 0
    code, out, _ = call(capsys, "inspect", job, tmp_path, "--press", press)
    assert code == 0
    assert "3 pages, 0 misprints" in out
    assert "good" in out
    shown = call(capsys, "press", "show", press)[1]
    assert "alpha" in shown
    assert "as in the press world" in shown


def bad_calls(press: Path, job: Path, folder: Path) -> dict[str, tuple[list[object], str]]:
    (folder / "no.press").write_bytes(b"nonsense")
    (folder / "bad.toml").write_text(press.with_suffix(".toml").read_text().replace("f_number", "f_numbr"))
    (folder / "empty").mkdir()
    tifffile.imwrite(folder / "narrow.tif", np.zeros((600, 100), np.uint16))
    tifffile.imwrite(folder / "short.tif", np.zeros((100, PIXELS), np.uint16))
    out = folder / "out"
    return {
        "missing artefact": (["press", "show", folder / "none.press"], "none.press"),
        "damaged artefact": (["press", "show", folder / "no.press"], "no.press"),
        "misspelt field": (["press", "build", folder / "bad.toml", "-o", out], "f_number"),
        "missing press file": (["press", "build", folder / "none.toml", "-o", out], "none.toml"),
        "no such teaching": (
            ["press", "build", press.with_suffix(".toml"), "-o", out, "--detector", "some"],
            "none, quick, full",
        ),
        "too few designs": (
            ["press", "build", press.with_suffix(".toml"), "-o", out, "--designs", "3"],
            "24 or more",
        ),
        "not said to be good": (["press", "learn", press, job, job], "--good"),
        "learn untaught": (["press", "learn", press, job, job, "--good"], "press build --detector"),
        "inspect untaught": (
            ["inspect", job, job, "--press", press, "--detector", "matched_filter"],
            "was not trained for",
        ),
        "no scans": (["inspect", job, folder / "empty", "--press", press], "empty"),
        "narrow scan": (["inspect", job, folder / "narrow.tif", "--press", press], "100 pixels"),
        "short scan": (["inspect", job, folder / "short.tif", "--press", press], "100 lines"),
        "no such page": (["simulate", job, "--press", press, "-o", out, "--pages", "9"], "1 to 3"),
        "no such kind": (["simulate", job, "--press", press, "-o", out, "--misprint", "smudge"], "streak"),
        "no such severity": (
            ["simulate", job, "--press", press, "-o", out, "--misprint", "streak:2"],
            "severity",
        ),
        "no such world": (["simulate", job, "--press", press, "-o", out, "--world", "mars"], "ideal"),
        "no such detector": (
            ["inspect", job, job, "--press", press, "--detector", "crystal-ball"],
            "chi-square",
        ),
        "no such job": (["simulate", folder / "none.pdf", "--press", press, "-o", out], "none.pdf"),
        "unknown command": (["prnt"], "prnt"),
    }


@pytest.mark.parametrize(
    "case",
    [
        "missing artefact",
        "damaged artefact",
        "misspelt field",
        "missing press file",
        "no such teaching",
        "too few designs",
        "not said to be good",
        "learn untaught",
        "inspect untaught",
        "no scans",
        "narrow scan",
        "short scan",
        "no such page",
        "no such kind",
        "no such severity",
        "no such world",
        "no such detector",
        "no such job",
        "unknown command",
    ],
)
def test_bad_input_is_exit_code_2_and_one_line(
    case: str, press: Path, job: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments, names = bad_calls(press, job, tmp_path)[case]
    code, out, err = call(capsys, *arguments)
    assert code == 2
    assert names in err
    assert out == ""
    assert "Traceback" not in err
    if case != "unknown command":
        assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("columns", ["80", None])
def test_a_table_loses_nothing_in_a_narrow_window_or_in_a_file(
    columns: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if columns is None:
        monkeypatch.delenv("COLUMNS", raising=False)
    else:
        monkeypatch.setenv("COLUMNS", columns)
    written = io.StringIO()
    console = PlainConsole()
    console.file = written
    reason = "A-word-that-is-longer-than-any-column-of-80-could-ever-be-beside-six-others-" * 2
    verdict = Verdict(page="p0001", verdict="not-inspected", reason=reason, score=12345.6)
    console.print(verdict_table([verdict], title="job on press"))
    shown = written.getvalue()
    assert "…" not in shown
    cells = [line.split("│") for line in shown.splitlines() if line.startswith("│")]
    assert "".join(cell[4].strip() for cell in cells) == reason
    assert max(map(len, shown.splitlines())) <= (80 if columns else 200)
