"""Forty presses ship into one server while the server, the link, the shippers and the disks fail in turn."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import subprocess
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.verdict import Region, Verdict
from prooflight_line.journal.following import follow
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunEnd, RunFacts
from prooflight_line.records.database import connect, upgrade
from prooflight_line.records.service import ShippingService
from prooflight_line.testing.postgres import LocalPostgres

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from multiprocessing.process import BaseProcess
    from multiprocessing.synchronize import Event
    from pathlib import Path

GROUPS: Final = 4
"""Number of processes that record, and of processes that ship."""
SAMPLE_S: Final = 0.1
FAULTS: Final = (
    "server killed",
    "shipper killed",
    "link cut",
    "server's disk full",
    "server restarted",
    "journals' disk full",
    "server away",
)
"""Actions in the order in which they come, again and again."""
LASTS_S: Final = 5.0
"""Time for which a server is away or a disk full."""
SETTLED_S: Final = 40.0
"""Time after a fault in which a shipper tries again, at most, and catches up; lags outside of it are stated alone."""
DISK_MB: Final = 1500


@dataclass(kw_only=True)
class Rig:
    """Server, shippers and disks, each of which can fail."""

    server: LocalPostgres
    plans: list[PressPlan]
    disks: tuple[Path, Path] | None
    """Disks of the server and of the journals, which can be filled; None: only an administrator could make them."""
    shippers: list[BaseProcess] = field(default_factory=list)

    def start_shipper(self, at: int) -> BaseProcess:
        """Start the process that ships a group of presses."""
        return started(ship, self.plans[at::GROUPS], self.server.url)

    def fail(self, fault: str, at: int) -> None:
        """Let something fail, and mend it."""
        if fault == "server killed":
            self.server.kill()
            self.server.start()
        elif fault == "server restarted":
            self.server.stop()
            self.server.start()
        elif fault == "server away":
            self.server.stop()
            time.sleep(LASTS_S)
            self.server.start()
        elif fault == "shipper killed":
            self.shippers[at % GROUPS].kill()
            self.shippers[at % GROUPS].join()
            self.shippers[at % GROUPS] = self.start_shipper(at % GROUPS)
        elif fault == "link cut":
            cut_link(self.server.url)
        else:
            disk = (self.disks or ())[fault == "journals' disk full"]
            with _full(disk):
                time.sleep(LASTS_S)


def cut_link(url: str) -> None:
    """End all connections to the server."""
    with connect(url) as connection:
        connection.execute(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()"
            " AND backend_type = 'client backend'"
        )


def measure_shipping(
    folder: Path, *, presses: int, sheets_per_s: float, minutes: float, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Record, ship, let everything fail, and count; return the figures. folder: is empty and on a real disk."""
    with _disks(folder) as disks:
        journals = folder / "journals" if disks is None else disks[1]
        journals.mkdir(exist_ok=True)
        plans = [
            PressPlan(
                number=number,
                journal=journals / f"{number:02}.sqlite",
                sheets_per_s=sheets_per_s,
                seconds=60.0 * minutes,
            )
            for number in range(presses)
        ]
        server = LocalPostgres((folder if disks is None else disks[0]) / "server")
        server.start()
        try:
            upgrade(server.url)
            rig = Rig(server=server, plans=plans, disks=disks)
            return _measured(rig, progress)
        finally:
            server.stop()


def _measured(rig: Rig, progress: Callable[[str], None]) -> dict[str, Any]:
    rig.shippers = [rig.start_shipper(at) for at in range(GROUPS)]
    begun_s = time.time() + 8.0  # processes load until then
    writers = [started(record_sheets, rig.plans[at::GROUPS], begun_s) for at in range(GROUPS)]
    seconds, presses = rig.plans[0].seconds, len(rig.plans)
    faults = [fault for fault in FAULTS if rig.disks is not None or "disk" not in fault]
    first_s, last_s = begun_s + 0.15 * seconds, begun_s + 0.85 * seconds
    times_s = list(np.linspace(first_s, last_s, max(len(faults), int(0.7 * seconds / SETTLED_S))))
    happened: list[tuple[float, float, str]] = []
    lags: list[tuple[float, float]] = []
    rows: dict[str, int] = {}
    shown_s = 0.0
    connection = None
    while time.time() < begun_s + seconds or any(writer.is_alive() for writer in writers):
        now_s = time.time()
        if now_s >= shown_s:
            shown_s = now_s + 20.0
            progress(f"{presses} presses, {max(now_s - begun_s, 0.0):.0f} of {seconds:.0f} s")
        if times_s and now_s >= times_s[0]:
            times_s.pop(0)
            fault = faults[len(happened) % len(faults)]
            rig.fail(fault, len(happened))
            happened.append((now_s, time.time(), fault))
        connection = _sample(rig, connection, begun_s, rows, lags)
        time.sleep(SAMPLE_S)
    ended_s = time.time()
    expected = _expected(rig.plans)
    while sum(_counts(rig.server.url)[0].values()) < sum(expected.values()) and time.time() < ended_s + 120.0:
        time.sleep(0.2)
    caught_up_s = time.time() - ended_s
    for process in rig.shippers:
        process.terminate()
        process.join()
    stored, distinct, ended = _counts(rig.server.url)
    return {
        "presses": presses,
        "sheets_per_s": rig.plans[0].sheets_per_s,
        "minutes": seconds / 60.0,
        "recorded": sum(expected.values()),
        "lost": sum(max(expected[name] - stored.get(name, 0), 0) for name in expected),
        "doubled": sum(stored.values()) - sum(distinct.values()),
        "runs_ended": ended,
        "caught_up_s": caught_up_s,
        "faults": {fault: sum(fault == one for _, _, one in happened) for fault in FAULTS},
        "disks": rig.disks is not None,
        **_lags(lags, happened),
        "cores": os.cpu_count() or 1,
    }


def _sample(
    rig: Rig, connection: Any, begun_s: float, rows: dict[str, int], lags: list[tuple[float, float]]
) -> Any:
    """Note when each press's rows were seen in the database, and how long after they were recorded."""
    import psycopg

    from prooflight_line.records.database import RecordsError

    try:
        connection = connection or connect(rig.server.url)
        current = dict(connection.execute("SELECT name, shipped_row FROM presses").fetchall())
    except (RecordsError, psycopg.Error):
        with suppress(psycopg.Error):
            if connection is not None:
                connection.close()
        return None
    now_s, rate_hz = time.time(), rig.plans[0].sheets_per_s
    for name, row in current.items():
        for number in range(rows.get(name, 0), row):  # row n of a new journal holds sheet n - 1
            lags.append((now_s, now_s - begun_s - number / rate_hz))
        rows[name] = max(row, rows.get(name, 0))
    return connection


def _lags(lags: list[tuple[float, float]], happened: list[tuple[float, float, str]]) -> dict[str, Any]:
    at_s, lag_s = np.array(lags).T if lags else (np.zeros(0), np.zeros(0))
    near = np.zeros(at_s.size, bool)
    for begun_s, mended_s, _ in happened:
        near |= (at_s >= begun_s) & (at_s <= mended_s + SETTLED_S / 2)
    figures: dict[str, Any] = {}
    for name, chosen in (("all", lag_s), ("undisturbed", lag_s[~near])):
        figures[name] = (
            None
            if not chosen.size
            else {
                "rows": int(chosen.size),
                "median_s": float(np.median(chosen)),
                "p99_s": float(np.quantile(chosen, 0.99)),
                "greatest_s": float(chosen.max()),
            }
        )
    return {"lags": figures}


def _expected(plans: list[PressPlan]) -> dict[str, int]:
    """Return the number of sheets in each journal."""
    counts = {}
    for plan in plans:
        journal = follow(plan.journal, version="0")
        assert journal is not None
        counts[plan.name] = sum(run.pages for run in journal.runs())
        journal.close()
    return counts


def _counts(url: str) -> tuple[dict[str, int], dict[str, int], int]:
    """Return the rows of each press, its different sheets, and the number of runs that have ended."""
    query = """SELECT p.name, count(*), count(DISTINCT (s.run_id, s.sheet)) FROM sheets s
        JOIN presses p ON p.id = s.press_id GROUP BY 1"""
    with connect(url) as connection:
        rows = connection.execute(query).fetchall()
        ((ended,),) = connection.execute("SELECT count(*) FROM runs WHERE ended IS NOT NULL").fetchall()
    return {name: count for name, count, _ in rows}, {name: count for name, _, count in rows}, ended


@contextmanager
def _full(disk: Path) -> Iterator[None]:
    """Leave no room on a disk for the block."""
    filler = disk / "filler"
    try:
        with filler.open("wb") as file, suppress(OSError):
            os.posix_fallocate(file.fileno(), 0, max(shutil.disk_usage(disk).free - 4096, 4096))
        with filler.open("ab", buffering=0) as file, suppress(OSError):
            while True:
                file.write(bytes(4096))
        yield
    finally:
        filler.unlink(missing_ok=True)


@contextmanager
def _disks(folder: Path) -> Iterator[tuple[Path, Path] | None]:
    """Make two small disks in files, for the block; None where that is not permitted."""
    mounted: list[Path] = []
    try:
        for name in ("server-disk", "journals-disk"):
            image, place = folder / f"{name}.img", folder / name
            place.mkdir()
            with image.open("wb") as file:
                file.truncate(DISK_MB * 1_000_000)
            made = all(
                subprocess.run(command, capture_output=True, check=False).returncode == 0
                for command in (
                    ["mkfs.ext4", "-q", "-m", "0", str(image)],
                    ["mount", "-o", "loop", str(image), str(place)],
                )
            )
            if not made:
                yield None
                return
            mounted.append(place)
        yield mounted[0], mounted[1]
    finally:
        for place in mounted:
            subprocess.run(["umount", "-l", str(place)], capture_output=True, check=False)


# --- presses that record sheets at their pace, and their shippers ---

ALARM_EVERY: Final = 50
COMMIT_S: Final = 0.5
"""Time between commits of a journal, as of a run's recorder."""
PLANTS: Final = ("north", "south", "east", "west")


@dataclass(frozen=True, slots=True, kw_only=True)
class PressPlan:
    """A press of the study."""

    number: int
    journal: Path
    sheets_per_s: float
    seconds: float

    @property
    def name(self) -> str:
        """Name of the press."""
        return f"press {self.number:02}"

    @property
    def sheets(self) -> int:
        """Number of sheets that it records."""
        return int(self.seconds * self.sheets_per_s)

    @property
    def plant(self) -> str:
        """Name of its plant."""
        return PLANTS[self.number % len(PLANTS)]


def sheet(number: int, time_s: float) -> PageRecord:
    """Return a sheet's record as long as a real one's; one in ``ALARM_EVERY`` is a misprint. [s]"""
    verdict = Verdict(
        page=f"p{number % 24 + 1:04}", verdict="good", score=-1.0, threshold=1.0, detector="matched_filter"
    )
    if number % ALARM_EVERY == ALARM_EVERY - 1:
        spot = Region(x_mm=60.0, y_mm=80.0, width_mm=3.0, height_mm=3.0, score=9.0, kind="spots-voids")
        verdict = replace(verdict, verdict="misprint", kind="spots-voids", score=8.0, regions=(spot,))
    return PageRecord(
        sheet=number, job_page=number, verdict=verdict, late=False, first_line=3000 * number, time_s=time_s
    )


def record_sheets(plans: list[PressPlan], begun_s: float) -> None:
    """Record sheets of several presses at their pace, in one process. begun_s: Unix time of the first sheets. [s]

    A sheet's time is that at which it was recorded, so that its row says when it could have been shipped at first.
    """
    journals = [Journal.open(str(plan.journal), announce=lambda line: None) for plan in plans]
    runs = [
        journal.begin_run(run_facts(plan.name, sheets=plan.sheets, started_s=begun_s))
        for plan, journal in zip(plans, journals, strict=True)
    ]
    recorded = [0] * len(plans)
    ends_s = begun_s + plans[0].seconds
    while (now_s := time.time()) < ends_s:
        for at, (plan, journal, run) in enumerate(zip(plans, journals, runs, strict=True)):
            due = min(int((now_s - begun_s) * plan.sheets_per_s), plan.sheets)
            for number in range(recorded[at], due):
                journal.record(run, sheet(number, number / plan.sheets_per_s))
            recorded[at] = max(recorded[at], due)
            journal.commit()
        time.sleep(max(0.0, now_s + COMMIT_S - time.time()))
    for plan, journal, run, count in zip(plans, journals, runs, recorded, strict=True):
        for number in range(count, plan.sheets):
            journal.record(run, sheet(number, number / plan.sheets_per_s))
        journal.end_run(run, RunEnd(ended_s=time.time(), ending="finished"))
        for _ in range(100):  # a disk that was full a moment ago
            if journal.commit():
                break
            time.sleep(COMMIT_S)
        journal.close()


def ship(plans: list[PressPlan], url: str, down: Event | None = None) -> None:
    """Ship the journals of several presses, in one process, until it is terminated. down: set at the first failure."""
    threads, ended = [], threading.Event()
    for plan in plans:
        service = ShippingService(
            url=url,
            press=plan.name,
            plant=plan.plant,
            journal=plan.journal,
            pictures=None,
            announce=lambda line: None if down is None else down.set(),
        )
        threads.append(threading.Thread(target=service.run, args=(ended,), daemon=True))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def started(target: object, *arguments: object) -> BaseProcess:
    """Start a process, as a program of its own."""
    process = multiprocessing.get_context("spawn").Process(target=target, args=arguments, daemon=True)  # type: ignore[arg-type]
    process.start()
    return process


def run_facts(press: str, *, sheets: int, started_s: float) -> RunFacts:
    """Return what a journal states of a run of this press. started_s: Unix time. [s]"""
    return RunFacts(
        job="made-up",
        job_digest="",
        press=press,
        press_digest="0" * 64,
        detector="matched_filter",
        source="made-up",
        started_s=started_s,
        sheets=sheets,
    )
