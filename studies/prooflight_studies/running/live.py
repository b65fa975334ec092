"""Measurements of the running press: in real time, and at full speed."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.pages.process import settle_process
from prooflight.simulation.drum import Drum, turns
from prooflight_line.run.settings import Settings
from prooflight_line.run.watching import watched

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from prooflight.inspection.inspector import Inspector
    from prooflight.scans.lines import LineBlock, LineSource
    from prooflight_line.run.outcomes import Outcome
    from prooflight_studies.running.rig import Ring

EARLY_SHEET: Final = 100
"""Sheet at which memory is read first."""
ORDER: Final = frozenset(("missing", "repeated", "out-of-order"))
"""Faults that a print of another page of the job has: it is that page, in the wrong place."""


@dataclass(slots=True)
class Watcher:
    """Observer of a run."""

    progress: Callable[[int], None]
    early_mb: tuple[int, int] = (0, 0)
    outcomes: list[tuple[int | None, str, tuple[str, ...], bool]] = field(default_factory=list)
    """Job page, verdict, faults, and whether it came, of every sheet."""
    late: list[tuple[int, int]] = field(default_factory=list)
    """Index of each late sheet, counted from 1, and the delay of its verdict after its last line. [ms]"""

    def observe(self, outcome: Outcome) -> None:
        """Record one sheet."""
        record = outcome.record
        self.outcomes.append((record.job_page, record.verdict.verdict, record.faults, outcome.came))
        if record.late and outcome.latency_s is not None:
            self.late.append((len(self.outcomes), round(1000 * outcome.latency_s)))
        if len(self.outcomes) == EARLY_SHEET:
            self.early_mb = memory_mb()
        self.progress(len(self.outcomes))


class Metered:
    """A source that measures its cost: the drum's processor time, separate from the inspection's."""

    def __init__(self, source: LineSource) -> None:
        self.sensors, self.pixels = source.sensors, source.pixels
        self.busy_s = 0.0
        self._source = source

    def blocks(self) -> Iterator[LineBlock]:
        """Yield the blocks of the source."""
        blocks = self._source.blocks()
        while True:
            begun_s = time.thread_time()
            block = next(blocks, None)
            self.busy_s += time.thread_time() - begun_s
            if block is None:
                return
            yield block

    def close(self) -> None:
        """Close the source."""
        self._source.close()


def live_row(
    name: str,
    inspector: Inspector,
    ring: Ring,
    *,
    pages_per_s: float | None,
    inspectors: int,
    progress: Callable[[int], None],
) -> dict[str, Any]:
    """Return the row of one run of the drum; pages_per_s None: as fast as sheets are taken."""
    press, watcher = inspector.press, Watcher(progress=progress)
    drum = Metered(Drum(ring.scans, press=press, passing=turns(ring.sheets, {}), pages_per_s=pages_per_s))
    waits = pages_per_s is None
    settings = Settings(source_waits=waits, source_clock=True, inspectors=inspectors)
    settle_process()
    running = watched(inspector, source=drum, page_store=ring, settings=settings, tell=watcher.observe)
    running.start()
    while running.status().phase in ("waiting", "preparing"):
        running.join(0.05)
    begun_s, cpu_s = time.perf_counter(), time.process_time()
    running.join()
    elapsed_s, status = time.perf_counter() - begun_s, running.status()
    if status.phase == "fault":
        raise RuntimeError(status.detail)
    verdict = status.stages["verdict"]
    return {
        "name": name,
        "detector": inspector.detector.name,
        "promise": inspector.guarantee,
        "sensors": len(press.sensors),
        "designs": len(ring.pages) if ring.repeated else ring.sheets,
        "prints": len(ring.scans),
        "sheets": status.pages_seen,
        "asked_pages_per_s": pages_per_s,
        "pages_per_s": round(status.pages_seen / elapsed_s, 3),
        "late": status.late,
        "late_sheets": watcher.late,
        "not_inspected": status.not_inspected,
        "misprints": status.misprints,
        **_caught(watcher.outcomes, ring),
        "fringes": press.fringes,
        "faults": dict(status.faults),
        "verdict_ms": {
            "median": verdict.median_ms,
            "p99": verdict.p99_ms,
            "p99.9": verdict.p999_ms,
            "greatest": verdict.greatest_ms,
        },
        "stages_ms": {stage: times.median_ms for stage, times in status.stages.items()},
        "prepared": status.stages["prepare"].count,
        "memory_mb": {str(EARLY_SHEET): watcher.early_mb, "end": memory_mb()},
        "cpu_s_a_page": round((time.process_time() - cpu_s - drum.busy_s) / max(status.pages_seen, 1), 4),
        "drum_cpu_s_a_page": round(drum.busy_s / max(status.pages_seen, 1), 5),
        "cores": os.cpu_count(),
    }


def _caught(outcomes: Sequence[tuple[int | None, str, tuple[str, ...], bool]], ring: Ring) -> dict[str, Any]:
    """Count the good prints and misprints played, the sheets of each that alarmed, and the prints that did."""
    outcomes = [one for one in outcomes if one[3]]  # a page that did not come was not played
    wrong = np.array([ring.is_wrong(sheet) for sheet in range(len(outcomes))], bool)
    alarm = np.array([verdict == "misprint" for _, verdict, _, _ in outcomes], bool)
    named = np.array([bool(ORDER & set(kinds)) for _, _, kinds, _ in outcomes], bool)
    of_print = np.arange(len(outcomes)) % len(ring.scans)
    return {
        "good_prints": int(np.unique(of_print[~wrong]).size),
        "wrong_prints": int(np.unique(of_print[wrong]).size),
        "false_alarms": int((alarm & ~wrong).sum()),
        "good_sheets": int((~wrong).sum()),
        "caught": int((alarm & wrong).sum()),
        "wrong_sheets": int(wrong.sum()),
        "good_prints_that_alarm": int(np.unique(of_print[alarm & ~wrong]).size),
        "wrong_prints_named": int(np.unique(of_print[~alarm & named & wrong]).size),
        "wrong_prints_caught": int(np.unique(of_print[alarm & wrong]).size),
    }


def memory_mb() -> tuple[int, int]:
    """Return the memory of this process: its own, and that of files (the ring's pages). [1e6 bytes]

    Both are 0 where the system does not report it.
    """
    try:
        rows = dict(row.split(":", 1) for row in Path("/proc/self/status").read_text().splitlines())
    except OSError:
        return 0, 0
    own, files = (round(int(rows[name].split()[0]) * 1024 / 1e6) for name in ("RssAnon", "RssFile"))
    return own, files
