"""`prooflight watch --resume`: real processes are killed (SIGKILL) at several moments, and the run goes on."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.cli.calls import PROOFLIGHT
from tests.cli.word_jobs import write_word_job

from prooflight.cli import run
from prooflight.scans.recorded import recorded_scans
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.labels import run_key, sheet_id
from prooflight_line.plant.gate.log import LoggedDecisions, log_path
from prooflight_line.plant.simulator.plc import Belt, SimulatedPlc
from prooflight_line.plant.simulator.server import PlcServer
from prooflight_line.run.sheets.readings import UNWATCHED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile
    from prooflight_line.journal.records import PageRecord, RunRow

PATIENCE_S = 600.0
"""Only a test that fails waits so long."""
PAGES, SHEETS, EVERY = 3, 12, 5


@pytest.fixture(scope="module")
def folder(press: Press, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``x.press``, and ``job``, three pages of 36 x 30 mm."""
    folder, rng = tmp_path_factory.mktemp("resumed"), np.random.default_rng(11)
    press.save(folder / "x.press")
    write_word_job(folder / "job", pages=PAGES, rng=rng, tinted=True)
    return folder


def command(folder: Path, journal: Path, source: str, *more: object) -> list[str]:
    given = ["watch", folder / "job", "--press", folder / "x.press", "--source", source, "--world", "ideal"]
    given += ["--sheets", SHEETS, "--misprint", "streak:1", "--every", EVERY, "--journal", journal, "--json"]
    return [str(one) for one in (*given, *more)]


def killed(given: list[str], at: Callable[[list[dict[str, Any]]], bool]) -> list[dict[str, Any]]:
    """Run a command until ``at`` is true of the lines it has printed, and kill it then; return these lines."""
    with tempfile.NamedTemporaryFile("r") as printed:
        with Path(printed.name).open("w") as output:
            process = subprocess.Popen(
                [*PROOFLIGHT, *given],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
                stdout=output,
            )
        end_s = time.monotonic() + PATIENCE_S
        try:
            while True:
                text = Path(printed.name).read_text()
                rows = [json.loads(line) for line in text.split("\n")[:-1]]
                if at(rows):
                    return rows
                assert process.poll() is None, "it ended by itself"
                assert time.monotonic() < end_s, "it never came so far"
                time.sleep(0.002)
        finally:
            process.send_signal(signal.SIGKILL)
            process.wait()


def judged(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [row for row in rows if "verdict" in row]


def rows_in(journal: Path) -> int:
    """Return the number of rows, read as any program may; 0 while there is no journal."""
    with (
        suppress(sqlite3.OperationalError),
        closing(sqlite3.connect(f"file:{journal}?mode=ro", uri=True)) as base,
    ):
        return int(base.execute("SELECT count(*) FROM pages").fetchone()[0])
    return 0


def has_run(journal: Path) -> bool:
    with (
        suppress(sqlite3.OperationalError),
        closing(sqlite3.connect(f"file:{journal}?mode=ro", uri=True)) as base,
    ):
        return bool(base.execute("SELECT count(*) FROM runs").fetchone()[0])
    return False


def recorded(journal: Path) -> tuple[RunRow, list[PageRecord]]:
    with Journal.open(str(journal), read_only=True) as opened:
        [one] = opened.runs()
        return one, list(opened.pages(one.id))


def assert_whole(journal: Path, rows: list[PageRecord]) -> None:
    """Every sheet stands once, each page of the run in its turn, and every misprint that was seen is one."""
    assert [row.sheet for row in rows] == list(range(SHEETS))
    assert [row.job_page for row in rows] == list(range(SHEETS))
    for row in rows:
        if row.verdict.verdict == "not-inspected":
            assert "interrupted" in row.verdict.reason
        else:
            assert row.verdict.verdict == ("misprint" if row.sheet % EVERY == EVERY - 1 else "good")


@pytest.mark.parametrize("moment", ["before Ready", "at sheets 3 and 7", "soon after a commit"])
def test_a_run_that_was_killed_goes_on_in_the_same_run(
    moment: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = tmp_path / "runs.sqlite"
    # As fast as it can, all sheets may have passed before the first row is seen on the disk.
    paced = ("drum:3", "--deadline", 8000) if moment == "soon after a commit" else ("drum",)
    given = command(folder, journal, *paced)
    if moment == "before Ready":
        rows = killed(given, lambda _rows: has_run(journal))
        assert not judged(rows)
    elif moment == "at sheets 3 and 7":
        killed(given, lambda rows: len(judged(rows)) >= 3)
        killed([*given, "--resume"], lambda rows: bool(judged(rows)) and judged(rows)[-1]["sheet"] >= 7)
    else:
        killed(given, lambda _rows: rows_in(journal) > 0)
    before, old = recorded(journal)
    assert before.state == "interrupted"
    capsys.readouterr()
    code = run([*given, "--resume", "--log", "json"])
    printed = capsys.readouterr()
    lines = [json.loads(line) for line in printed.out.splitlines()]
    after, rows = recorded(journal)
    # A sheet has one name in all logs: that of the run's first start.
    logged = [json.loads(line) for line in printed.err.splitlines() if line.startswith("{")]
    names = [one["id"] for one in logged if one.get("event") == "sheet"]
    assert names == [sheet_id(run_key(after), row.sheet) for row in rows[len(old) :]]
    # The drum waits for its reader, so that no sheet passed unwatched: only verdicts may be lost.
    assert_whole(journal, rows)
    assert (before.id, after.id, after.state) == (1, 1, "finished")
    assert code == 1
    assert next(row["text"] for row in lines if row.get("notice") == "resumed").startswith("run 1,")
    assert judged(lines)[0]["sheet"] == len(old)
    assert after.end is not None
    counts = after.end.counts
    assert counts["good"] + counts["misprints"] == SHEETS
    assert counts["misprints"] == SHEETS // EVERY
    assert counts["journalled"] == SHEETS
    assert any("was interrupted" in note for row in rows for note in row.notes)


def feed(pipe: Path, lines: bytes) -> None:
    """Write lines into a pipe and close it, as a press that ends, or whose cable is pulled."""
    with suppress(BrokenPipeError), pipe.open("wb") as writing:
        writing.write(lines)


def test_sheets_that_nothing_watched_are_recorded_as_not_inspected(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One sheet and the beginning of another pass between the end of one process and the first line of the next."""
    journal, pipe, scans = tmp_path / "runs.sqlite", tmp_path / "pipe", tmp_path / "scans"
    made = ["simulate", str(folder / "job"), "--press", str(folder / "x.press"), "-o", str(scans)]
    assert run([*made, "--seed", "3", "--json"]) == 0
    os.mkfifo(pipe)
    lines = [
        scan.read().transpose(1, 0, 2).astype("<u2").tobytes() for scan in recorded_scans(scans, sensors=1)
    ]
    sheets = [lines[sheet % PAGES] for sheet in range(SHEETS)]
    given = command(folder, journal, f"raw:{pipe}")
    seen, missed = 5, 1  # fewer than a copy of the job, whose pages would look the same
    feeding = threading.Thread(target=feed, args=(pipe, b"".join(sheets[:seen]) + sheets[seen][: 800 * 100]))
    feeding.start()
    holding = os.open(pipe, os.O_RDWR)  # the press does not end when its lines are watched no more
    killed(given, lambda _rows: rows_in(journal) >= seen)
    feeding.join()
    os.close(holding)
    torn = sheets[seen + missed]
    rest = torn[len(torn) // 1600 * 800 :] + b"".join(sheets[seen + missed + 1 :])
    feeding = threading.Thread(target=feed, args=(pipe, rest))
    feeding.start()
    capsys.readouterr()
    code = run([*given, "--resume"])
    feeding.join()
    said = capsys.readouterr().err
    after, rows = recorded(journal)
    assert [row.sheet for row in rows] == list(range(len(rows)))
    assert [row.job_page for row in rows if row.job_page is not None] == list(range(SHEETS))
    assert {row.verdict.verdict for row in rows[:seen]} == {"good"}
    unwatched = [row for row in rows if "unwatched" in row.faults]
    # The torn sheet passed in part; which page it was is only known by its turn.
    assert {row.job_page for row in unwatched} == set(range(seen, seen + missed + 1))
    assert {row.verdict.verdict for row in unwatched} == {"not-inspected"}
    assert {row.verdict.reason for row in unwatched} == {UNWATCHED}
    assert {row.disposition for row in unwatched} == {"hold"}
    assert {row.verdict.verdict for row in rows if row.job_page and row.job_page > seen + missed} == {"good"}
    assert code == 3
    assert "were not inspected" in said
    assert after.end is not None
    assert after.end.counts["absent"] == 0


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PlcServer]:
    with (tmp_path / "trays.jsonl").open("w", buffering=1) as log:
        belt = Belt(distance_mm=800.0, counts_per_mm=10.0)
        with PlcServer(SimulatedPlc(belt=belt, heartbeat_s=2.0, log=log)) as running:
            yield running


@pytest.fixture
def plant(tmp_path: Path, prototype: PressFile, server: PlcServer) -> Path:
    """A press file with a gate."""
    path = tmp_path / "plant.toml"
    path.write_text(
        f"{prototype.text}\n[gate]\ndistance_mm = 800.0\ntolerance_mm = 14.0\n"
        f'[gate.plc]\nhost = "127.0.0.1"\nport = {server.port}\ntimeout_ms = 2000\nheartbeat_ms = 2000\n'
    )
    return path


def test_the_gate_goes_on_with_the_tags_of_the_run(
    folder: Path, server: PlcServer, plant: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Killed when the gate has decided a sheet that the journal does not have yet."""
    journal = tmp_path / "runs.sqlite"
    log = log_path(journal, 1)
    given = command(folder, journal, "drum:2", "--plant", plant, "--deadline", 8000)

    def between(_rows: list[dict[str, Any]]) -> bool:
        decided = log.read_text().count('"decision"') if log.exists() else 0
        return decided > max(rows_in(journal), 3)

    killed(given, between)
    _, old = recorded(journal)
    decided = LoggedDecisions.read(log).decisions
    assert len(decided) > len(old)
    with log.open("a") as torn:
        torn.write('{"kind": "decision", "tag": 7')  # the power failed while this was written
    capsys.readouterr()
    assert run([*given, "--resume"]) in (1, 3)  # 1: only misprints were decided and not recorded
    after, rows = recorded(journal)
    assert_whole(journal, rows)
    of_log = LoggedDecisions.read(log)
    assert list(of_log.decisions) == list(range(1, SHEETS + 1))
    # One more for each heartbeat that a busy machine has missed.
    assert len(set(of_log.sessions)) >= 2
    assert after.state == "finished"
    lost = rows[len(old) : len(decided)]
    assert {row.verdict.verdict for row in lost} <= {"not-inspected", "misprint"}
    assert [row.disposition for row in lost] == [
        "accept" if row.sheet % EVERY != EVERY - 1 else "divert" for row in lost
    ]
    # What lies in the good tray was judged good, and has the tag of its own sheet.
    for row in server.plc.rows:
        assert row.tray == "reject" or (row.truth == "good" and rows[row.tag - 1].disposition == "accept")
    trays = ["--trays", str(tmp_path / "trays.jsonl")]
    # 3: a sheet lies in no tray that is known, as after a heartbeat that a busy machine has missed.
    assert run(["run", "reconcile", "1", "--journal", str(journal), *trays, "--json"]) in (0, 1, 3)
    counts = json.loads(capsys.readouterr().out.splitlines()[-1])["counts"]
    assert not counts.get("wrong")
    assert sum(counts.values()) == SHEETS


@pytest.fixture(scope="module")
def broken_off(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``runs.sqlite``, whose run was killed before Ready."""
    broken = tmp_path_factory.mktemp("broken")
    journal = broken / "runs.sqlite"
    killed(command(folder, journal, "drum"), lambda _rows: has_run(journal))
    return broken


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ([], "there is nothing to resume"),
        (["--sheets", 13], "another: the number of sheets"),
        (["--layout", "sides=2"], "the layout"),
        (["--source", "replay:x"], "recorded scans start again with the first one"),
        (["--journal", "none"], "resumed from its journal"),
        (["--journal", "other.sqlite"], "other.sqlite"),
    ],
)
def test_what_cannot_be_resumed_is_refused_in_one_line(
    change: list[Any],
    says: str,
    folder: Path,
    broken_off: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    journal = tmp_path / "runs.sqlite"
    given = command(folder, journal, "drum")
    if change:
        shutil.copytree(broken_off, tmp_path, dirs_exist_ok=True)
    else:
        assert run(given) == 1
    before = recorded(journal)
    capsys.readouterr()
    assert run([*given, *map(str, change), "--resume"]) == 2
    said = capsys.readouterr().err
    assert said.splitlines()[-1].count("prooflight: ") == 1
    assert says in said.splitlines()[-1]
    after = recorded(journal)
    assert (after[0], len(after[1])) == (before[0], len(before[1]))
    assert not (tmp_path / "other.sqlite").exists()


def test_a_run_that_is_still_watched_is_not_resumed(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = tmp_path / "runs.sqlite"
    given = command(folder, journal, "drum")
    with Journal.open(str(journal)):
        assert run([*given, "--resume"]) == 2
    assert "another process still watches its run" in capsys.readouterr().err
