"""``prooflight watch``: the running press, live."""

from __future__ import annotations

import os
import time
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, cast

import typer

from prooflight.cli import faults, show
from prooflight.cli.exit_codes import UNUSABLE_INPUT, of_run
from prooflight.cli.options import Detector, JobPath, Json, PressArtefact, Profile, Seed
from prooflight.cli.watch_sources import REMEDY, DrumWishes, open_source
from prooflight.errors import RequestError
from prooflight.line.settings import DEADLINE_S, STALL_S, Settings
from prooflight.reporting.wording import suspended

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.inspection.inspector import Inspector
    from prooflight.line.recording import Recorder
    from prooflight.line.sheet_inspector import Keep
    from prooflight.line.status import Status

MOST_SHEETS: Final = 10_000_000
"""Three weeks at 5 sheets a second."""
MOST_LINES: Final = 1_000_000
"""From trigger to trigger: 100 m of paper."""
MOST_THREADS: Final = 256
MOST_MEGABYTES: Final = 1_000_000
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
            help="How many are printed, the job over and over; default once.", min=1, max=MOST_SHEETS
        ),
    ] = None,
    detector: Detector = None,
    deadline_ms: Annotated[
        float,
        typer.Option(
            "--deadline",
            metavar="MS",
            help="From a page's last line to its verdict.",
            min=1,
            max=1e3 * HOUR_S,
        ),
    ] = 1e3 * DEADLINE_S,
    stall_s: Annotated[
        float,
        typer.Option(
            "--stall",
            metavar="SECONDS",
            help="Without a line, after which that is announced.",
            min=0.1,
            max=24 * HOUR_S,
        ),
    ] = STALL_S,
    journal: Annotated[
        str | None, typer.Option(metavar="URL", help="sqlite:///FILE, a file, or `none`; default the user's.")
    ] = None,
    keep: Annotated[str, typer.Option(help="Evidence kept: all, misprints or none.")] = "misprints",
    false_alarms: Annotated[
        float, typer.Option(help="Of the run level, a 100,000 pages.", min=1e-6, max=1e4)
    ] = 1.0,
    trigger: Annotated[
        int | None,
        typer.Option(
            metavar="LINES",
            help="From page to page; default sheets are found by their edges.",
            min=1,
            max=MOST_LINES,
        ),
    ] = None,
    framed: Annotated[bool, typer.Option("--framed", help="Raw lines come in blocks with headers.")] = False,
    camera: Annotated[
        Path | None,
        typer.Option(metavar="PRESS.toml", help="Press file whose [camera] sets up the camera of --source."),
    ] = None,
    threads: Annotated[
        int | None, typer.Option(help="That inspect; default one a core.", min=1, max=MOST_THREADS)
    ] = None,
    memory_mb: Annotated[
        int,
        typer.Option("--memory", metavar="MB", help="For designs made ready.", min=100, max=MOST_MEGABYTES),
    ] = 4000,
    follow: Annotated[
        bool, typer.Option("--follow/--no-follow", help="Follow slow changes of lamp and paper.")
    ] = True,
    world: Annotated[str, typer.Option(help="Of the drum: ideal or press.")] = "press",
    misprint: Annotated[
        str | None, typer.Option(metavar="KIND[:SEVERITY]", help="On some of the drum's prints.")
    ] = None,
    every: Annotated[int, typer.Option(help="On every so many of them.", min=1)] = 10,
    fault_every: Annotated[
        int | None,
        typer.Option(help="The drum's paper path or camera errs every so many sheets.", min=4),
    ] = None,
    profile: Profile = None,
    seed: Seed = 1,
    json: Json = False,
) -> None:
    """Inspect a press while it runs: every page's verdict as it passes.

    Exits 1 if there was a misprint, 3 if not every sheet came, was inspected and was recorded. Ctrl-C ends cleanly:
    what has passed is still inspected; a second one drops it, and says so.
    """
    from prooflight.cli.watch_view import Watching
    from prooflight.inspection.inspector import Inspector
    from prooflight.line.book import JobBook
    from prooflight.line.notices import Notice
    from prooflight.line.pager import SheetEdge, TriggerCount
    from prooflight.line.watching import watched
    from prooflight.pages.job import JobSource
    from prooflight.pages.process import settle_process
    from prooflight.press.artefact import Press
    from prooflight.reporting.live import Recent

    if keep not in ("all", "misprints", "none"):
        raise RequestError("keep", f"there is no {keep!r}", remedy="choose all, misprints or none")
    loaded = Press.load(press)
    inspector = Inspector.of(loaded, detector)
    job_source = JobSource(path=job, dpi=loaded.dpi, profile=profile)
    with job_source.open() as opened:
        pages, name, flaws = len(opened), opened.name, opened.flaws()
    count = sheets or pages
    given = open_source(
        source,
        press=loaded,
        job=job_source,
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
        ),
        shown=lambda scans, total: (
            scans if json else show.progress(scans, total=total, what="printing for the drum")
        ),
    )
    settings = Settings(
        source_waits=given.waits,
        source_clock=not framed,
        deadline_s=deadline_ms / 1e3,
        inspectors=threads or os.cpu_count() or 1,
        ahead_bytes=memory_mb * 10**6,
        stall_s=stall_s,
        seed=seed,
    )
    console = Watching(
        title=f"{name} on {loaded.name}, {source}, {inspector.detector.name}",
        recent=Recent.of([sensor.name for sensor in loaded.sensors]),
        deadline_s=None if given.waits else settings.deadline_s,
        json=json,
    )
    settle_process()
    with _recorder(journal, job, inspector, settings, name=name, source=source, sheets=count) as recorder:
        book = JobBook(job=job_source, press=loaded, pages=pages, sheets=count)
        running = watched(
            inspector,
            source=given.source,
            book=book,
            start=SheetEdge() if trigger is None else TriggerCount(lines=trigger),
            settings=settings,
            keep=cast("Keep", keep),
            follow=follow,
            false_alarms=false_alarms,
            tell=partial(console.told, recorder=recorder),
            notice=console.noticed,
            name=book.name,
            flaws={number - 1: error for number, error in flaws.items() if number <= count},
            durable=(lambda: 0) if recorder is None else (lambda: recorder.durable),
        )
        if given.camera is not None:
            given.camera.tell = lambda kind, text: running.note(Notice(kind=kind, text=text))
        stopped = console.until_ended(running)
        status = running.status()
        if recorder is not None:
            recorder.end(status, stopped=stopped, detail=console.lacks(status, sheets=count))
    if not json:
        show.people.print(console.view(status))
    unrecorded = 0 if recorder is None else recorder.unrecorded
    code = _ended(status, console.lacks(status, sheets=count, unrecorded=unrecorded))
    if code:
        raise typer.Exit(code)


def _ended(status: Status, lacks: str) -> int:
    """Say what keeps a run from being complete or its promise from holding, if anything does; its exit code."""
    from prooflight.line.status import Phase

    broke_off = status.phase is Phase.FAULT
    if status.promise_suspended:
        faults.told(suspended(status.promise_suspended))
    if broke_off or lacks:
        faults.told("; ".join(filter(None, (status.detail, lacks))))
    if broke_off and not status.good + status.misprints:
        return UNUSABLE_INPUT
    return of_run(misprints=status.misprints, complete=not (broke_off or lacks))


@contextmanager
def _recorder(
    journal: str | None,
    job: Path,
    inspector: Inspector,
    settings: Settings,
    *,
    name: str,
    source: str,
    sheets: int,
) -> Iterator[Recorder | None]:
    """Of a new run, in the journal that the option names; None: there is to be none."""
    if journal == "none":
        yield None
        return
    from prooflight.journal.journal import Journal, content_digest
    from prooflight.journal.opening import default_journal
    from prooflight.journal.records import RunFacts
    from prooflight.line.recording import Recorder

    facts = RunFacts(
        job=name,
        job_digest=content_digest(job),
        press=inspector.press.name,
        press_digest=inspector.press.digest,
        detector=inspector.detector.name,
        source=source,
        started_s=time.time(),
        sheets=sheets,
        settings=asdict(settings),
    )
    with (
        Journal.open(journal or str(default_journal())) as opened,
        Recorder(opened, opened.begin_run(facts)) as recorder,
    ):
        yield recorder
