"""What the command line says when something goes wrong: one line, an exit code of its own, never "misprint"."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from prooflight import cli
from prooflight.cli import exit_codes, run, show
from prooflight.pages.files import write_tiff
from prooflight.pages.raster import Page


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "prooflight" / "prooflight-faults.log"


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """A program whose `rip` meets what nobody expected."""

    def meets(*_: object) -> None:
        raise request.param

    monkeypatch.setattr("prooflight.pages.job.parse_pages", meets)
    monkeypatch.setattr("prooflight.pages.job.JobSource.open", meets)


def rip(tmp_path: Path) -> int:
    return run(["rip", str(tmp_path / "a.pdf"), "--dpi", "72", "-o", str(tmp_path / "out")])


@pytest.mark.parametrize(
    "broken",
    [
        EOFError("Ran out of input"),
        KeyError("[/x]\x1b[2J\n" + "k" * 1000),
        RecursionError("deep"),
        SyntaxError("x"),
    ],
    indirect=True,
    ids=lambda error: type(error).__name__,
)
@pytest.mark.usefixtures("broken")
def test_a_fault_of_our_own_is_one_line_and_a_log_file(
    tmp_path: Path, state: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rip(tmp_path) == exit_codes.OWN_FAULT
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert line.startswith("prooflight: this is a fault of Prooflight itself: ")
    assert "\x1b" not in line
    assert line.endswith(f"(details in {state})")
    kept = state.read_text()
    assert "Traceback (most recent call last)" in kept
    assert "rip" in kept  # the command that was called


@pytest.mark.parametrize("broken", [ValueError("x")], indirect=True)
@pytest.mark.usefixtures("broken")
def test_a_fault_is_told_also_where_no_log_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path / "file"))
    assert rip(tmp_path) == exit_codes.OWN_FAULT
    assert "its details could not be written" in capsys.readouterr().err


@pytest.mark.parametrize("broken", [MemoryError()], indirect=True)
@pytest.mark.usefixtures("broken")
def test_memory_that_runs_out_is_no_fault_of_the_program(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rip(tmp_path) == exit_codes.UNUSABLE_INPUT
    assert "memory ran out" in capsys.readouterr().err


@pytest.mark.parametrize("broken", [KeyboardInterrupt()], indirect=True)
@pytest.mark.usefixtures("broken")
def test_who_stops_a_command_is_not_told_of_a_misprint(tmp_path: Path) -> None:
    assert rip(tmp_path) == 128 + signal.SIGINT


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["press", "mend"], "No such command 'mend'"),
        (["rip", "a.pdf"], "Missing option '--dpi'"),
        (["rip", "a.pdf", "--dpi", "x", "-o", "o"], "Invalid value for '--dpi'"),
        (["inspect", "--foo"], "No such option: --foo"),
    ],
)
def test_a_command_called_wrongly_is_one_line(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(arguments) == exit_codes.UNUSABLE_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert "--help`" in line


@pytest.fixture
def odd_job(tmp_path: Path) -> Path:
    """A folder whose name is markup that closes what was never opened, colour, and no Unicode."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/job[/x]\x1b[31m\xff"))
    folder.mkdir(parents=True)
    import numpy as np

    write_tiff(
        Page(cmyk=np.zeros((40, 30, 4), np.uint8), dpi=72.0, name="p0001", number=1), folder / "a[bold].tif"
    )
    return folder


def test_paths_are_shown_and_not_obeyed(odd_job: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = odd_job / "o[/x]"
    assert run(["rip", str(odd_job), "--dpi", "72", "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "o[/x]" in said.replace("\n", "")
    assert "\x1b[31m" not in said
    assert (out / "p0001.tif").is_file()


def test_an_odd_path_in_an_error_is_one_line(odd_job: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["rip", str(odd_job / "b[/c]\n.pdf"), "--dpi", "72", "-o", str(odd_job / "o")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert r"b[/c]\n.pdf" in line
    assert "\x1b" not in line


def test_json_of_odd_paths_can_be_read(odd_job: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["rip", str(odd_job), "--dpi", "72", "-o", str(odd_job / "o"), "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert Path(row["file"]).is_file()


def test_tables_show_names_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    from rich.table import Table

    table = Table(title="[bold]t[/x]")
    table.add_column("[a]")
    table.add_row("b[/c]\x1b[2J :warning:")
    show.people.print(table)
    said = capsys.readouterr().out
    for part in ("[bold]t[/x]", "[a]", r"b[/c]\x1b[2J :warning:"):
        assert part in said


def test_a_reader_that_goes_away_is_not_a_misprint() -> None:
    child = subprocess.run(
        f"{sys.executable} -m prooflight study inks --json | true; exit ${{PIPESTATUS[0]}}",
        shell=True,
        executable="/bin/bash",
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert child.returncode in (
        0,
        exit_codes.UNUSABLE_INPUT,
    )  # 0: all of it was written before the reader went
    assert "Traceback" not in child.stderr


def test_every_exit_code_is_told_apart() -> None:
    codes = [value for name, value in vars(exit_codes).items() if name.isupper()]
    assert len(set(codes)) == len(codes) == 6
    assert 0 not in codes
    assert cli.run(["--version"]) == 0
