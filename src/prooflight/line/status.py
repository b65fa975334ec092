"""How a run goes: a frozen snapshot of counts, times and queues; what is shown is made of nothing else."""

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
"""Preparing a design ahead of its sheets; waiting; inspecting; and from a sheet's last line to its verdict."""
FINEST_S: Final = 1e-4
STEP: Final = 1.02
"""Times are known to 2 %."""
BINS: Final = 700
RATE_PAGES: Final = 32


COUNTED: Final = (
    *("pages_seen", "good", "misprints", "late", "not_inspected", "missing", "absent", "to_come", "untold"),
    *("announcements", "promise_suspended", "being_inspected", "out_of_time", "overloads", "unvouched"),
)
"""What of ``Status`` a ``Tally`` counts, by the same names."""
VERDICTS: Final = {"good": "good", "misprint": "misprints", "not-inspected": "not_inspected"}
"""As what a verdict is counted."""


class Phase(StrEnum):
    """waiting -> preparing -> inspecting -> draining -> stopped; fault: the source or the journal broke off."""

    WAITING = "waiting"
    PREPARING = "preparing"
    INSPECTING = "inspecting"
    DRAINING = "draining"
    STOPPED = "stopped"
    FAULT = "fault"


@dataclass(frozen=True, slots=True, kw_only=True)
class StageTime:
    """How long a stage took so far."""

    count: int
    median_ms: float
    p99_ms: float
    p999_ms: float
    greatest_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """A run at one moment."""

    phase: Phase
    detail: str
    """What went wrong, in the phase ``fault``."""
    pages_seen: int
    """Sheets that passed under the camera."""
    good: int
    misprints: int
    late: int
    """Decided after their deadline; they count as good or misprints as well."""
    not_inspected: int
    """Passed without a verdict, for whatever reason."""
    missing: int
    """Pages of the job that did not come, said when pages behind them had; they may have come later."""
    absent: int
    """Pages of the job that had not come when the lines ended; 0 before."""
    to_come: int
    """Those of them behind the furthest that came: 0 unless the lines ended too early."""
    untold: int
    """Sheets whose outcome was lost on its way to the journal or to whoever watches."""
    faults: Mapping[str, int]
    """Of the paper path, by kind."""
    announcements: int
    promise_suspended: int
    """Sheets, and pages that did not come, since the run showed that the detector's promise does not hold."""
    out_of_time: int
    """Sheets that were not inspected because inspection did not keep pace."""
    unvouched: int
    """Sheets without a fault of the print that are held all the same: lines were lost, or they came out of place."""
    overloads: int
    """How often the alarm began that inspection does not keep pace."""
    overloaded: bool
    """Whether it lasts."""
    queue_depth: int
    being_inspected: int
    ahead: int
    """Designs that are ready."""
    to_prepare: int
    """Designs that are made ready before the first line is read, if memory holds them."""
    journalled: int
    """Pages that are durable."""
    pages_per_s: float
    """Of the last pages."""
    elapsed_s: float
    stages: Mapping[str, StageTime]


class Times:
    """Times in bins 2 % wide, from a tenth of a millisecond to a hundred seconds: its size does not grow."""

    def __init__(self) -> None:
        self._counts = np.zeros(BINS, np.int64)
        self._greatest_s = 0.0

    def add(self, seconds: float) -> None:
        """One time."""
        at = int(np.log(max(seconds, FINEST_S) / FINEST_S) / np.log(STEP))
        self._counts[min(at, BINS - 1)] += 1
        self._greatest_s = max(self._greatest_s, seconds)

    def quantile_s(self, share: float) -> float:
        """The time that this share of all stayed below; 0 before any came."""
        total = int(self._counts.sum())
        if not total:
            return 0.0
        at = int(np.searchsorted(np.cumsum(self._counts), share * total))
        return min(FINEST_S * STEP ** (at + 1), self._greatest_s)

    def stage(self) -> StageTime:
        """As people want it."""
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
    """Counts as they come in; may be added to from several threads."""

    phase: Phase = Phase.WAITING
    detail: str = ""
    to_prepare: int = 0
    overloaded: bool = False
    counts: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    times: dict[str, Times] = field(default_factory=lambda: {name: Times() for name in STAGES})
    arrivals_s: list[float] = field(default_factory=list)
    guard: threading.Lock = field(default_factory=threading.Lock)

    def count(self, name: str, *, by: int = 1) -> None:
        """Something happened."""
        with self.guard:
            self.counts[name] += by

    def arrived(self, time_s: float, faults: list[str]) -> None:
        """A sheet came."""
        with self.guard:
            self.counts["pages_seen"] += 1
            self.faults.update(faults)
            self.arrivals_s = [*self.arrivals_s[1 - RATE_PAGES :], time_s]

    def took(self, stage: str, seconds: float) -> None:
        """A stage was gone through."""
        with self.guard:
            self.times[stage].add(seconds)

    def typical_s(self, stage: str) -> float:
        """Its median so far."""
        with self.guard:
            return self.times[stage].quantile_s(0.5)

    def snapshot(self, *, queue_depth: int, ahead: int, journalled: int, elapsed_s: float) -> Status:
        """Everything at this moment."""
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
                journalled=journalled,
                pages_per_s=(len(self.arrivals_s) - 1) / span_s if span_s > 0 else 0.0,
                elapsed_s=elapsed_s,
                stages={name: times.stage() for name, times in self.times.items()},
                **{name: self.counts[name] for name in COUNTED},
            )
