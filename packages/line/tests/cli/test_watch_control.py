"""Runs that people start and stop from another process than the run's own."""

from __future__ import annotations

import json
import os
import signal
import time
from typing import TYPE_CHECKING, Any

from packages.line.tests.cli.test_queue import page, stages
from packages.line.tests.cli.test_watch_ends import PHASE, arguments, lines_of, next_row, started
from packages.line.tests.cli.test_watch_ends import folder as folder
from tests.cli.calls import call

from prooflight_line.job_queue.hot_folder import HotFolder
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import run_key
from prooflight_line.journal.run_control import RunControl

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable
    from pathlib import Path

    import pytest

    from prooflight.press.artefact import Press


PATIENCE_S = 300.0
"""Only a test that fails waits so long."""


def until(process: subprocess.Popen[str], true: Callable[[], object]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not true():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end_s, "it never came"
        time.sleep(0.05)


def feed(camera: int, lines: bytes, process: subprocess.Popen[str]) -> None:
    """Write lines into a pipe that a process reads; a process that has ended reads nothing."""
    os.set_blocking(camera, False)
    data = memoryview(lines)
    while data:
        try:
            data = data[os.write(camera, data) :]
        except BlockingIOError:
            assert process.poll() is None, process.communicate()
            time.sleep(0.01)


def test_a_stop_from_another_process_ends_a_run_as_ctrl_c_does(folder: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    camera = os.open(tmp_path / "pipe", os.O_RDWR)
    journal = tmp_path / "runs.sqlite"
    process = started(arguments(folder, "job", f"raw:{tmp_path / 'pipe'}", journal), None)
    try:
        feed(camera, lines_of(folder, 3), process)
        rows: list[dict[str, Any]] = []
        while sum("verdict" in row for row in rows) < 2:  # the end of the third is not known yet
            rows.append(next_row(process))
        control = RunControl(journal=journal)
        with Journal.open(str(journal), read_only=True) as opened:
            (run,) = opened.runs()
        control.stop("7@1000", by="Ann")  # of another run
        time.sleep(1.0)
        assert process.poll() is None
        control.stop(run_key(run), by="Ann")
        out, said = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
        os.close(camera)
    assert process.returncode == 3
    rows += [json.loads(line) for line in out.splitlines() if PHASE not in line]
    assert [row["verdict"] for row in rows if "verdict" in row] == ["good"] * 3
    stops = [row["text"] for row in rows if row.get("notice") == "stopped"]
    assert stops == ["Ann stopped the run in the console"]
    assert said.splitlines()[-1] == "prooflight: 2 of 5 sheets did not come"
    with Journal.open(str(journal), read_only=True) as opened:
        (run,) = opened.runs()
    assert run.end is not None
    assert (run.state, run.end.detail) == (
        "stopped",
        "Ann stopped the run in the console; 2 of 5 sheets did not come",
    )
    assert control.stop_request(run_key(run)) is None


def test_jobs_are_started_by_people_one_after_another(
    tmp_path: Path, press: Press, press_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    jobs, journal = tmp_path / "jobs", tmp_path / "runs.sqlite"
    jobs.mkdir()
    page(jobs / "first.tif")
    page(jobs / "second.tif", height_mm=31.0)
    call(capsys, "queue", "fill", jobs, "--settle", 0.1, "--once")
    first, second = (entry.key for entry in HotFolder.open(jobs).entries("queued"))
    trigger = press.geometry.lines(round(31.0 / 25.4 * 500) / 500 * 25.4)
    given = ["watch", jobs, "--queue", "--on-start", "--press", press_file, "--journal", journal, "--json"]
    run = ["--source", "drum", "--sheets", 2, "--trigger", trigger, "--world", "ideal"]
    process = started([str(one) for one in (*given, *run)], None)
    control = RunControl(journal=journal)
    try:
        until(process, lambda: control.starter)
        control.start("000009-000000000000", by="Ann")
        until(process, lambda: control.starter and control.starter.trouble and not control.starter.job)
        assert control.starter is not None
        assert "job 000009-000000000000 is not queued any more" in control.starter.trouble
        control.start(second, by="Ann")
        until(process, lambda: control.starter and control.starter.job == second)
        until(process, lambda: control.starter and not control.starter.job)
        assert (control.starter.trouble, process.poll()) == ("", None)
        process.send_signal(signal.SIGINT)
        out, said = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert process.returncode == 0, said
    assert stages(jobs) == {"first.tif": "queued", "second.tif": "done"}, (out, said, first)
    assert control.starter is None


def test_what_nobody_could_start_is_refused(
    tmp_path: Path, press_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("watch", tmp_path, "--press", press_file, "--source", "drum", "--on-start")
    for more, remedy in (
        ((), "give --queue"),
        (("--queue", "--journal", "none"), "leave out --journal none"),
        (("--queue", "--resume"), "leave out --resume"),
        (("--queue", "--serve"), "leave out --serve"),
    ):
        code, out, said = call(capsys, *given, *more)
        assert (code, out) == (2, "")
        assert remedy in said
