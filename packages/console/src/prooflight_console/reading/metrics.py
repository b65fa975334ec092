"""Figures for Prometheus, read from the journal: what passed since the console began, and the state of the last run."""

from __future__ import annotations

import shutil
import threading
import time
from bisect import bisect_left
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import accumulate
from typing import TYPE_CHECKING, Final, get_args

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.registry import Collector

from prooflight import __version__
from prooflight.errors import ProoflightError
from prooflight_console.reading.now import State
from prooflight_console.reading.quality import quality
from prooflight_console.reading.runs import AT_ONCE
from prooflight_line.job_queue.hot_folder import STAGES, HotFolder
from prooflight_line.journal.schema import JournalError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from prometheus_client.metrics_core import Metric

    from prooflight_console.reading.incidents import RunIncidents
    from prooflight_console.reading.live import Live
    from prooflight_console.reading.quality import FalseAlarms
    from prooflight_console.reading.reprints import Reprints
    from prooflight_console.reading.runs import Reading
    from prooflight_console.reading.stations import Stations
    from prooflight_line.journal.records import PageRecord, RunRow

BOUNDS_S: Final = (0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.75, 1.0, 2.0, 5.0)
"""Upper bounds of the histogram of inspection times; half a second is the usual deadline. [s]"""
QUALITY_S: Final = 60.0
"""Least time between two reviews of a run's alarms, which read all its rows that are not good. [s]"""
STATES: Final = get_args(State)


@dataclass(slots=True)
class _Passed:
    """Counts of the sheets that passed since the console began."""

    verdicts: Counter[str] = field(
        default_factory=lambda: Counter({"good": 0, "misprint": 0, "not-inspected": 0})
    )
    kinds: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=lambda: Counter({"lost-lines": 0}))
    late: int = 0
    damaged: int = 0
    times: list[int] = field(default_factory=lambda: [0] * (len(BOUNDS_S) + 1))
    """Number of inspections by time, the last of them beyond all bounds."""
    time_s: float = 0.0

    def add(self, page: PageRecord) -> None:
        """Count a sheet."""
        verdict = page.verdict
        self.verdicts[verdict.verdict] += 1
        if verdict.verdict == "misprint":
            self.kinds[verdict.kind or "unknown"] += 1
        self.faults.update(page.faults)
        self.late += page.late
        if verdict.milliseconds > 0:
            self.times[bisect_left(BOUNDS_S, verdict.milliseconds / 1e3)] += 1
            self.time_s += verdict.milliseconds / 1e3


class Metrics(Collector):
    """Figures of a journal. The methods are thread-safe."""

    def __init__(
        self,
        reading: Reading,
        live: Live,
        incidents: RunIncidents,
        stations: Stations,
        reprints: Reprints,
        *,
        queue: Path | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to count; queue: hot folder of the press."""
        self._reading, self._live, self._incidents = reading, live, incidents
        self._stations, self._reprints, self._queue, self._clock = stations, reprints, queue, clock
        self._guard = threading.Lock()
        self._passed = _Passed()
        self._row: int | None = None
        self._reviewed: tuple[tuple[int, str], float, FalseAlarms] | None = None
        with suppress(JournalError):  # from the first row on, once it can be read
            self._row = reading.heads().row
        self._registry = CollectorRegistry()
        self._registry.register(self)

    def text(self) -> bytes:
        """Return all figures in Prometheus's text format."""
        with self._guard:
            return generate_latest(self._registry)

    def describe(self) -> list[Metric]:
        """Return nothing, so that registering reads no journal."""
        return []

    def collect(self) -> Iterator[Metric]:
        """Yield all figures; those of a journal that cannot be read are left out, and its state says so."""
        yield _gauge("build_info", "Version of Prooflight.", 1, version=__version__)
        yield from self._of_disk()
        if self._queue is not None:
            yield from self._of_queue(self._queue)
        try:
            self._count()
            figures = [*self._of_sheets(), *self._of_run()]
        except (JournalError, OSError):
            yield _gauge("journal_readable", "Whether the journal can be read.", 0)
            return
        yield _gauge("journal_readable", "Whether the journal can be read.", 1)
        yield from figures

    def _count(self) -> None:
        heads = self._reading.heads()
        if self._row is None or heads.row < self._row:  # another journal, or one that begins
            self._row = 0

        def bad(_error: object) -> None:
            self._passed.damaged += 1

        while rows := self._reading.written_after(self._row, limit=AT_ONCE, damaged=bad):
            for row in rows:
                self._passed.add(row.page)
            self._row = rows[-1].row
        self._row = max(self._row, heads.row)  # the rest is damaged

    def _of_sheets(self) -> Iterator[Metric]:
        passed = self._passed
        yield _counter("sheets", "Sheets since the console began.", "verdict", passed.verdicts)
        yield _counter("misprints", "Misprints since the console began.", "kind", passed.kinds)
        yield _counter(
            "faults", "Faults of paper path and camera; lost-lines is the camera's.", "fault", passed.faults
        )
        late = CounterMetricFamily("prooflight_late", "Verdicts after their deadline.")
        late.add_metric([], passed.late)
        yield late
        damaged = CounterMetricFamily("prooflight_damaged_rows", "Rows that cannot be read.")
        damaged.add_metric([], passed.damaged)
        yield damaged
        counts = accumulate(passed.times)
        buckets = [
            (str(bound), float(count)) for bound, count in zip((*BOUNDS_S, "+Inf"), counts, strict=True)
        ]
        times = HistogramMetricFamily(
            "prooflight_inspection_seconds", "Time that the inspection of a sheet took."
        )
        times.add_metric([], buckets, passed.time_s)
        yield times

    def _of_run(self) -> Iterator[Metric]:
        now = self._live.now
        state = GaugeMetricFamily(
            "prooflight_state", "State of the press: 1 for the current one.", labels=["state"]
        )
        for name in STATES:
            state.add_metric([name], float(name == now.state))
        yield state
        alarms = GaugeMetricFamily(
            "prooflight_incidents",
            "Incidents that need a person, by disposition.",
            labels=["disposition"],
        )
        for disposition, count in Counter(one.incident.disposition for one in now.incidents).items():
            alarms.add_metric([disposition], count)
        yield alarms
        run = self._reading.last_run()
        if run is None:
            return
        facts = run.facts
        yield _gauge(
            "run_info",
            "The last run.",
            1,
            run=str(run.id),
            job=facts.job,
            press=facts.press,
            detector=facts.detector,
        )
        yield _gauge("run_active", "Whether the last run is in progress.", float(run.state == "running"))
        if facts.sheets is not None:
            yield _gauge("run_expected_sheets", "Sheets that the last run expects.", facts.sheets)
        for name, value in (("pages", run.pages), ("misprints", run.misprints), ("late", run.late),
                            ("not_inspected", run.not_inspected), ("absent", run.absent),
                            ("unrecorded", run.dropped_pages)):  # fmt: skip
            yield _gauge(f"run_{name}", f"Of the last run: {name.replace('_', ' ')}.", value)
        if now.reprints.count is not None:
            yield _gauge("run_reprints", "Sheets of the last run to print again.", now.reprints.count)
        yield from self._of_false_alarms(run)

    def _of_false_alarms(self, run: RunRow) -> Iterator[Metric]:
        alarms = self._false_alarms(run)
        if alarms.rate is not None:
            yield _gauge(
                "false_alarm_rate_nominal", "Rate of false alarms that the detector guarantees.", alarms.rate
            )
        if alarms.good:
            realised = alarms.confirmed / alarms.good
            yield _gauge("false_alarm_rate_realised", "Alarms labelled false, for each good sheet.", realised)
        yield _gauge("false_alarms", "Alarms of the last run that are labelled false.", alarms.confirmed)
        yield _gauge("alarms_unlabelled", "Alarms of the last run without a label.", alarms.unanswered)
        suspended = float(alarms.suspended_from is not None)
        yield _gauge(
            "guarantee_suspended", "Whether the guarantee does not hold for the last run.", suspended
        )

    def _false_alarms(self, run: RunRow) -> FalseAlarms:
        """Return the false alarms of a run, which need many rows and are therefore reviewed seldom."""
        key, now_s = (run.id, run.state), self._clock()
        if self._reviewed is None or self._reviewed[0] != key or now_s - self._reviewed[1] >= QUALITY_S:
            reprints = self._live.now.reprints
            reviewed = quality(self._reading, self._incidents, self._stations, reprints, run).false_alarms
            self._reviewed = key, now_s, reviewed
        return self._reviewed[2]

    def _of_disk(self) -> Iterator[Metric]:
        journal = self._reading.path
        try:
            usage = shutil.disk_usage(journal.parent)
            yield _gauge("disk_free_bytes", "Free space on the journal's disk.", usage.free)
            yield _gauge("disk_bytes", "Size of the journal's disk.", usage.total)
            yield _gauge("journal_bytes", "Size of the journal, without evidence.", journal.stat().st_size)
        except OSError:
            return

    def _of_queue(self, queue: Path) -> Iterator[Metric]:
        jobs = GaugeMetricFamily(
            "prooflight_queue_jobs", "Jobs of the hot folder, by stage.", labels=["stage"]
        )
        try:
            entries = HotFolder(path=queue).entries(*STAGES)
        except (OSError, ProoflightError):
            return
        counts = Counter(entry.stage for entry in entries)
        for stage in STAGES:
            jobs.add_metric([stage], counts[stage])
        yield jobs


def _gauge(name: str, what: str, value: float, **labels: str) -> Metric:
    gauge = GaugeMetricFamily(f"prooflight_{name}", what, labels=list(labels))
    gauge.add_metric(list(labels.values()), value)
    return gauge


def _counter(name: str, what: str, label: str, counts: Counter[str]) -> Metric:
    counter = CounterMetricFamily(f"prooflight_{name}", what, labels=[label])
    for value, count in sorted(counts.items()):
        counter.add_metric([value], count)
    return counter
