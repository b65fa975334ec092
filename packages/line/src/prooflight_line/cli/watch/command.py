"""``prooflight watch``: live inspection of the running press."""

from __future__ import annotations

import os
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import typer

from prooflight.cli import event_log, imposition, show
from prooflight.cli.event_log import LogOption
from prooflight.cli.options import (
    Detector,
    JobPath,
    Json,
    LayoutOption,
    OnDevice,
    PressArtefact,
    Profile,
    Seed,
    Zones,
)
from prooflight.errors import RequestError
from prooflight_line.cli.watch.console import console_alongside
from prooflight_line.cli.watch.options import (
    CameraOption,
    CustomerOption,
    DeadlineMsOption,
    EveryOption,
    FalseAlarmsOption,
    FaultEveryOption,
    FollowOption,
    FramedOption,
    JournalOption,
    KeepOption,
    MisprintOption,
    OnStartOption,
    PlantOption,
    QueueOption,
    ResumeOption,
    SampleOption,
    ServeOption,
    ServePortOption,
    SheetsOption,
    SourceOption,
    StallSOption,
    StartAtOnceOption,
    StartedOption,
    ThreadsOption,
    TraysOption,
    TriggerOption,
    WorldOption,
)
from prooflight_line.cli.watch.sources import DrumWishes, open_source
from prooflight_line.run.settings import DEADLINE_S, STALL_S, Settings, memory_for_designs

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from prooflight.inspection.inspector import Inspector
    from prooflight.pages.check import EarlyWarnings
    from prooflight.pages.job import JobSource
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.pages.zones.zones_file import JobZones
    from prooflight_line.cli.watch.plant import Plant
    from prooflight_line.job_queue.tickets.ticket import Ticket
    from prooflight_line.run.sheet_inspector import Keep


def register(program: typer.Typer) -> None:
    """Add the command to the program."""
    program.command()(watch)


def watch(
    job: JobPath,
    press: PressArtefact,
    source: SourceOption,
    sheets: SheetsOption = None,
    layout: LayoutOption = None,
    detector: Detector = None,
    device: OnDevice = "cpu",
    deadline_ms: DeadlineMsOption = 1e3 * DEADLINE_S,
    stall_s: StallSOption = STALL_S,
    journal: JournalOption = None,
    keep: KeepOption = "misprints",
    sample: SampleOption = 0.0,
    customer: CustomerOption = "",
    false_alarms: FalseAlarmsOption = 1.0,
    trigger: TriggerOption = None,
    framed: FramedOption = False,
    camera: CameraOption = None,
    plant: PlantOption = None,
    threads: ThreadsOption = None,
    start_at_once: StartAtOnceOption = False,
    follow: FollowOption = True,
    world: WorldOption = "press",
    misprint: MisprintOption = None,
    every: EveryOption = 10,
    fault_every: FaultEveryOption = None,
    zones: Zones = None,
    profile: Profile = None,
    seed: Seed = 1,
    serve: ServeOption = False,
    serve_port: ServePortOption = 8080,
    trays: TraysOption = None,
    queue: QueueOption = False,
    on_start: OnStartOption = False,
    started: StartedOption = "",
    resume: ResumeOption = False,
    json: Json = False,
    log: LogOption = "text",
    context: typer.Context = None,  # type: ignore[assignment]  # typer gives it; a call from Python has no queue
) -> None:
    """Inspect a press while it runs, and say of every misprint where it is.

    Exits 1 if there was a misprint, 3 if not every sheet came, was inspected and was recorded, 5 if
    inspection could not keep up. Ctrl-C ends cleanly: what has passed is still inspected; a second one drops
    it, and reports that.
    """
    from prooflight.files.content import content_digest
    from prooflight.inspection.inspector import Inspector
    from prooflight.inspection.sheets import NEXT, Assembling
    from prooflight.pages.process import settle_process
    from prooflight.press.artefact import Press
    from prooflight_line.cli.watch import on_start as starting
    from prooflight_line.cli.watch.resuming import Resumption
    from prooflight_line.cli.watch.running import (
        PlannedRun,
        exit_code,
        lines_shown,
        recorder_of,
        run_until_ended,
        start_file_of,
    )
    from prooflight_line.cli.watch.view import Watching
    from prooflight_line.job_queue.hot_folder import HotFolder
    from prooflight_line.job_queue.listing import ticket_of
    from prooflight_line.journal.records import RunFacts
    from prooflight_line.reporting.traces import Traces
    from prooflight_line.run.pager import SheetEdge, TriggerCount
    from prooflight_line.run.status import Phase

    event_log.begin(log)
    if keep not in ("all", "misprints", "none"):
        raise RequestError("keep", f"there is no {keep!r}", remedy="choose all, misprints or none")
    if on_start:
        starting.refuse_unfit(queue=queue, journal=journal, resume=resume, serve=serve)
    if started:
        context.with_resource(starting.started(job, started, journal))
    traces = Traces.of_environment()
    loaded = Press.load(press)
    inspector = Inspector.of(loaded, detector).on(device)  # a wrong name ends before any work
    if on_start:
        arguments, say = context.find_root().obj, show.steps(quiet=json)
        starting.run_on_start(job, journal=journal, arguments=arguments, say=say)
        return
    taken = context.with_resource(HotFolder.open(job).printing(started or None)) if queue else None
    job = job if taken is None else taken.entry.file
    ticket = None if taken is None else ticket_of(taken.entry)
    if ticket is not None:
        keep = ticket.keep if ticket.keep and not _given(context, "keep") else keep
        sample = ticket.sample if ticket.sample is not None and not _given(context, "sample") else sample
    if json:
        show.print_json({"phase": "preparing", "detail": "reading the job"})
    read = _read_job(
        job,
        inspector,
        layout=layout,
        sheets=sheets,
        ticket=ticket,
        plant=plant,
        zones=zones,
        profile=profile,
        json=json,
    )
    inspector = replace(inspector, zones=read.zones)
    read.plant.refuse_unfit(source, loaded, deadline_s=deadline_ms / 1e3)
    facts = RunFacts(
        job=read.name,
        job_digest="" if journal == "none" else content_digest(job),
        press=loaded.name,
        press_digest=loaded.digest,
        detector=inspector.detector.name,
        source=source,
        started_s=time.time(),
        sheets=read.passings,
        settings=read.facts,
    )
    resumption = None
    if resume:
        if source.startswith("replay:"):
            what = "recorded scans begin with the first again"
            raise RequestError("--resume", what, remedy="leave out --resume to inspect them all")
        resumption = Resumption.last_of(
            journal,
            facts,
            gate=read.plant.gate,
            plan=read.plan,
            press_file=plant,
            progress=show.steps(quiet=json),
        )
    start_file = start_file_of(journal)

    def shown(scans: Iterable[Any], total: int) -> Iterator[Any]:
        bar = show.logged_progress if json else show.progress
        noted = scans if start_file is None else start_file.noted(scans, total=total, stage="print")
        return bar(noted, total=total, what="printing for the drum")

    given = open_source(
        source,
        press=loaded,
        job=read.source,
        framed=framed,
        settings=camera,
        wishes=DrumWishes(
            pages=read.pages,
            sheets=read.passings,
            world=world,
            misprint=misprint,
            every=every,
            fault_every=fault_every,
            seed=seed,
            fed=read.plant.simulated,
            plan=read.plan,
            passed=0 if resumption is None else resumption.past.due,
            at_once=start_at_once,
        ),
        shown=shown,
    )
    settings = Settings(
        source_waits=given.waits,
        source_clock=not framed,
        deadline_s=deadline_ms / 1e3,
        inspectors=threads or os.cpu_count() or 1,
        start_at_once=start_at_once,
        ahead_bytes=memory_for_designs(),
        stall_s=stall_s,
        sample=sample,
        seed=seed,
    )
    console = Watching(
        deadline_s=None if given.waits else settings.deadline_s,
        json=json,
        at_once=start_at_once,
        waits=given.waits,
        start_file=start_file,
        sheets=None if read.plan is None else Assembling(read.plan, patience=NEXT),
    )
    if resumption is not None:
        console.first_passed = resumption.past.first_not_inspected
    settle_process()
    planned = PlannedRun(
        facts=replace(
            facts,
            started_s=facts.started_s if resumption is None else resumption.started_s,
            settings=asdict(settings)
            | {"engine": inspector.engine}
            | read.facts
            | ({"customer": customer} if customer else {}),
        ),
        inspector=inspector,
        job=read.source,
        pages=read.pages,
        flaws=read.flaws,
        given=given,
        start=SheetEdge() if trigger is None else TriggerCount(lines=trigger),
        settings=settings,
        keep=cast("Keep", keep),
        follow=follow,
        false_alarms=false_alarms,
        plan=read.plan,
        warnings=read.early.warnings,
        resumption=resumption,
        traces=traces,
    )
    with (
        console_alongside(serve, journal=journal, press=press, job=job, port=serve_port, trays=trays),
        recorder_of(journal, planned.facts, resumption) as recorder,
        lines_shown(planned, journal) as planned,
    ):
        status = run_until_ended(planned, read.plant, recorder, console)
    if taken is not None:
        taken.finished = status.phase is Phase.STOPPED and not status.to_come
    console.end_sheets()
    if not json:
        show.people.print(console.line(status))
    unrecorded = 0 if recorder is None else recorder.unrecorded
    code = exit_code(status, console.lacks(status, sheets=read.passings, unrecorded=unrecorded))
    if code:
        raise typer.Exit(code)


def _given(context: typer.Context, option: str) -> bool:
    """Return whether an option was given, and is not its default."""
    source = context.get_parameter_source(option)
    return source is not None and source.name not in ("DEFAULT", "DEFAULT_MAP")


@dataclass(frozen=True, slots=True, kw_only=True)
class _ReadJob:
    """The job as it was read before the run."""

    source: JobSource
    name: str
    pages: int
    flaws: Mapping[int, Exception]
    """Pages, from 1, that cannot be used, and why."""
    plan: SheetPlan | None
    """Imposition of the job on sheets; None: one page a sheet."""
    passings: int
    """Number of sheets that pass."""
    plant: Plant
    zones: JobZones | None
    early: EarlyWarnings
    ticket: Ticket | None

    @property
    def facts(self) -> dict[str, Any]:
        """What the journal records of the job beside its name."""
        facts: dict[str, Any] = {"job_pages": self.pages}
        if self.plan is not None:
            facts["layout"] = self.plan.facts
        if self.ticket is not None:
            facts["ticket"] = self.ticket.facts
        if self.zones is not None:
            facts |= {"zones": self.zones.digest, "zones_alone": self.zones.zones_digest}
        if self.early.warnings:
            facts["warnings"] = self.early.plain
        if self.plant.file is not None:
            from prooflight.files.content import content_digest

            facts["press_file"] = content_digest(self.plant.file.path)
        return facts


def _read_job(
    job: Path,
    inspector: Inspector,
    *,
    layout: str | None,
    sheets: int | None,
    ticket: Ticket | None,
    plant: Path | None,
    zones: Path | None,
    profile: Path | None,
    json: bool,
) -> _ReadJob:
    """Read the job, its layout, zones and warnings, and try the plant; the errors of all these.

    What ``ticket`` says of the layout and of the number of copies counts where the command line says nothing else.
    """
    from prooflight.cli.jobs.check import checked_early
    from prooflight.cli.jobs.zones import zones_in_force
    from prooflight.press.pages import job_source
    from prooflight.press.print_condition import PrintCondition, condition_warnings
    from prooflight_line.cli.watch.plant import Plant
    from prooflight_line.cli.watch.sheets import copied, with_records
    from prooflight_line.job_queue.tickets.ticket import layout_with

    press = inspector.press
    source = job_source(job, press, profile=profile)
    paper = None
    if ticket is not None:
        layout = layout_with(ticket.layout, layout)
        sheets = copied(source, layout, ticket.copies) if sheets is None else sheets
        paper = PrintCondition(brand=ticket.brand, weight_gsm=ticket.weight_gsm)
    source, plan = imposition.imposed(source, layout, press.geometry, sheets=sheets)
    with source.open() as opened:
        pages, name, flaws = len(opened), opened.name, opened.flaws()
        tried = Plant.tried(plant, opened, press)
        zones_of_job = zones_in_force(zones, opened, inspector)
        records = opened.document_facts()
        more = condition_warnings(opened, press.print_condition, wanted=paper)
        early = checked_early(opened, json=json, more=more)
    plan = tried.with_sets(plan, pages=pages, sheets=sheets)
    plan = with_records(plan, records, pages=pages, sheets=sheets)
    return _ReadJob(
        source=source,
        name=name,
        pages=pages,
        flaws=flaws,
        plan=plan,
        passings=(sheets or pages) if plan is None else plan.passings,
        plant=tried,
        zones=zones_of_job,
        early=early,
        ticket=ticket,
    )
