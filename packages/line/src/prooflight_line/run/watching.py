"""Assembly of the parts of a run of a press."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from prooflight.inspection.guarantee import GuaranteeMonitor
from prooflight_line.run.following import Adapting
from prooflight_line.run.inspection_workers import THREADS_A_WORKER, InspectionWorkers, worker_count
from prooflight_line.run.monitor.evidence import columns_mm
from prooflight_line.run.monitor.run import RunMonitor
from prooflight_line.run.outcomes import RunWatch
from prooflight_line.run.pager import Pager, SheetEdge
from prooflight_line.run.resuming import Past
from prooflight_line.run.runner import Running
from prooflight_line.run.settings import Settings
from prooflight_line.run.sheet_inspector import Sampling, SheetInspector

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight.inspection.inspector import Inspector
    from prooflight.scans.lines import LineSource
    from prooflight_line.journal.records import PageRecord
    from prooflight_line.run.pager import PageStart
    from prooflight_line.run.prefetch import PageStore
    from prooflight_line.run.sheet_inspector import Keep
    from prooflight_line.run.sheets.following import Expected

EXPLAINERS: Final = 1
"""Number of worker processes beside those that inspect: explaining a misprint takes the time of two inspections."""


def watched(
    inspector: Inspector,
    *,
    source: LineSource,
    page_store: PageStore,
    settings: Settings,
    start: PageStart | None = None,
    keep: Keep = "none",
    follow: bool = True,
    false_alarms: float = 1.0,
    recorded: Iterable[PageRecord] | None = None,
    **told: Any,
) -> Running:
    """Return a run that is ready to start.

    follow: whether slow changes of lamp and paper are adapted to. false_alarms: stated rate of the run's monitor,
    per 100,000 pages. recorded: rows of a run that is resumed, in their order; None: the run is new. told: ``tell``,
    ``misprint``, ``notice``, ``arrived``, ``name``, ``flaws``, ``durable`` and ``clock`` of ``Running``.
    """
    press = inspector.press

    monitor = RunMonitor.begin(
        sensors=[sensor.name for sensor in press.sensors],
        columns_mm=columns_mm(press),
        costs=press.costs,
        false_alarms=false_alarms,
    )
    workers = worker_count(settings.inspectors, inspector, source_waits=settings.source_waits)
    threads, processors = THREADS_A_WORKER if workers else threads_a_sheet(settings), settings.inspectors
    if workers:
        settings = replace(settings, inspectors=workers, explainers=EXPLAINERS)
    watch = RunWatch(
        monitor=monitor,
        adapting=Adapting.begin(press) if follow else None,
        sheets=len(page_store) or None,
        design=page_store.design,
        guarantee=GuaranteeMonitor.of(inspector.detector, seed=settings.seed),
    )
    past = None if recorded is None else Past.of(recorded, watch)

    def pager(thumbnails: Expected) -> Pager:
        readings = None if past is None else past.readings(len(thumbnails))
        return Pager(press, expected=thumbnails, start=start or SheetEdge(), readings=readings)

    return Running(
        press=press,
        source=source,
        pager=pager,
        page_store=page_store,
        inspector=SheetInspector(
            inspector=inspector.with_threads(threads),
            keep=keep,
            sampling=Sampling(sample=settings.sample, seed=settings.seed),
            workers=InspectionWorkers(workers + EXPLAINERS, processors=processors) if workers else None,
        ),
        watch=watch,
        settings=settings,
        past=past,
        **told,
    )


def threads_a_sheet(settings: Settings) -> int:
    """Return the number of threads for one sheet.

    With a deadline, each sheet is divided among all cores, so that its verdict comes soon. Without one, whole
    sheets are distributed, not their parts: less work is done twice, and no thread waits for another.
    """
    cores = os.cpu_count() or 1
    return max(cores // settings.inspectors, 1) if settings.source_waits else cores
