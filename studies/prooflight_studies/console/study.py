"""Delay from a verdict to its display: sheets are recorded as by a press, and many clients watch."""

from __future__ import annotations

import math
import os
import tempfile
import time
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.cmyk import INK_NAMES
from prooflight.detectors.verdict import Region, Verdict
from prooflight.errors import RequestError
from prooflight_console.running import LOOPBACK, Listening, spawned
from prooflight_console.settings import ConsoleSettings
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import PageRecord, RunFacts
from prooflight_line.run.recording import COMMIT_S, Recorder
from prooflight_studies.console.alongside import LoadPlan, measure_load
from prooflight_studies.console.journeys import measure_journeys
from prooflight_studies.console.listeners import Listeners, Windows
from prooflight_studies.console.loads import measure_loads
from prooflight_studies.console.searches import measure_searches
from prooflight_studies.console.serving import (
    cpu_s,
    free_port,
    megabytes,
    nothing,
    session,
    wait_until_it_answers,
)
from prooflight_studies.harness.page import stored_results, write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PARTS: Final = ("live", "browsers", "beside", "hour", "pages", "journeys", "search")
RATE_HZ: Final = 5.0
"""Sheets a second, the rate of the paper's press."""
ALONE_S, WATCHED_S = 30.0, 150.0
QUICK_S: Final = 8.0
CLIENTS, QUICK_CLIENTS = 50, 8
BROWSERS_S: Final = 60.0
BROWSERS, PAGES, QUICK_BROWSERS, QUICK_PAGES = 5, 10, 1, 2
"""Number of browsers, and of pages in each."""
FIRST_ALARM: Final = 40
"""Index in the watched part of the first misprint; then one in ``ALARM_EVERY``."""
ALARM_EVERY: Final = 25
ALARM_S: Final = 1.0
"""Required bound on the delay from a verdict to its alarm."""
AFTER_S: Final = 3.0
"""Time after the last sheet for messages that are still on their way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """Load of the console's process in one part of the study."""

    seconds: float
    cpu_percent: float | None
    """CPU load, of one core; None: this system does not report it."""
    first_mb: float | None
    last_mb: float | None
    """Memory at the beginning and end of the part."""
    sheets: int
    record_ms: float
    """Longest time that the inspection waited to hand a sheet to the journal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """Delay from a verdict to one kind of client."""

    who: str
    sheets: int
    missing: int
    """Number of sheets that never arrived."""
    median_s: float
    p99_s: float
    greatest_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsoleFigures:
    """Results of the live part."""

    alone: Load
    watched: Load
    clients: int
    connected: int
    lost: tuple[str, ...]
    delays: tuple[Delay, ...]
    alarm_s: float | None
    """Delay from the first misprint's verdict on the screen; None: no browser is installed."""
    cores: int
    load: float
    """Load of the machine, a core, when the study began: above 0.5 other programs were running."""


def run_console_study(
    results: Path,
    *,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
) -> ConsoleFigures:
    """Serve, record sheets, connect clients and measure; writes ``console.md``."""
    load = os.getloadavg()[0] / (os.cpu_count() or 1)
    alone_s, watched_s = (QUICK_S, QUICK_S * 2) if quick else (ALONE_S, WATCHED_S)
    clients = QUICK_CLIENTS if quick else CLIENTS
    progress("starting the console")
    with _followed_press(alone_s + watched_s) as (press, port, secret):
        progress(f"{alone_s:.0f} s without clients")
        alone = press.go_on(alone_s, alarms=False)
        progress(f"{clients} live pages and a browser open")
        with (
            Windows(f"http://{LOOPBACK}:{port}", secret) as window,
            Listeners((LOOPBACK, port), session=secret, count=clients) as listeners,
        ):
            progress(f"{watched_s:.0f} s with {clients} live pages")
            watched = press.go_on(watched_s, alarms=True)
            time.sleep(AFTER_S)
    verdict_times = {number: at for number, at in press.verdict_times.items() if number >= alone.sheets}
    everybody = [(number, at) for number, times in listeners.seen.items() for at in times]
    delays = [_delay("live pages", verdict_times, everybody, times=clients)]
    alarm_s = None
    if window.seen:
        delays.append(_delay("browser", verdict_times, _drawn(window), times=1))
        alarm_s = _alarm_s(window, verdict_times[alone.sheets + FIRST_ALARM])
    figures = ConsoleFigures(
        alone=alone,
        watched=watched,
        clients=clients,
        connected=listeners.connected,
        lost=tuple(listeners.lost),
        delays=tuple(delays),
        alarm_s=alarm_s,
        cores=os.cpu_count() or 1,
        load=load,
    )
    stated: dict[str, Any] = {"rate_hz": RATE_HZ, "commit_s": COMMIT_S, "quick": quick, "bound_s": ALARM_S}
    stated["alarm_every"] = ALARM_EVERY
    write_page(
        results / "console.md", "console", stored_results(results / "console.md") | asdict(figures) | stated
    )
    return figures


def measure_browsers(*, quick: bool, progress: Callable[[str], None]) -> dict[str, Any]:
    """Measure the delay from a verdict to the frame in many pages of real browsers. RequestError: none is installed."""
    browsers, pages = (QUICK_BROWSERS, QUICK_PAGES) if quick else (BROWSERS, PAGES)
    seconds = 2 * QUICK_S if quick else BROWSERS_S
    progress("starting the console")
    with _followed_press(seconds) as (press, port, secret):
        progress(f"{browsers} browsers with {pages} pages each open")
        with Windows(f"http://{LOOPBACK}:{port}", secret, browsers=browsers, pages=pages) as windows:
            if not windows.is_installed:
                remedy = "apt install chromium"
                raise RequestError(
                    "--part browsers", "Chromium or Playwright is not installed", remedy=remedy
                )
            progress(f"{seconds:.0f} s with {browsers * pages} pages")
            load = press.go_on(seconds, alarms=True)
            time.sleep(AFTER_S)
    delay = _delay("browser", press.verdict_times, _drawn(windows), times=browsers * pages)
    return {
        "browsers": browsers,
        "pages": pages,
        "seconds": seconds,
        "delay": asdict(delay),
        "console": asdict(load),
        "alarm_s": _alarm_s(windows, press.verdict_times[FIRST_ALARM]),
        "bound_s": ALARM_S,
        "quick": quick,
    }


def run_console_part(
    results: Path,
    part: str,
    *,
    plan: LoadPlan | None,
    quick: bool,
    progress: Callable[[str], None],
    seed: int = 0,
) -> dict[str, Any]:
    """Measure ``browsers``, ``beside``, ``hour``, ``pages``, ``journeys`` or ``search`` and keep the others.

    plan: what is measured in ``beside`` and ``hour``; None for the others. seed: of ``journeys``.
    RequestError: the rest was never measured.
    """
    stored = stored_results(results / "console.md")
    if "alone" not in stored:
        remedy = "run `prooflight study console` first"
        raise RequestError(results / "console.json", "holds no figures of live pages", remedy=remedy)
    if plan is not None:
        figures = measure_load(plan, progress=progress)
    elif part == "browsers":
        figures = measure_browsers(quick=quick, progress=progress)
    elif part == "search":
        figures = measure_searches(quick=quick, progress=progress)
    else:
        measure = partial(measure_journeys, seed=seed) if part == "journeys" else measure_loads
        figures = measure(
            lambda sheet, alarm: _sheet(sheet, alarm=alarm), _facts, quick=quick, progress=progress
        )
    cores = os.cpu_count() or 1
    figures |= {"cores": cores, "load": os.getloadavg()[0] / cores}
    write_page(results / "console.md", "console", stored | {part: figures})
    return figures


@contextmanager
def _followed_press(seconds: float) -> Iterator[tuple[_Press, int, str]]:
    """Serve a console that follows a press; gives the press, the console's port, and a session of a viewer."""
    with tempfile.TemporaryDirectory() as folder:
        settings = ConsoleSettings.of(Path(folder) / "runs.sqlite")
        secret, port = session(settings), free_port()
        process = spawned(settings, Listening(port=port), ready=nothing)
        try:
            wait_until_it_answers(port)
            with Journal.open(str(settings.journal)) as journal:
                run = journal.begin_run(_facts(int(RATE_HZ * seconds)))
                with Recorder(journal, run) as recorder:
                    yield _Press(recorder, pid=int(process.pid)), port, secret
        finally:
            process.terminate()
            process.join()


class _Press:
    """Recorder of sheets at a press's rate, which notes their times."""

    def __init__(self, recorder: Recorder, *, pid: int) -> None:
        self._recorder, self._pid = recorder, pid
        self._number = 0
        self.verdict_times: dict[int, float] = {}
        """Time of each verdict; Unix time. [s]"""

    def go_on(self, seconds: float, *, alarms: bool) -> Load:
        """Record sheets for ``seconds``."""
        count = int(seconds * RATE_HZ)
        begun, used, memory = time.monotonic(), cpu_s(self._pid), megabytes(self._pid)
        longest = 0.0
        for at in range(count):
            time.sleep(max(begun + at / RATE_HZ - time.monotonic(), 0.0))
            alarm = alarms and at >= FIRST_ALARM and (at - FIRST_ALARM) % ALARM_EVERY == 0
            page = _sheet(self._number, alarm=alarm)
            self.verdict_times[self._number] = time.time()
            before = time.monotonic()
            self._recorder.record(page)
            longest = max(longest, time.monotonic() - before)
            self._number += 1
        took, used_then = time.monotonic() - begun, cpu_s(self._pid)
        cpu = None if used is None or used_then is None else 100 * (used_then - used) / took
        return Load(
            seconds=took,
            cpu_percent=cpu,
            first_mb=memory,
            last_mb=megabytes(self._pid),
            sheets=count,
            record_ms=1000 * longest,
        )


def _drawn(windows: Windows) -> list[tuple[int, float]]:
    """Return number and time of each sheet that was drawn, in every page."""
    return [(number, at) for seen in windows.seen for number, at in seen.items() if isinstance(number, int)]


def _alarm_s(windows: Windows, verdict_s: float) -> float | None:
    """Return the delay of the alarm in the last of all pages; None: a page did not show it."""
    if not all("alarm" in seen for seen in windows.seen):
        return None
    return max(seen["alarm"] for seen in windows.seen) - verdict_s


def _delay(who: str, verdict_times: dict[int, float], seen: list[tuple[int, float]], *, times: int) -> Delay:
    waited = np.array([at - verdict_times[number] for number, at in seen if number in verdict_times])
    if not waited.size:
        waited = np.array([np.inf])
    return Delay(
        who=who,
        sheets=len(verdict_times),
        missing=times * len(verdict_times) - sum(number in verdict_times for number, _ in seen),
        median_s=float(np.median(waited)),
        p99_s=float(np.quantile(waited, 0.99)),
        greatest_s=float(waited.max()),
    )


def _sheet(number: int, *, alarm: bool) -> PageRecord:
    """Return a record as long as a real one's; no sheet was inspected."""
    names = ("gain", "register-x", "register-y")
    nuisance = {f"{name}-{ink}": 0.02 * math.sin(number) for name in names for ink in INK_NAMES}
    verdict = Verdict(
        page=f"p{number % 24 + 1:04}",
        verdict="good",
        score=-1.0,
        threshold=1.0,
        milliseconds=100.0,
        detector="matched_filter",
    )
    page = PageRecord(
        sheet=number,
        job_page=number,
        verdict=verdict,
        late=False,
        first_line=3000 * number,
        time_s=number / RATE_HZ,
        nuisance=nuisance,
    )
    if not alarm:
        return page
    spot = Region(x_mm=60.0, y_mm=80.0, width_mm=3.0, height_mm=3.0, score=9.0, kind="spots-voids")
    bad = replace(verdict, verdict="misprint", kind="spots-voids", regions=(spot,), score=8.0)
    cut = (np.arange(2 * 200 * 200, dtype=np.uint32) * (number + 7) % 4096).astype(np.uint16)
    evidence = {"cut0": cut.reshape(2, 200, 200), "cut0_mm": np.array([50.0, 70.0, 21.0, 21.0])}
    return replace(page, verdict=bad, evidence=evidence)


def _facts(sheets: int) -> RunFacts:
    return RunFacts(
        job="made-up",
        job_digest="",
        press="none",
        press_digest="0" * 64,
        detector="matched_filter",
        source="made-up",
        started_s=time.time(),
        sheets=sheets,
    )
