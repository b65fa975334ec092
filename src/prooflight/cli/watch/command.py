"""``prooflight watch``: live inspection of the running press."""

from __future__ import annotations

import os
import time
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeVar, cast

import typer

from prooflight.cli import faults, laid_out, show
from prooflight.cli.exit_codes import UNUSABLE_INPUT, of_run
from prooflight.cli.options import Detector, JobPath, Json, LayoutWords, PressArtefact, Profile, Seed, Zones
from prooflight.cli.watch.console import console_beside
from prooflight.cli.watch.sources import REMEDY, DrumWishes, open_source
from prooflight.errors import RequestError
from prooflight.line.settings import DEADLINE_S, STALL_S, Settings, memory_for_designs
from prooflight.reporting.wording import suspended

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Mapping

    from prooflight.cli.watch.plant import Plant
    from prooflight.cli.watch.sources import Opened
    from prooflight.cli.watch.view import Watching
    from prooflight.inspection.inspector import Inspector
    from prooflight.journal.records import RunFacts
    from prooflight.line.book import JobBook
    from prooflight.line.outcomes import Outcome
    from prooflight.line.pager import PageStart
    from prooflight.line.recording import Recorder
    from prooflight.line.sheet_inspector import Keep, Known
    from prooflight.line.status import Status
    from prooflight.pages.job import JobSource
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.pages.warnings import PageWarning

Told = TypeVar("Told")
MOST_SHEETS: Final = 10_000_000
"""Largest number of sheets: three weeks at 5 sheets a second."""
MOST_LINES: Final = 1_000_000
"""Largest number of lines from trigger to trigger: 100 m of paper."""
MOST_THREADS: Final = 256
HOUR_S: Final = 3600.0


def register(program: typer.Typer) -> None:
    """Add the command to the program."""
    program.command()(watch)


def watch(
    job: JobPath,
    press: PressArtefact,
    source: Annotated[str, typer.Option(metavar="SOURCE", help=REMEDY)],
    sheets: Annotated[
        int | None,
        typer.Option(
            help="Number of sheets printed, the job repeated as needed; default once.", min=1, max=MOST_SHEETS
        ),
    ] = None,
    layout: LayoutWords = None,
    detector: Detector = None,
    deadline_ms: Annotated[
        float,
        typer.Option(
            "--deadline",
            metavar="MS",
            help="Longest time from a page's last line to its verdict.",
            min=1,
            max=1e3 * HOUR_S,
        ),
    ] = 1e3 * DEADLINE_S,
    stall_s: Annotated[
        float,
        typer.Option(
            "--stall",
            metavar="SECONDS",
            help="Time without a line after which that is announced.",
            min=0.1,
            max=24 * HOUR_S,
        ),
    ] = STALL_S,
    journal: Annotated[
        str | None,
        typer.Option(metavar="URL", help="Journal: sqlite:///FILE, a file, or `none`; default the user's."),
    ] = None,
    keep: Annotated[str, typer.Option(help="Evidence stored: all, misprints or none.")] = "misprints",
    sample: Annotated[
        float,
        typer.Option(
            metavar="SHARE", help="Share of the passing sheets that people are asked to label.", min=0, max=1
        ),
    ] = 0.0,
    false_alarms: Annotated[
        float,
        typer.Option(help="Number of false alarms of the run level per 100,000 pages.", min=1e-6, max=1e4),
    ] = 1.0,
    trigger: Annotated[
        int | None,
        typer.Option(
            metavar="LINES",
            help="Lines from page to page; default sheets are found by their edges.",
            min=1,
            max=MOST_LINES,
        ),
    ] = None,
    framed: Annotated[bool, typer.Option("--framed", help="Raw lines come in blocks with headers.")] = False,
    camera: Annotated[
        Path | None,
        typer.Option(metavar="PRESS.toml", help="Press file whose [camera] sets up the camera of --source."),
    ] = None,
    plant: Annotated[
        Path | None,
        typer.Option(metavar="PRESS.toml", help="Press file whose [gate] and [plant] are served."),
    ] = None,
    threads: Annotated[
        int | None,
        typer.Option(help="Number of inspecting threads; default one a core.", min=1, max=MOST_THREADS),
    ] = None,
    start_at_once: Annotated[
        bool,
        typer.Option(
            "--start-at-once",
            help="Read lines before all designs are ready; sheets whose design is not ready are not inspected.",
        ),
    ] = False,
    follow: Annotated[
        bool, typer.Option("--follow/--no-follow", help="Follow slow changes of lamp and paper.")
    ] = True,
    world: Annotated[str, typer.Option(help="World of the drum: ideal, press or measured.")] = "press",
    misprint: Annotated[
        str | None,
        typer.Option(metavar="KIND[:SEVERITY],...", help="Misprints on some of the drum's prints, in turn."),
    ] = None,
    every: Annotated[int, typer.Option(help="Period of misprints, in prints.", min=1)] = 10,
    fault_every: Annotated[
        int | None,
        typer.Option(help="Period of faults of the drum's paper path or camera, in sheets.", min=4),
    ] = None,
    zones: Zones = None,
    profile: Profile = None,
    seed: Seed = 1,
    serve: Annotated[
        bool, typer.Option("--serve", help="Show the run in the console, a process of its own: see `serve`.")
    ] = False,
    serve_port: Annotated[
        int, typer.Option("--serve-port", metavar="PORT", help="Port of the console.", min=0, max=65_535)
    ] = 8080,
    trays: Annotated[
        Path | None,
        typer.Option("--trays", metavar="FILE", help="The controller's log of its trays, for the console."),
    ] = None,
    json: Json = False,
) -> None:
    """Inspect a press while it runs, and show every page's verdict as it passes.

    Exits 1 if there was a misprint, 3 if not every sheet came, was inspected and was recorded, 5 if
    inspection could not keep up. Ctrl-C ends cleanly: what has passed is still inspected; a second one drops
    it, and reports that.
    """
    from prooflight.cli.jobs.check import checked_early
    from prooflight.cli.jobs.zones import zones_in_force
    from prooflight.cli.watch.plant import Plant
    from prooflight.cli.watch.view import Watching
    from prooflight.inspection.inspector import Inspector
    from prooflight.inspection.sheets import NEXT, Assembling
    from prooflight.journal.journal import content_digest
    from prooflight.journal.records import RunFacts
    from prooflight.line.pager import SheetEdge, TriggerCount
    from prooflight.pages.process import settle_process
    from prooflight.press.artefact import Press
    from prooflight.press.pages import job_source
    from prooflight.reporting.live import Recent

    if keep not in ("all", "misprints", "none"):
        raise RequestError("keep", f"there is no {keep!r}", remedy="choose all, misprints or none")
    loaded = Press.load(press)
    inspector = Inspector.of(loaded, detector)  # a wrong name ends before any work
    if json:
        show.print_json({"phase": "preparing", "detail": "reading the job"})
    printed = job_source(job, loaded, profile=profile)
    printed, plan = laid_out.laid_out(printed, layout, loaded.geometry, sheets=sheets)
    with printed.open() as opened:
        pages, name, flaws = len(opened), opened.name, opened.flaws()
        served = Plant.tried(plant, opened, loaded)
        zones_of_job = zones_in_force(zones, opened, loaded)
        early = checked_early(opened, json=json)
    inspector = replace(inspector, zones=zones_of_job)
    plan = served.with_sets(plan, pages=pages, sheets=sheets)
    count = (sheets or pages) if plan is None else plan.passings
    served.refuse_unfit(source, loaded, deadline_s=deadline_ms / 1e3)
    given = open_source(
        source,
        press=loaded,
        job=printed,
        framed=framed,
        settings=camera,
        wishes=DrumWishes(
            pages=pages,
            sheets=count,
            world=world,
            misprint=misprint,
            every=every,
            fault_every=fault_every,
            seed=seed,
            fed=served.simulated,
            plan=plan,
        ),
        shown=lambda scans, total: (show.told_progress if json else show.progress)(
            scans, total=total, what="printing for the drum"
        ),
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
        title=f"{name} on {loaded.name}, {source}, {inspector.detector.name}",
        recent=Recent.of([sensor.name for sensor in loaded.sensors]),
        deadline_s=None if given.waits else settings.deadline_s,
        json=json,
        sheets=None if plan is None else Assembling(plan, patience=NEXT),
    )
    settle_process()
    facts = RunFacts(
        job=name,
        job_digest="" if journal == "none" else content_digest(job),
        press=loaded.name,
        press_digest=loaded.digest,
        detector=inspector.detector.name,
        source=source,
        started_s=time.time(),
        sheets=count,
        settings=asdict(settings)
        | {"job_pages": pages}
        | ({} if plan is None else {"layout": plan.facts})
        | (
            {}
            if zones_of_job is None
            else {"zones": zones_of_job.digest, "zones_alone": zones_of_job.zones_digest}
        )
        | ({"warnings": early.plain} if early.warnings else {}),
    )
    planned = PlannedRun(
        facts=facts,
        inspector=inspector,
        job=printed,
        pages=pages,
        flaws=flaws,
        given=given,
        start=SheetEdge() if trigger is None else TriggerCount(lines=trigger),
        settings=settings,
        keep=cast("Keep", keep),
        follow=follow,
        false_alarms=false_alarms,
        plan=plan,
        warnings=early.warnings,
    )
    with (
        console_beside(serve, journal=journal, press=press, job=job, port=serve_port, trays=trays),
        _recorder(journal, facts) as recorder,
        _shown(planned, journal) as planned,
    ):
        status = _run(planned, served, recorder, console)
    console.told_all()
    if not json:
        show.people.print(console.view(status))
    unrecorded = 0 if recorder is None else recorder.unrecorded
    code = _ended(status, console.lacks(status, sheets=count, unrecorded=unrecorded))
    if code:
        raise typer.Exit(code)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRun:
    """Configuration of a run before its first line."""

    facts: RunFacts
    inspector: Inspector
    job: JobSource
    pages: int
    """Number of pages of the job."""
    flaws: Mapping[int, Exception]
    """Pages, from 1, that cannot be used, and why."""
    given: Opened
    start: PageStart
    settings: Settings
    keep: Keep
    follow: bool
    false_alarms: float
    """Number of false alarms of the run level per 100,000 pages."""
    plan: SheetPlan | None = None
    """Imposition of the job on sheets; None: one page a sheet."""
    warnings: tuple[PageWarning, ...] = ()
    """Warnings of the job that were printed before the run."""

    def position(self, number: int) -> int:
        """Return the position at which page ``number`` of the job, from 1, first passes."""
        plan = self.plan
        return number - 1 if plan is None else plan.layout.position_of(number - 1, plan.sheets)

    @property
    def sheets(self) -> int:
        """Number of sheets that pass."""
        assert self.facts.sheets is not None  # a run on a press always says
        return self.facts.sheets


def _prepared_before(planned: PlannedRun, book: JobBook) -> Callable[[Hashable], Known | None]:
    """Return the function that reads the designs of a job that `job prepare` has prepared."""
    from prooflight.line.prepared_store import PreparedStore

    store = PreparedStore.of(planned.inspector, planned.job)

    def load(design: Hashable) -> Known | None:
        known = None if store is None else store.load(cast("int", design))
        if known is not None and book.warnings is not None:
            book.warnings.add(known.prepared.page.warnings)
        return known

    return load


def _run(planned: PlannedRun, plant: Plant, recorder: Recorder | None, console: Watching) -> Status:
    """Watch until the lines end or a person stops the run, and return its final status."""
    from prooflight.line.book import JobBook
    from prooflight.line.notices import Notice, PageWarnings
    from prooflight.line.recording import ending_of
    from prooflight.line.watching import watched

    press, given, sheets = planned.inspector.press, planned.given, planned.sheets
    notify = console.noticed
    with plant.served(
        planned.facts,
        press,
        job_pages=planned.pages,
        plan=planned.plan,
        recorder=recorder,
        notice=lambda one: notify(one),
        progress=show.steps(quiet=console.json),
    ) as served:
        console.phase, console.too_late = served.phase, served.too_late
        job_book = JobBook(
            job=planned.job,
            press=press,
            pages=planned.pages,
            sheets=sheets,
            plan=planned.plan,
            warnings=PageWarnings(lambda one: notify(one), planned.warnings),
        )
        running = watched(
            planned.inspector,
            source=served.followed(given.source),
            book=job_book,
            start=planned.start,
            settings=planned.settings,
            keep=planned.keep,
            follow=planned.follow,
            false_alarms=planned.false_alarms,
            tell=_decided_first(
                served.gate_told, _each(partial(console.told, recorder=recorder), served.stream_told)
            ),
            notice=_each(console.noticed, served.noticed),
            arrived=served.arrived,
            name=job_book.name,
            flaws={
                planned.position(number): error for number, error in planned.flaws.items() if number <= sheets
            },
            durable=(lambda: 0) if recorder is None else (lambda: recorder.durable),
            stored=_prepared_before(planned, job_book),
        )
        if given.camera is not None:
            console.cameras = given.camera.healths
            given.camera.tell = lambda kind, text: running.note(Notice(kind=kind, text=text))
        notify = running.note  # from now on it stands in the journal too
        stopped = console.until_ended(running)
        notify = console.noticed
        status = running.status()
        lacks = console.lacks(status, sheets=sheets)
        if recorder is not None:
            recorder.end(status, stopped=stopped, detail=lacks)
        served.ended(ending_of(status, stopped=stopped), lacks)
    return status


def _decided_first(
    decide: Callable[[Outcome], Outcome] | None, tell: Callable[[Outcome], None]
) -> Callable[[Outcome], None]:
    """Return a function that lets the gate decide a sheet before it is reported; ``decide`` None: there is no gate.

    A sheet that the gate fails to decide is reported as held.
    """
    if decide is None:
        return tell

    def told(outcome: Outcome) -> None:
        decided = replace(outcome, record=replace(outcome.record, gate="hold"))
        try:
            decided = decide(outcome)
        finally:
            tell(decided)

    return told


def _each(*tells: Callable[[Told], None] | None) -> Callable[[Told], None]:
    """Return a function that calls all given ones in order; an error of one does not keep the others from
    being called.
    """
    there = [one for one in reversed(tells) if one is not None]

    def tell(what: Told) -> None:
        with ExitStack() as stack:
            for one in there:
                stack.callback(one, what)

    return tell


def _ended(status: Status, lacks: str) -> int:
    """Report why a run is incomplete or its false-alarm rate does not hold, if so; return its exit code."""
    from prooflight.line.status import Phase

    broke_off = status.phase is Phase.FAULT
    if status.promise_suspended:
        faults.told(suspended(status.promise_suspended))
    if broke_off or lacks:
        faults.told("; ".join(filter(None, (status.detail, lacks))))
    if broke_off and not status.good + status.misprints:
        return UNUSABLE_INPUT
    complete = not (broke_off or lacks)
    return of_run(misprints=status.misprints, complete=complete, overloaded=status.overloads > 0)


@contextmanager
def _shown(planned: PlannedRun, journal: str | None) -> Iterator[PlannedRun]:
    """Give the run with a source that the console can view, if there is a journal next to which the view is stored."""
    if journal == "none":
        yield planned
        return
    from prooflight.cli.watch.camera_view import ShownLines
    from prooflight.journal.camera_view import CameraExchange
    from prooflight.journal.opening import default_journal, journal_path

    given = planned.given
    exchange = CameraExchange(journal=journal_path(journal or str(default_journal())))
    with ShownLines(
        given.source,
        exchange=exchange,
        press=planned.inspector.press,
        name=planned.facts.source,
        healths=None if given.camera is None else given.camera.healths,
    ) as source:
        yield replace(planned, given=replace(given, source=source))


@contextmanager
def _recorder(journal: str | None, facts: RunFacts) -> Iterator[Recorder | None]:
    """Give the recorder of a new run in the journal of the option; None if there is to be none."""
    if journal == "none":
        yield None
        return
    from prooflight.journal.journal import Journal
    from prooflight.journal.opening import default_journal
    from prooflight.line.recording import Recorder
    from prooflight.plant.gate.log import set_aside

    with (
        Journal.open(journal or str(default_journal())) as opened,
        Recorder(opened, opened.begin_run(facts)) as recorder,
    ):
        if (aside := set_aside(opened.path, recorder.run_id)) is not None:
            faults.told(
                f"{aside} is the gate's log of a run that this journal does not know; it was put aside"
            )
        yield recorder
