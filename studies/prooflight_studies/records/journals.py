"""Journals of as many sheets as a press writes in days: the first as a run records them, the others as their copies."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Final

from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import RunEnd
from prooflight_studies.records.presses import run_facts, sheet

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

FIRST_SHEETS: Final = 2000
"""Sheets that are recorded as a run does it. Copies are made in a fiftieth of the time."""
SHEET_S: Final = 0.2


def write_journal(
    path: Path, runs: Sequence[int], *, begun_s: float, progress: Callable[[str], None]
) -> None:
    """Write a journal of runs that have ended, one after another. runs: sheets of each; begun_s: Unix time. [s]"""
    first = min(FIRST_SHEETS, runs[0])
    with Journal.open(str(path)) as journal:
        for at, sheets in enumerate(runs):
            started_s = begun_s + SHEET_S * sum(runs[:at])
            run = journal.begin_run(run_facts("made-up", sheets=sheets, started_s=started_s))
            for number in range(first if at == 0 else 0):
                journal.record(run, sheet(number, SHEET_S * number))
            journal.commit()
            journal.end_run(run, RunEnd(ended_s=started_s + SHEET_S * sheets, ending="finished"))
    with closing(sqlite3.connect(path)) as raw:
        columns = [row[1] for row in raw.execute("PRAGMA table_info(pages)")]
        moved = {
            "run_id": ":run",
            "sheet": "sheet + :by",
            "job_page": "job_page + :by",
            "time_s": f"time_s + {SHEET_S} * :by",
        }
        copied = ", ".join(moved.get(name, name) for name in columns)
        for run, sheets in enumerate(runs, start=1):
            progress(f"writing a journal: {sum(runs[: run - 1]):,} of {sum(runs):,} sheets")
            for by in range(first if run == 1 else 0, sheets, first):
                raw.execute(
                    f"INSERT INTO pages ({', '.join(columns)}) SELECT {copied} FROM pages WHERE rowid <= :rest",
                    {"run": run, "by": by, "rest": min(first, sheets - by)},
                )
            raw.commit()
