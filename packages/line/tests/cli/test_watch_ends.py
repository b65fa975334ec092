"""How `prooflight watch` ends: whatever keeps a sheet from being judged is said, and no exit code hides it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.cli.calls import PROOFLIGHT
from tests.cli.word_jobs import write_word_job

from prooflight.cli import run
from prooflight.scans.recorded import recorded_scans
from prooflight_line.journal.journal import Journal

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from prooflight.press.artefact import Press

PATIENCE_S = 60.0
"""Only a test that fails waits so long."""
PAGES = 5
TORN = 3
PHASE = '"phase": '
"""In lines that say how far the preparation is."""


@pytest.fixture(scope="module")
def folder(press: Press, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``x.press``; ``job``, five pages of 36 x 30 mm; ``scans`` of them; ``torn``, the job with page 3 cut off."""
    folder, rng = tmp_path_factory.mktemp("watched"), np.random.default_rng(11)
    press.save(folder / "x.press")
    write_word_job(folder / "job", pages=PAGES, rng=rng, tinted=True)
    made = ["simulate", str(folder / "job"), "--press", str(folder / "x.press"), "-o", str(folder / "scans")]
    assert run([*made, "--seed", "3", "--json"]) == 0
    shutil.copytree(folder / "job", folder / "torn")
    torn = folder / "torn" / f"p{TORN:04d}.tif"
    torn.write_bytes(torn.read_bytes()[: torn.stat().st_size // 2])
    return folder


@pytest.fixture
def watch(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, list[dict[str, Any]], str]]:
    def call(job: str, source: str, *more: object) -> tuple[int, list[dict[str, Any]], str]:
        capsys.readouterr()
        code = run(arguments(folder, job, source, tmp_path / "runs.sqlite", *more))
        captured = capsys.readouterr()
        return (
            code,
            [json.loads(line) for line in captured.out.splitlines() if PHASE not in line],
            captured.err,
        )

    return call


def arguments(folder: Path, job: str, source: str, journal: object, *more: object) -> list[str]:
    given = ["watch", folder / job, "--press", folder / "x.press", "--source", source]
    return [str(one) for one in (*given, "--journal", journal, "--json", *more)]


def next_row(process: subprocess.Popen[str]) -> dict[str, Any]:
    """The next line that says something of the run itself."""
    assert process.stdout is not None
    while True:
        line = process.stdout.readline()
        if PHASE not in line:
            found: dict[str, Any] = json.loads(line)
            return found


def ending(journal: Path) -> tuple[str, str]:
    with Journal.open(str(journal), read_only=True) as opened:
        (facts,) = opened.runs()
        return facts.state, "" if facts.end is None else facts.end.detail


def lines_of(folder: Path, pages: int) -> bytes:
    """Plain lines of the first scans."""
    scans = [scan.read() for scan in recorded_scans(folder / "scans", sensors=1)][:pages]
    return b"".join(scan.transpose(1, 0, 2).astype("<u2").tobytes() for scan in scans)


def test_a_torn_page_is_named_its_sheets_are_not_inspected_and_all_others_are(
    folder: Path, watch: Callable[..., tuple[int, list[dict[str, Any]], str]], tmp_path: Path
) -> None:
    code, rows, said = watch("torn", f"replay:{folder / 'scans'}")
    path = str(folder / "torn" / f"p{TORN:04d}.tif")
    assert code == 3
    assert rows[0]["notice"] == "page-unusable"
    assert path in rows[0]["text"]
    assert [row["verdict"] for row in rows[1:]] == ["good", "good", "not-inspected", "good", "good"]
    assert rows[TORN]["page"] == f"p{TORN:04d}"
    assert rows[TORN]["reason"].startswith(f"{path}: the TIFF is truncated")
    assert rows[TORN]["faults"] == []
    told = said.splitlines()
    assert len(told) == 2
    assert all(path in line for line in told)
    assert "1 sheet was not inspected" in told[1]
    state, detail = ending(tmp_path / "runs.sqlite")
    assert state == "finished"
    assert path in detail


@pytest.mark.parametrize("pages", [0, 2])
def test_lines_that_end_too_early_are_no_success(
    pages: int,
    folder: Path,
    watch: Callable[..., tuple[int, list[dict[str, Any]], str]],
    tmp_path: Path,
) -> None:
    (tmp_path / "lines").write_bytes(lines_of(folder, pages))
    code, rows, said = watch("job", f"raw:{tmp_path / 'lines'}")
    assert code == 3
    assert [row["verdict"] for row in rows] == ["good"] * pages
    assert said == f"prooflight: {PAGES - pages} of 5 sheets did not come\n"
    assert ending(tmp_path / "runs.sqlite") == ("fault", f"{PAGES - pages} of 5 sheets did not come")


def test_a_sheet_cut_off_by_the_end_of_the_lines_is_not_inspected(
    folder: Path, watch: Callable[..., tuple[int, list[dict[str, Any]], str]], tmp_path: Path
) -> None:
    whole, cut = lines_of(folder, 2), lines_of(folder, 3)
    line_bytes = 2 * 400
    lines = (len(whole) + (len(cut) - len(whole)) // 2) // line_bytes
    (tmp_path / "lines").write_bytes(cut[: lines * line_bytes])
    code, rows, _ = watch("job", f"raw:{tmp_path / 'lines'}")
    assert code == 3
    assert [row["verdict"] for row in rows] == ["good", "good", "not-inspected"]
    assert rows[2]["reason"] == "the lines ended within the sheet"


def test_verdicts_that_are_not_recorded_change_the_exit_code(
    folder: Path,
    watch: Callable[..., tuple[int, list[dict[str, Any]], str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The disk is full from the first sheet to the end."""

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("prooflight_line.journal.rows.write_rows", full)
    code, rows, said = watch("job", f"replay:{folder / 'scans'}")
    assert code == 3
    assert [row["verdict"] for row in rows] == ["good"] * PAGES
    assert "5 verdicts not recorded in the journal" in said.splitlines()[-1]


@pytest.mark.parametrize(
    ("more", "names"),
    [
        (("--sheets", 10**26), "--sheets"),
        (("--deadline", "nan"), "--deadline"),
        (("--deadline", "inf"), "--deadline"),
        (("--stall", "nan"), "--stall"),
        (("--stall", "0"), "--stall"),
        (("--false-alarms", "nan"), "--false-alarms"),
        (("--trigger", 10**26), "--trigger"),
        (("--threads", 10**6), "--threads"),
        (("--seed", 10**30), "--seed"),
        (("--source", "drum:nan"), "drum:5"),
        (("--source", "drum:-2"), "drum:5"),
        (("--source", "drum:1e9"), "drum:5"),
        (("--source", "drum:1e-300"), "drum:5"),
        (("--source", "raw:."), "is a folder"),
        (("--source", "tcp:a..b:5"), "a..b"),
        (("--source", "tcp:localhost:123456"), "65535"),
        (("--source", "replay:"), "replay:PATH"),
    ],
)
def test_values_beyond_all_sense_are_refused(
    more: tuple[object, ...],
    names: str,
    watch: Callable[..., tuple[int, list[dict[str, Any]], str]],
    tmp_path: Path,
) -> None:
    code, rows, said = watch("job", "drum", *more)
    assert (code, rows) == (2, [])
    assert names in said
    assert "Traceback" not in said
    assert not (tmp_path / "runs.sqlite").exists()


# --- a silent camera, and a person ---


@pytest.fixture
def silent(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, int | None, int]]:
    """A camera that has nothing to say yet: its address, standard input for the command, and where to write lines."""
    if request.param == "socket":
        with socket.create_server(("127.0.0.1", 0)) as server:
            server.settimeout(PATIENCE_S)
            yield f"tcp:127.0.0.1:{server.getsockname()[1]}", None, server.fileno()
        return
    if request.param == "pipe":
        os.mkfifo(tmp_path / "pipe")
        descriptor = os.open(tmp_path / "pipe", os.O_RDWR)
        yield f"raw:{tmp_path / 'pipe'}", None, descriptor
        os.close(descriptor)
        return
    reading, writing = os.pipe()
    yield "raw:-", reading, writing
    for descriptor in (reading, writing):
        os.close(descriptor)


def started(given: list[str], stdin: int | None) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*PROOFLIGHT, *given],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize(
    ("silent", "number"),  # how a run ends at a signal is the same for all of them
    [("socket", signal.SIGINT), ("pipe", signal.SIGTERM), ("standard input", signal.SIGINT)],
    indirect=["silent"],
)
def test_a_silent_camera_is_announced_and_its_run_can_be_stopped(
    number: signal.Signals, silent: tuple[str, int | None, int], folder: Path, tmp_path: Path
) -> None:
    address, stdin, _ = silent
    journal = tmp_path / "runs.sqlite"
    process = started(arguments(folder, "job", address, journal, "--stall", 0.5), stdin)
    try:
        assert process.stdout is not None
        assert next_row(process)["notice"] == "silent"
        process.send_signal(number)
        out, said = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert process.returncode == 3
    assert out == ""
    assert said.splitlines() == [
        "prooflight: no line has arrived for 0.5 s",
        "prooflight: 5 of 5 sheets did not come",
    ]
    assert ending(journal) == ("stopped", "5 of 5 sheets did not come")


def test_lines_that_come_again_are_announced_and_what_passed_is_inspected_when_a_person_stops(
    folder: Path, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / "pipe")
    camera = os.open(tmp_path / "pipe", os.O_RDWR)
    given = arguments(folder, "job", f"raw:{tmp_path / 'pipe'}", "none", "--stall", 0.5)
    process = started(given, None)
    try:
        assert process.stdout is not None
        rows = [next_row(process)]
        data = memoryview(lines_of(folder, 3))
        while data:
            data = data[os.write(camera, data) :]
        while len(rows) < 5 or rows[-1].get("notice") != "silent":
            rows.append(next_row(process))
        process.send_signal(signal.SIGINT)
        out, said = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
        os.close(camera)
    rows += [json.loads(line) for line in out.splitlines() if PHASE not in line]
    notices = [row["notice"] for row in rows if "notice" in row]
    verdicts = [row["verdict"] for row in rows if "verdict" in row]
    assert notices[:3] == ["silent", "lines-again", "silent"]
    assert verdicts == ["good"] * 3
    assert process.returncode == 3
    assert said.splitlines()[-1] == "prooflight: 2 of 5 sheets did not come"
