"""The link to the server is away for a week: what a press recorded meanwhile is shipped while it goes on printing."""

from __future__ import annotations

import multiprocessing
import os
import sqlite3
import time
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from prooflight_line.records.database import RecordsError, connect, upgrade
from prooflight_line.testing.postgres import LocalPostgres
from prooflight_studies.records.migrating import SHEET_S, write_journal
from prooflight_studies.records.shipping import PressPlan, cut_link, record_sheets, ship, started

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.process import BaseProcess
    from multiprocessing.synchronize import Event

    import numpy as np

LEAST_RUN, MOST_RUN = 2_000, 40_000
"""Sheets of a job. Assumed: some minutes to two hours of printing."""
SAMPLE_S: Final = 0.5
SHOWN_EVERY_S: Final = 20.0
SETTLED_S: Final = 20.0
"""Time within which the last rows are shipped when nothing is written any more; 0.5 s are usual."""
PATIENCE_S: Final = 3600.0
"""Time after which the shipper is said not to catch up."""
_OF_DATABASE: Final = """SELECT r.number, count(*), sum(s.sheet), count(*) FILTER (WHERE s.verdict = 'misprint')
    FROM sheets s JOIN runs r ON r.id = s.run_id GROUP BY 1"""
_OF_JOURNAL: Final = "SELECT run_id, count(*), sum(sheet), sum(verdict = 'misprint') FROM pages GROUP BY 1"


def measure_backlog(
    folder: Path,
    *,
    sheets: int,
    tried_s: float,
    followed_s: float,
    rng: np.random.Generator,
    progress: Callable[[str], None],
) -> dict[str, Any]:
    """Write a journal, let its shipper wait for the server, start the server, and return how all is shipped.

    folder: is empty and on a real disk. sheets: that the journal holds when the link is back. tried_s: time for
    which the shipper tries in vain before; from 62 s on it waits 30 s between two tries, as after a week. followed_s:
    time for which the press is followed after all has been shipped. [s]
    """
    runs = _runs(sheets, rng)
    load_before = os.getloadavg()[0]
    server = LocalPostgres(folder / "server")
    server.start()
    try:
        upgrade(server.url)
        server.stop()
        plan = PressPlan(
            number=0,
            journal=folder / "journal" / "journal.sqlite",
            sheets_per_s=1 / SHEET_S,
            seconds=tried_s + PATIENCE_S,
        )
        plan.journal.parent.mkdir()
        write_journal(plan.journal, runs, begun_s=time.time() - SHEET_S * sheets, progress=progress)
        journal_bytes = _size(plan.journal.parent)
        figures = _measured(server, plan, sheets, tried_s, followed_s, progress)
    finally:
        with suppress(RuntimeError):  # it may be away still
            server.stop()
    cores = os.cpu_count() or 1
    return {
        "sheets": sheets,
        "runs": len(runs),
        "hours": sheets * SHEET_S / 3600.0,
        "sheets_per_s": 1 / SHEET_S,
        "journal_bytes": journal_bytes,
        **figures,
        "cores": cores,
        "load": [load_before / cores, os.getloadavg()[0] / cores],
    }


@dataclass(kw_only=True)
class _Shipper:
    """The process that ships; killed, another takes its place, and its figures are those of both."""

    plan: PressPlan
    url: str
    process: BaseProcess = field(init=False)
    down: Event = field(init=False)
    """Set when it has first tried in vain."""
    peak_bytes: int = 0
    _cpu_s: dict[int, float] = field(default_factory=dict)

    def start(self) -> None:
        """Start a process; one before must have been killed."""
        self.down = multiprocessing.get_context("spawn").Event()
        self.process = started(ship, [self.plan], self.url, self.down)

    def kill(self) -> None:
        """Kill it at once."""
        self.process.kill()
        self.process.join()

    def sample(self) -> None:
        """Note memory and processor time."""
        number = self.process.pid
        assert number is not None
        self.peak_bytes = max(self.peak_bytes, _peak_bytes(number))
        self._cpu_s[number] = _cpu_s(number)

    @property
    def cpu_s(self) -> float:
        """Processor time of all that there were. [s]"""
        return sum(self._cpu_s.values())


def _measured(
    server: LocalPostgres,
    plan: PressPlan,
    sheets: int,
    tried_s: float,
    followed_s: float,
    progress: Callable[[str], None],
) -> dict[str, Any]:
    shipper = _Shipper(plan=plan, url=server.url)
    begun_s = time.time()
    writer = started(record_sheets, [plan], begun_s)
    shipper.start()
    progress(f"{sheets:,} sheets are in the journal; the shipper cannot ship for {tried_s:.0f} s")
    if not shipper.down.wait(PATIENCE_S):
        raise RuntimeError("the shipper has not started")
    time.sleep(tried_s)
    shipper.sample()
    waiting_bytes, waiting_cpu_s = shipper.peak_bytes, shipper.cpu_s
    server.start()
    back_s = time.time()
    try:
        figures = _caught_up(server, shipper, begun_s, back_s, sheets, followed_s, progress)
        writer.terminate()
        writer.join()
        figures |= _compared(plan.journal, server.url)
    finally:
        writer.kill()
        shipper.kill()
    with connect(server.url) as connection:
        ((stored_bytes,),) = connection.execute("SELECT pg_database_size(current_database())").fetchall()
    return {
        **figures,
        "tried_s": tried_s,
        "waiting_bytes": waiting_bytes,
        "peak_bytes": shipper.peak_bytes,
        "shipper_cpu_s": shipper.cpu_s - waiting_cpu_s,
        "database_bytes": stored_bytes,
    }


def _caught_up(
    server: LocalPostgres,
    shipper: _Shipper,
    begun_s: float,
    back_s: float,
    sheets: int,
    followed_s: float,
    progress: Callable[[str], None],
) -> dict[str, Any]:
    """Follow until all is shipped, and some time more; kill the shipper at a third, and cut its link at two thirds."""
    faults = [(sheets // 3, "kill"), (2 * sheets // 3, "cut")]
    figures: dict[str, Any] = {}
    lags: list[float] = []
    row, head, most_bytes, shown_s = 0, _head(shipper.plan.journal), 0, 0.0
    own_cpu_s = _server_cpu_s(server)
    while True:
        now_s = time.time()
        before, row = row, max(row, _shipped_row(server.url))
        if row and "first_s" not in figures:
            figures["first_s"] = now_s - back_s
        if now_s >= shown_s and row:
            shown_s, left = now_s + SHOWN_EVERY_S, (head - row) * (now_s - back_s) / row
            progress(f"{row:,} of {head:,} rows are shipped; about {left:.0f} s are left")
        if faults and row >= faults[0][0]:
            if faults.pop(0)[1] == "kill":
                shipper.kill()
                shipper.start()
            else:
                cut_link(server.url)
        if "caught_up_s" in figures:
            # Row sheets + n + 1 holds sheet n of the run that was begun when the link was away.
            lags += [now_s - begun_s - SHEET_S * (number - sheets) for number in range(before, row)]
            if now_s - back_s >= figures["caught_up_s"] + followed_s:
                break
        elif row >= head:
            figures |= {
                "caught_up_s": now_s - back_s,
                "shipped": row,
                "server_cpu_s": _server_cpu_s(server) - own_cpu_s,
            }
        if now_s - back_s > PATIENCE_S:
            raise RuntimeError(
                f"the shipper has not caught up: {row:,} of {head:,} rows after {PATIENCE_S:.0f} s"
            )
        shipper.sample()
        most_bytes = max(most_bytes, _size(shipper.plan.journal.parent))
        head = _head(shipper.plan.journal)
        time.sleep(SAMPLE_S)
    return figures | {"most_bytes": most_bytes, "lag_after_s": max(lags)}


def _runs(sheets: int, rng: np.random.Generator) -> list[int]:
    """Return the sheets of each run, so many in all."""
    runs: list[int] = []
    while (left := sheets - sum(runs)) > 0:
        runs.append(min(left, int(rng.integers(LEAST_RUN, MOST_RUN))))
    return runs


def _shipped_row(url: str) -> int:
    import psycopg

    try:
        with connect(url) as connection:
            return max((row for (row,) in connection.execute("SELECT shipped_row FROM presses")), default=0)
    except (RecordsError, psycopg.Error):
        return 0


def _head(journal: Path) -> int:
    with closing(sqlite3.connect(f"file:{journal}?mode=ro", uri=True)) as raw:
        return int(raw.execute("SELECT max(rowid) FROM pages").fetchone()[0])


def _compared(journal: Path, url: str, *, within_s: float = SETTLED_S) -> dict[str, Any]:
    """Compare the rows of each run in the database with those of the journal, when nothing is written any more.

    within_s: time for which the last rows are waited for. [s]
    """
    with closing(sqlite3.connect(f"file:{journal}?mode=ro", uri=True)) as raw:
        written = {run: tuple(map(int, rest)) for run, *rest in raw.execute(_OF_JOURNAL)}
    ends_s = time.time() + within_s
    while True:
        with connect(url) as connection:
            stored = {run: tuple(map(int, rest)) for run, *rest in connection.execute(_OF_DATABASE)}
        if stored == written or time.time() > ends_s:
            break
        time.sleep(SAMPLE_S)
    runs = written.keys() | stored.keys()
    more = {run: stored.get(run, (0,))[0] - written.get(run, (0,))[0] for run in runs}
    return {
        "recorded": sum(count for count, *_ in written.values()),
        "lost": sum(max(-count, 0) for count in more.values()),
        "doubled": sum(max(count, 0) for count in more.values()),
        "other_runs": sum(stored.get(run) != written.get(run) for run in runs),
    }


def _size(folder: Path) -> int:
    """Return the size of all files of a folder, among them the part of a journal that SQLite writes first. [byte]"""
    return sum(file.stat().st_size for file in folder.iterdir() if file.exists())


def _peak_bytes(process: int) -> int:
    """Return the greatest memory that a process had so far. [byte]"""
    lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def _server_cpu_s(server: LocalPostgres) -> float:
    """Return the processor time of the server: of its first process, those that ended, and those that live. [s]"""
    leader = int((server.folder / "data" / "postmaster.pid").read_text(encoding="ascii").splitlines()[0])
    children = Path(f"/proc/{leader}/task/{leader}/children").read_text(encoding="ascii").split()
    total_s = _cpu_s(leader, ended=True)
    for child in map(int, children):
        with suppress(FileNotFoundError):
            total_s += _cpu_s(child)
    return total_s


def _cpu_s(process: int, *, ended: bool = False) -> float:
    """Return the processor time of a process. ended: with that of its children that have ended. [s]"""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return sum(map(int, fields[11 : 15 if ended else 13])) / os.sysconf("SC_CLK_TCK")
