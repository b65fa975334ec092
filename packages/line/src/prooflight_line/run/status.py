"""Status of a run: a frozen snapshot of counts, times and queues, from which alone displays are made."""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

STAGES: Final = ("prepare", "queue", "inspect", "verdict")
"""Stages: preparing a design ahead of its sheets; waiting; inspecting; and from a sheet's last line to its
verdict."""
FINEST_S: Final = 1e-4
STEP: Final = 1.02
"""Ratio of successive bins: times are known to 2 %."""
BINS: Final = 700
RATE_PAGES: Final = 32


COUNTED: Final = (
    *("pages_seen", "good", "misprints", "late", "not_inspected", "missing", "absent", "to_come", "untold"),
    *(
        "announcements",
        "promise_suspended",
        "being_inspected",
        "out_of_time",
        "overloads",
        "unvouched",
        "rehearsed",
    ),
)
"""Fields of ``Status`` that a ``Tally`` counts, by the same names."""
VERDICTS: Final = {"good": "good", "misprint": "misprints", "not-inspected": "not_inspected"}
"""Count to which each verdict belongs."""


class Phase(StrEnum):
    """Phases: waiting -> preparing -> inspecting -> draining -> stopped; fault: the source or journal failed."""

    WAITING = "waiting"
    PREPARING = "preparing"
    INSPECTING = "inspecting"
    DRAINING = "draining"
    STOPPED = "stopped"
    FAULT = "fault"


@dataclass(frozen=True, slots=True, kw_only=True)
class StageTime:
    """Distribution of a stage's times so far."""

    count: int
    median_ms: float
    p99_ms: float
    p999_ms: float
    greatest_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Snapshot of a run."""

    phase: Phase
    detail: str
    """Description of the failure, in the phase ``fault``."""
    pages_seen: int
    """Number of sheets that passed under the camera."""
    good: int
    misprints: int
    late: int
    """Verdicts after their deadline; they count as good or misprints as well."""
    not_inspected: int
    """Sheets that passed without a verdict, for whatever reason."""
    missing: int
    """Pages of the job that did not come, counted when pages after them had; they may have come later."""
    absent: int
    """Pages of the job that had not come when the lines ended; 0 before."""
    to_come: int
    """Those of them after the furthest that came: 0 unless the lines ended too early."""
    untold: int
    """Sheets whose outcome was lost on its way to the journal or to whoever watches."""
    faults: Mapping[str, int]
    """Faults of the paper path, by kind."""
    announcements: int
    promise_suspended: int
    """Sheets, and pages that did not come, since the run showed that the false-alarm rate does not hold."""
    out_of_time: int
    """Sheets that were not inspected because inspection did not keep pace."""
    unvouched: int
    """Sheets without a fault of the print that are held nevertheless: lines were lost, or they came out of
    place."""
    overloads: int
    overloaded: bool
    """Whether an overload alarm is active."""
    queue_depth: int
    being_inspected: int
    ahead: int
    """Number of designs that are ready."""
    to_prepare: int
    """Number of designs that are prepared before the first line is read, if memory holds them."""
    to_rehearse: int
    """Number of designs with which inspection is rehearsed after that."""
    rehearsed: int
    """Number of designs of ``to_rehearse`` that are done."""
    journalled: int
    """Number of pages that are durable."""
    pages_per_s: float
    """Rate of the last pages."""
    elapsed_s: float
    stages: Mapping[str, StageTime]


class Times:
    """Histogram of times in bins 2 % wide, from 0.1 ms to 100 s: its memory does not grow."""

    def __init__(self) -> None:
        self._counts = np.zeros(BINS, np.int64)
        self._greatest_s = 0.0
        self.median_s = 0.0
        """Median of all times, 0 before any came; kept because it is read with every block of lines."""

    def add(self, seconds: float) -> None:
        """Add one time."""
        at = int(np.log(max(seconds, FINEST_S) / FINEST_S) / np.log(STEP))
        self._counts[min(at, BINS - 1)] += 1
        self._greatest_s = max(self._greatest_s, seconds)
        self.median_s = self.quantile_s(0.5)

    def quantile_s(self, share: float) -> float:
        """Return the time that this share of all times stayed below; 0 before any came."""
        total = int(self._counts.sum())
        if not total:
            return 0.0
        at = int(np.searchsorted(np.cumsum(self._counts), share * total))
        return min(FINEST_S * STEP ** (at + 1), self._greatest_s)

    def stage(self) -> StageTime:
        """Return the summary of the times."""
        median, p99, p999 = (round(1e3 * self.quantile_s(share), 2) for share in (0.5, 0.99, 0.999))
        return StageTime(
            count=int(self._counts.sum()),
            median_ms=median,
            p99_ms=p99,
            p999_ms=p999,
            greatest_ms=round(1e3 * self._greatest_s, 2),
        )


@dataclass(slots=True)
class Tally:
    """Running counts of a run; safe to update from several threads."""

    phase: Phase = Phase.WAITING
    detail: str = ""
    to_prepare: int = 0
    to_rehearse: int = 0
    overloaded: bool = False
    counts: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    times: dict[str, Times] = field(default_factory=lambda: {name: Times() for name in STAGES})
    arrivals_s: list[float] = field(default_factory=list)
    guard: threading.Lock = field(default_factory=threading.Lock)

    def count(self, name: str, *, by: int = 1) -> None:
        """Add to a count."""
        with self.guard:
            self.counts[name] += by

    def arrived(self, time_s: float, faults: list[str]) -> None:
        """Count a sheet, its faults and its time of arrival."""
        with self.guard:
            self.counts["pages_seen"] += 1
            self.faults.update(faults)
            self.arrivals_s = [*self.arrivals_s[1 - RATE_PAGES :], time_s]

    def took(self, stage: str, seconds: float) -> None:
        """Add the time of a stage."""
        with self.guard:
            self.times[stage].add(seconds)

    def typical_s(self, stage: str) -> float:
        """Return the median time of a stage so far."""
        with self.guard:
            return self.times[stage].median_s

    def snapshot(self, *, queue_depth: int, ahead: int, journalled: int, elapsed_s: float) -> Status:
        """Return a snapshot."""
        with self.guard:
            span_s = self.arrivals_s[-1] - self.arrivals_s[0] if len(self.arrivals_s) > 1 else 0.0
            return Status(
                phase=self.phase,
                detail=self.detail,
                overloaded=self.overloaded,
                faults=dict(self.faults),
                queue_depth=queue_depth,
                ahead=ahead,
                to_prepare=self.to_prepare,
                to_rehearse=self.to_rehearse,
                journalled=journalled,
                pages_per_s=(len(self.arrivals_s) - 1) / span_s if span_s > 0 else 0.0,
                elapsed_s=elapsed_s,
                stages={name: times.stage() for name, times in self.times.items()},
                **{name: self.counts[name] for name in COUNTED},
            )
