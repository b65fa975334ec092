"""A writer is killed (SIGKILL) again and again; what it was told is durable must be there, once.

The writers are forked by a process of their own, this file run as a program, so that they have no threads of a test
run in them and start in an instant.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from prooflight.detectors.verdict import Verdict
from prooflight_line.journal import packs
from prooflight_line.journal.aside import unclaimed_folder
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunFacts

KILLS = 20
SEED = 9
FACTS = RunFacts(
    job="job",
    job_digest="j",
    press="rig",
    press_digest="p",
    detector="matched_filter",
    source="drum",
    started_s=0.0,
)


def page(sheet: int) -> PageRecord:
    verdict = Verdict(page=f"p{sheet}", verdict="good", score=sheet / 7, threshold=1.0)
    evidence = {"values": np.full(400, sheet, np.float32)} if sheet % 3 else None
    return PageRecord(
        sheet=sheet,
        job_page=sheet,
        verdict=verdict,
        late=False,
        first_line=sheet,
        time_s=0.0,
        evidence=evidence,
    )


def write(path: Path, first: int, tell: int) -> None:
    """Go on with the run from sheet ``first``; say which sheets are durable, until somebody ends this."""
    journal = Journal.open(str(path), announce=lambda text: os.abort())
    run = journal.last_run().id if journal.runs() else journal.begin_run(FACTS)
    while True:
        last = first + 1 + first % 7
        for sheet in range(first, last):
            journal.record(run, page(sheet))
        if journal.commit():
            os.write(tell, last.to_bytes(8, "little"))
        first = last


def one_round(path: Path, durable: int, rng: np.random.Generator) -> int:
    """Let a writer live for a while; returns how many sheets are known to be durable."""
    first = max(durable - 3, 0)  # a restart tells its last sheets again
    commits, delay_s = int(rng.integers(0, 8)), float(rng.uniform(0, 0.03))
    hear, tell = os.pipe()
    child = os.fork()
    if not child:
        write(path, first, tell)
    os.close(tell)
    said = b""
    while len(said) < 8 * commits and select.select([hear], [], [], 30)[0]:
        said += os.read(hear, 8 * commits - len(said)) or sys.exit("the writer died by itself")
    time.sleep(delay_s)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    while more := os.read(hear, 1 << 16):
        said += more
    os.close(hear)
    return max(durable, int.from_bytes(said[-8:], "little"))


def check(path: Path, acknowledged: int, *, whole: bool) -> dict[str, Any]:
    """What a killed writer left, as found before and after the next one takes over; whole: read every page again."""
    found: dict[str, Any] = {"acknowledged": acknowledged, "strangers": 0}
    if not path.exists():
        return found | {"wrong": [] if not acknowledged else ["no journal"]}
    folder = packs.evidence_folder(path)
    with contextlib.closing(sqlite3.connect(path)) as connection:
        wrong = [row[0] for row in connection.execute("PRAGMA integrity_check") if row[0] != "ok"]
        wrong += [f"foreign key {row}" for row in connection.execute("PRAGMA foreign_key_check")]
        named = set()
        if connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'pages'").fetchone():
            sheets = [row[0] for row in connection.execute("SELECT sheet FROM pages")]
            if len(set(sheets)) < len(sheets):
                wrong.append("a sheet twice")
            if missing := set(range(acknowledged)) - set(sheets):
                wrong.append(f"lost {sorted(missing)}")
            named = {row[0] for row in connection.execute("SELECT file FROM packs")}
    files = {file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()}
    wrong += [f"no file {name}" for name in sorted(named - files)]
    found["strangers"] = len(files - named)
    with Journal.open(str(path)) as journal:
        for run in journal.runs():
            for row in journal.pages(run.id):
                if row.sheet < acknowledged - 20 and not whole:
                    continue
                again, meant = journal.page(run.id, row.sheet), page(row.sheet)
                kept, told = again.evidence, meant.evidence
                same = (kept is None) == (told is None)
                if same and kept is not None and told is not None:
                    same = np.array_equal(kept["values"], told["values"])
                if again.verdict != meant.verdict or not same:
                    wrong.append(f"sheet {row.sheet} is not what was written")
        if len(journal.runs()) > 1:
            wrong.append("a second run")
    if any(
        file
        for file in folder.rglob("*")
        if file.is_file() and file.relative_to(folder).as_posix() not in named
    ):
        wrong.append("strangers were left")
    aside = unclaimed_folder(path)
    kept = {file.relative_to(aside).as_posix() for file in aside.rglob("*") if file.is_file()}
    if files - named - kept:
        wrong.append("a stranger was removed")
    return found | {"wrong": wrong}


def main(path: Path, kills: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rounds = []
    acknowledged = 0
    for number in range(1, kills + 1):
        acknowledged = one_round(path, acknowledged, rng)
        rounds.append(check(path, acknowledged, whole=number == kills))
    sys.stdout.write(json.dumps(rounds))


def test_nothing_acknowledged_is_lost_or_doubled_however_often_a_writer_is_killed(tmp_path: Path) -> None:
    arguments = [sys.executable, __file__, str(tmp_path / "journal.sqlite"), str(KILLS), str(SEED)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    rounds = json.loads(done.stdout)
    assert len(rounds) == KILLS
    assert [one["wrong"] for one in rounds] == [[]] * KILLS
    assert rounds[-1]["acknowledged"] > KILLS  # they did live to write


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
