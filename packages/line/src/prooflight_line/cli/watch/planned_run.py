"""A run of ``prooflight watch`` before its first line: what it inspects, from which source, and by which settings."""

from __future__ import annotations

import os
import time
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Self

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight_line.cli.watch.resuming import Resumption
from prooflight_line.cli.watch.sources import DrumWishes, Opened, open_source
from prooflight_line.run.settings import Settings, memory_for_designs

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from prooflight.inspection.inspector import Inspector
    from prooflight_line.cli.watch.job import ReadJob
    from prooflight_line.cli.watch.options import WatchOptions
    from prooflight_line.journal.records import RunFacts
    from prooflight_line.journal.start import StartFile
    from prooflight_line.reporting.traces import Traces
    from prooflight_line.run.pager import PageStart


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRun:
    """Configuration of a run before its first line."""

    options: WatchOptions
    read: ReadJob
    facts: RunFacts
    inspector: Inspector
    """Inspector with the zones of the job."""
    given: Opened
    start: PageStart
    settings: Settings
    resumption: Resumption | None = None
    """Run that broke off and is resumed; None: the run is new."""
    traces: Traces | None = None
    """Traces of the sheets; None: none are made."""
    start_file: StartFile | None = None
    """File in which consoles read how far the start has got; None: there is no journal."""

    @classmethod
    def of(cls, options: WatchOptions, inspector: Inspector, read: ReadJob, *, traces: Traces | None) -> Self:
        """Open the source, and plan the run that ``options`` ask for; ``inspector`` has the zones of the job.

        RequestError: there is no such source, or no run to resume. PlantError: the gate of that run was another.
        """
        from prooflight_line.run.pager import SheetEdge, TriggerCount

        facts, start_file = _run_facts(options, inspector, read), _start_file_of(options.record.journal)
        resumption = _resumption(options, facts, read) if options.start.resume else None
        passed = 0 if resumption is None else resumption.past.due
        given = _opened_source(options, inspector, read, start_file, passed=passed)
        settings = _settings(options, waits=given.waits)
        trigger, customer = options.lines.trigger, options.record.customer
        of_run = asdict(settings) | {"engine": inspector.engine} | read.facts
        return cls(
            facts=replace(
                facts,
                started_s=facts.started_s if resumption is None else resumption.started_s,
                settings=of_run | ({"customer": customer} if customer else {}),
            ),
            options=options,
            read=read,
            inspector=inspector,
            given=given,
            start=SheetEdge() if trigger is None else TriggerCount(lines=trigger),
            settings=settings,
            resumption=resumption,
            traces=traces,
            start_file=start_file,
        )

    def position(self, number: int) -> int:
        """Return the position at which page ``number`` of the job, from 1, first passes."""
        plan = self.read.plan
        return number - 1 if plan is None else plan.layout.position_of(number - 1, plan.sheets)


def _run_facts(options: WatchOptions, inspector: Inspector, read: ReadJob) -> RunFacts:
    """Return the facts by which a run that broke off is recognised; its settings are those of the job alone."""
    from prooflight.files.content import content_digest
    from prooflight_line.journal.records import RunFacts

    return RunFacts(
        job=read.name,
        job_digest="" if options.record.journal == "none" else content_digest(options.job),
        press=inspector.press.name,
        press_digest=inspector.press.digest,
        detector=inspector.detector.name,
        source=options.source,
        started_s=time.time(),
        sheets=read.passings,
        settings=read.facts,
    )


def _resumption(options: WatchOptions, facts: RunFacts, read: ReadJob) -> Resumption:
    if options.source.startswith("replay:"):
        what = "recorded scans start again with the first one"
        raise RequestError("--resume", what, remedy="leave out --resume to inspect them all")
    return Resumption.last_of(
        options.record.journal,
        facts,
        gate=read.plant.gate,
        plan=read.plan,
        press_file=options.plant,
        progress=show.steps(quiet=options.json),
    )


def _opened_source(
    options: WatchOptions, inspector: Inspector, read: ReadJob, start_file: StartFile | None, *, passed: int
) -> Opened:
    """Open the source of the options; ``passed`` sheets have passed before."""
    bar = show.logged_progress if options.json else show.progress

    def shown(scans: Iterable[Any], total: int) -> Iterator[Any]:
        noted = scans if start_file is None else start_file.noted(scans, total=total, stage="print")
        return bar(noted, total=total, what="printing for the drum")

    return open_source(
        options.source,
        press=inspector.press,
        job=read.source,
        framed=options.lines.framed,
        settings=options.lines.camera,
        wishes=DrumWishes(
            pages=read.pages,
            sheets=read.passings,
            options=options.drum,
            seed=options.seed,
            fed=read.plant.simulated,
            plan=read.plan,
            passed=passed,
            at_once=options.pace.start_at_once,
        ),
        shown=shown,
    )


def _settings(options: WatchOptions, *, waits: bool) -> Settings:
    """Return the settings of a run; ``waits`` if its source can be made to wait."""
    return Settings(
        source_waits=waits,
        source_clock=not options.lines.framed,
        deadline_s=options.inspection.deadline_ms / 1e3,
        inspectors=options.pace.threads or os.cpu_count() or 1,
        start_at_once=options.pace.start_at_once,
        ahead_bytes=memory_for_designs(),
        stall_s=options.inspection.stall_s,
        sample=options.record.sample,
        seed=options.seed,
    )


def _start_file_of(journal: str | None) -> StartFile | None:
    """Return ``PlannedRun.start_file``."""
    from prooflight_line.journal.opening import default_journal, journal_path
    from prooflight_line.journal.start import StartFile

    if journal == "none":
        return None
    return StartFile(journal=journal_path(journal or str(default_journal())))
