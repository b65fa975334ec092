"""Load of browsers on a real inspection: verdicts with and without them in turn, CPU and memory of both processes."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy import stats

from prooflight.errors import RequestError
from prooflight_console.running import LOOPBACK, Listening, spawned
from prooflight_console.settings import ConsoleSettings
from prooflight_studies.console.listeners import Listeners
from prooflight_studies.console.serving import (
    cpu_s,
    free_port,
    megabytes,
    nothing,
    session,
    wait_until_it_answers,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

WINDOW_S, QUICK_WINDOW_S = 60.0, 10.0
SETTLES_S: Final = 3.0
"""Start of each window that is not counted: sheets of the window before are still judged."""
SAMPLED_S, QUICK_SAMPLED_S = 10.0, 2.0
"""Time between two samples of memory."""
BLOCKS: Final = 12
"""Number of parts whose mean memory gives the slope an interval, since successive samples are correlated."""
MISPRINT, EVERY = "spots-voids", 25
STARTS_S: Final = 1800.0
"""Time limit for printing the drum's sheets and preparing the first designs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadPlan:
    """Press, job and load of one measurement."""

    press: Path
    job: Path
    rate_hz: float
    minutes: float
    clients: int
    paired: bool
    """Whether windows with and without browsers alternate; otherwise browsers are connected all the time."""
    quick: bool


def measure_load(plan: LoadPlan, *, progress: Callable[[str], None]) -> dict[str, Any]:
    """Inspect under the load of browsers and measure; RequestError: the run did not begin."""
    window_s = QUICK_WINDOW_S if plan.quick else WINDOW_S
    sampled_s = QUICK_SAMPLED_S if plan.quick else SAMPLED_S
    seconds = 60 * plan.minutes
    with tempfile.TemporaryDirectory() as folder:
        settings = ConsoleSettings.of(Path(folder) / "runs.sqlite")
        secret, port = session(settings), free_port()
        console = spawned(settings, Listening(port=port), ready=nothing)
        watching = _Watching(plan, settings.journal, sheets=int(plan.rate_hz * (seconds + 60)))
        try:
            wait_until_it_answers(port)
            progress("printing for the drum, preparing")
            watching.wait()
            windows: list[dict[str, Any]] = []
            samples: list[dict[str, float]] = []
            begun_s = time.monotonic()
            pids = {"watch": watching.pid, "console": int(console.pid)}
            for at in range(max(round(seconds / window_s), 2)):
                watched = not plan.paired or at % 2 == 1
                left = f"{max(seconds - (time.monotonic() - begun_s), 0) / 60:.0f} minutes left"
                progress(f"window {at + 1}, {plan.clients if watched else 0} live pages; {left}")
                if watched:
                    with Listeners((LOOPBACK, port), session=secret, count=plan.clients):
                        windows.append(
                            _window(window_s, sampled_s, pids, samples, begun_s) | {"watched": True}
                        )
                else:
                    windows.append(_window(window_s, sampled_s, pids, samples, begun_s) | {"watched": False})
        finally:
            watching.end()
            console.terminate()
            console.join()
    return _figures(plan, windows, samples, watching.seen)


class _Watching:
    """``watch`` in a process of its own, whose verdicts are read as they are reported."""

    def __init__(self, plan: LoadPlan, journal: Path, *, sheets: int) -> None:
        command = [
            *(sys.executable, "-m", "prooflight", "watch", str(plan.job), "--press", str(plan.press)),
            *("--source", f"drum:{plan.rate_hz:g}", "--sheets", str(sheets), "--journal", str(journal)),
            *("--misprint", MISPRINT, "--every", str(EVERY), "--json"),
        ]
        self._process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8"
        )
        self.pid = self._process.pid
        self.seen: list[tuple[float, float | None, bool, str]] = []
        """Time at which each verdict was reported, its latency [ms], whether it was late, and the verdict."""
        self._first, self._said = threading.Event(), ""
        self._threads = [threading.Thread(target=one, daemon=True) for one in (self._read, self._hear)]
        for thread in self._threads:
            thread.start()

    def wait(self) -> None:
        """Wait for the first verdict; RequestError: there is none."""
        if not self._first.wait(STARTS_S) or not self.seen:
            raise RequestError(
                "watch", self._said.strip()[-400:] or "reported no verdict", remedy="run it alone"
            )

    def end(self) -> None:
        """Stop the process; sheets that have passed are still inspected."""
        if self._process.poll() is None:
            self._process.terminate()
        self._process.wait(60)
        for thread in self._threads:
            thread.join()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            try:
                message = json.loads(line)
            except ValueError:
                continue
            if isinstance(message, dict) and "latency_ms" in message:
                verdict = str(message.get("verdict"))
                self.seen.append(
                    (time.monotonic(), message["latency_ms"], bool(message.get("late")), verdict)
                )
                self._first.set()
        self._first.set()

    def _hear(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self._said = (self._said + line)[-4000:]


def _window(
    seconds: float, sampled_s: float, pids: dict[str, int], samples: list[dict[str, float]], begun_s: float
) -> dict[str, Any]:
    """Wait for ``seconds``, and sample memory meanwhile."""
    start_s, used = time.monotonic(), {name: cpu_s(pid) for name, pid in pids.items()}
    while (left_s := start_s + seconds - time.monotonic()) > 0:
        time.sleep(min(sampled_s, left_s))
        memory = {name: megabytes(pid) for name, pid in pids.items()}
        if all(one is not None for one in memory.values()):
            samples.append({"s": time.monotonic() - begun_s} | {k: float(v or 0) for k, v in memory.items()})
    end_s = time.monotonic()
    cpu = {
        f"{name}_percent": None
        if used[name] is None or (now := cpu_s(pid)) is None
        else 100 * (now - (used[name] or 0.0)) / (end_s - start_s)
        for name, pid in pids.items()
    }
    return {"from_s": start_s, "to_s": end_s, **cpu}


def _figures(
    plan: LoadPlan,
    windows: list[dict[str, Any]],
    samples: list[dict[str, float]],
    seen: Sequence[tuple[float, float | None, bool, str]],
) -> dict[str, Any]:
    """Return the figures of the page."""
    rows = []
    for one in windows:
        inside = [each for each in seen if one["from_s"] + SETTLES_S <= each[0] < one["to_s"]]
        waits = np.array([each[1] for each in inside if each[1] is not None])
        rows.append(
            {
                "watched": one["watched"],
                "sheets": len(inside),
                "late": sum(each[2] for each in inside),
                "not_inspected": sum(each[3] == "not-inspected" for each in inside),
                "median_ms": float(np.median(waits)) if waits.size else None,
                "p99_ms": float(np.quantile(waits, 0.99)) if waits.size else None,
                "greatest_ms": float(waits.max()) if waits.size else None,
                "watch_percent": one["watch_percent"],
                "console_percent": one["console_percent"],
            }
        )
    return {
        "press": plan.press.name,
        "job": plan.job.name,
        "rate_hz": plan.rate_hz,
        "minutes": plan.minutes,
        "clients": plan.clients,
        "quick": plan.quick,
        "windows": rows,
        "kinds": [_combined([row for row in rows if row["watched"] is kind], kind) for kind in (False, True)],
        "difference_ms": paired_difference(rows),
        "memory": {
            name: slope([one["s"] for one in samples], [one[name] for one in samples])
            for name in ("watch", "console")
        },
        "samples": len(samples),
    }


def _combined(rows: list[dict[str, Any]], watched: bool) -> dict[str, Any] | None:
    """Combine all windows of a kind; the median and 99 % are means over windows."""
    if not rows:
        return None

    def mean(name: str) -> float | None:
        values = [row[name] for row in rows if row[name] is not None]
        return float(np.mean(values)) if values else None

    counted = {name: sum(row[name] for row in rows) for name in ("sheets", "late", "not_inspected")}
    means = {name: mean(name) for name in ("median_ms", "p99_ms", "watch_percent", "console_percent")}
    greatest = max((row["greatest_ms"] for row in rows if row["greatest_ms"] is not None), default=None)
    return {"watched": watched, "windows": len(rows), **counted, **means, "greatest_ms": greatest}


def paired_difference(rows: list[dict[str, Any]]) -> dict[str, float] | None:
    """Return the median with browsers less that of the window before without, and its 95 % interval (t).

    None: there are too few pairs.
    """
    pairs = [
        after["median_ms"] - before["median_ms"]
        for before, after in zip(rows[::2], rows[1::2], strict=False)
        if after["watched"]
        and not before["watched"]
        and None not in (after["median_ms"], before["median_ms"])
    ]
    if len(pairs) < 2:
        return None
    mean, error = float(np.mean(pairs)), float(np.std(pairs, ddof=1) / np.sqrt(len(pairs)))
    wide = float(stats.t.ppf(0.975, len(pairs) - 1)) * error
    return {"mean": mean, "low": mean - wide, "high": mean + wide, "pairs": len(pairs)}


def slope(seconds: Sequence[float], values: Sequence[float]) -> dict[str, float] | None:
    """Return the slope of memory [MB/h] after the first tenth, from means of ``BLOCKS`` parts, with its 95 % interval.

    None: there are too few samples.
    """
    steady = [(s, v) for s, v in zip(seconds, values, strict=True) if s >= 0.1 * seconds[-1]]
    if len(steady) < BLOCKS:
        return None
    parts = np.array_split(np.array(steady), BLOCKS)
    x, y = (np.array([part[:, k].mean() for part in parts]) for k in (0, 1))
    fit = stats.linregress(x / 3600, y)
    wide = float(stats.t.ppf(0.975, BLOCKS - 2) * fit.stderr)
    return {
        "mb_per_h": float(fit.slope),
        "low": float(fit.slope) - wide,
        "high": float(fit.slope) + wide,
        "first_mb": float(values[0]),
        "last_mb": float(values[-1]),
        "most_mb": float(max(values)),
    }
