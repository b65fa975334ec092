"""Runs of ``prooflight watch`` as a user starts it: in a process of its own, all options at their defaults."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.simulation.misprints.kinds import KINDS
from prooflight_line.run.status import Phase

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

STEP_PER_S: Final = 0.5
"""Difference of rates to which the highest sustained rate is found. [pages/s]"""
FASTEST_PER_S: Final = 16.0
"""Highest rate that is tried. [pages/s]"""
CACHES: Final = {"XDG_CACHE_HOME": "cache", "XDG_STATE_HOME": "state", "NUMBA_CACHE_DIR": "kernels"}
"""Variables that name the folders of what runs leave for later ones, and these folders."""
COMPLETED: Final = (0, 1, 3, 5)
"""Exit codes of a run that went on to its end: good, a misprint, sheets not inspected, overload."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Installation:
    """The program with caches of its own, which are empty where nothing was run yet."""

    folder: Path

    def run(self, *arguments: str | Path) -> Iterable[Mapping[str, Any]]:
        """Run a command of the program, and yield what it prints as JSON; RuntimeError if it fails."""
        environment = os.environ | {name: str(self.folder / each) for name, each in CACHES.items()}
        command = [sys.executable, "-m", "prooflight", *map(str, arguments)]
        with tempfile.TemporaryFile("w+") as errors:
            with subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment
            ) as process:
                assert process.stdout is not None
                for line in process.stdout:
                    if line.startswith("{"):
                        yield json.loads(line)
            if process.returncode not in COMPLETED:
                errors.seek(0)
                raise RuntimeError(f"{' '.join(command)} exits {process.returncode}: {errors.read()[-2000:]}")

    def prepare(self, job: Path, press: Path) -> None:
        """Prepare a job, as `prooflight job prepare` does."""
        for _ in self.run("job", "prepare", job, "--press", press):
            pass

    def watch(
        self, job: Path, press: Path, *, pages_per_s: float, sheets: int, seed: int, misprints: bool = False
    ) -> dict[str, Any]:
        """Return the figures of one run of `prooflight watch` on the simulated drum.

        misprints: whether every tenth print is a misprint, of all kinds in turn.
        """
        begun_s = time.perf_counter()
        source = ["--source", f"drum:{pages_per_s:g}", "--sheets", str(sheets), "--seed", str(seed)]
        if misprints:
            source += ["--misprint", ",".join(KINDS)]
        ready_s, lines = math.nan, []
        for line in self.run("watch", job, "--press", press, *source, "--json"):
            if line.get("phase") == Phase.INSPECTING:
                ready_s = time.perf_counter() - begun_s
            if "verdict" in line:
                lines.append(line)
        return {
            "asked_pages_per_s": pages_per_s,
            "ready_s": round(ready_s, 1),
            **counted(lines, sheets=sheets),
        }


def counted(lines: Iterable[Mapping[str, Any]], *, sheets: int) -> dict[str, Any]:
    """Count what the lines of a run, one a sheet, report of ``sheets`` sheets that should pass.

    Sheets of which nothing was reported are not inspected either, for the reason "no verdict".
    """
    lines = list(lines)
    reasons = Counter(str(line["reason"]) for line in lines if line["verdict"] == "not-inspected")
    if lacking := sheets - len(lines):
        reasons["no verdict"] = lacking
    latencies = [line["latency_ms"] for line in lines if line.get("latency_ms") is not None]
    return {
        "sheets": sheets,
        "late": sum(bool(line["late"]) for line in lines),
        "misprints": sum(line["verdict"] == "misprint" for line in lines),
        "misprints_late": sum(line["verdict"] == "misprint" and bool(line["late"]) for line in lines),
        "not_inspected": reasons.total(),
        "reasons": dict(reasons.most_common()),
        "median_ms": round(float(np.median(latencies))) if latencies else None,
        "greatest_ms": round(max(latencies)) if latencies else None,
    }


def sustained(row: Mapping[str, Any]) -> bool:
    """Return whether each sheet of a run was inspected, and in time."""
    return not row["late"] and not row["not_inspected"]


def highest_sustained(sustains: Callable[[float], bool]) -> float:
    """Return the highest rate that ``sustains`` confirms, by bisection in steps; 0 if not even one step. [pages/s]"""
    low, high = 0, round(FASTEST_PER_S / STEP_PER_S) + 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if sustains(middle * STEP_PER_S) else (low, middle)
    return low * STEP_PER_S


@dataclass(frozen=True, slots=True, kw_only=True)
class StartedRun:
    """One job on one press, as a user starts it."""

    name: str
    job: Path
    press: Path
    sensors: int
    pages: int
    """Number of the job's pages."""
    pages_per_s: float
    """Required rate."""
    prepared: bool = False
    """Whether `job prepare` precedes the first run."""

    def rows(
        self, folder: Path, *, sheets: int, trial_s: float, seed: int, progress: Callable[[str], None]
    ) -> list[dict[str, Any]]:
        """Return rows of the first run after installation, the next with the highest rate, and one with misprints.

        sheets: of the first two; the third has a fifth of them. trial_s: duration of each run of the bisection, which
        has no more sheets than these.
        """
        facts = {"name": self.name, "sensors": self.sensors, "pages": self.pages, "prepared": self.prepared}
        rows = []
        with tempfile.TemporaryDirectory(dir=folder) as empty:
            installation = Installation(folder=Path(empty))

            def run(rate: float, count: int, *, misprints: bool = False) -> dict[str, Any]:
                row = installation.watch(
                    self.job, self.press, pages_per_s=rate, sheets=count, seed=seed, misprints=misprints
                )
                progress(f"{self.name}: {json.dumps(row)}")
                return row

            if self.prepared:
                installation.prepare(self.job, self.press)
            for caches in ("cold", "warm"):
                rows.append(
                    facts | {"caches": caches, "highest_pages_per_s": None} | run(self.pages_per_s, sheets)
                )
            rows[-1]["highest_pages_per_s"] = highest_sustained(
                lambda rate: sustained(run(rate, min(math.ceil(rate * trial_s), sheets)))
            )
            wrong = facts | {"name": f"{self.name}, a tenth misprints"}
            few = run(self.pages_per_s, max(sheets // 5, 1), misprints=True)
            rows.append(wrong | {"caches": "warm", "highest_pages_per_s": None} | few)
        return rows
