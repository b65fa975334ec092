"""``prooflight watch``: the running press, live."""

from __future__ import annotations

import os
import signal
import time
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, cast

import typer
from rich.live import Live

from prooflight.cli import faults, show
from prooflight.cli.exit_codes import MISPRINT_FOUND, UNUSABLE_INPUT
from prooflight.cli.job import JobPath, Json, PressArtefact, Profile, Seed
from prooflight.cli.watch_sources import REMEDY, DrumWishes, open_source
from prooflight.errors import RequestError
from prooflight.inspecting.book import JobBook
from prooflight.inspecting.inspector import Inspector
from prooflight.inspecting.journal import Journal, RunFacts, content_digest, default_journal
from prooflight.inspecting.journaling.exporting import page_facts
from prooflight.inspecting.paging import SheetEdge, TriggerCount
from prooflight.inspecting.recording import Recorder
from prooflight.inspecting.settings import Settings
from prooflight.inspecting.status import Phase
from prooflight.inspecting.watching import watched
from prooflight.pages.job import JobSource
from prooflight.pages.process import settle_process
from prooflight.press import Press
from prooflight.reporting.live import Recent, live_view

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rich.console import RenderableType

    from prooflight.inspecting.judging import Keep
    from prooflight.inspecting.outcomes import Outcome
    from prooflight.inspecting.running import Running
    from prooflight.inspecting.status import Status

REFRESH_S = 0.25


def watch(
    job: JobPath,
    press: PressArtefact,
    source: Annotated[str, typer.Option(metavar="SOURCE", help=REMEDY)],
    sheets: Annotated[
        int | None, typer.Option(help="How many are printed, the job over and over; default once.", min=1)
    ] = None,
    detector: Annotated[
        str | None, typer.Option(help="ours, bayes or chi-square; default ours if the press was taught it.")
    ] = None,
    deadline_ms: Annotated[
        float, typer.Option("--deadline", metavar="MS", help="From a page's last line to its verdict.", min=1)
    ] = 500.0,
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
            metavar="LINES", help="From page to page; default sheets are found by their edges.", min=1
        ),
    ] = None,
    framed: Annotated[bool, typer.Option("--framed", help="Raw lines come in blocks with headers.")] = False,
    threads: Annotated[int | None, typer.Option(help="That inspect; default one a core.", min=1)] = None,
    memory_mb: Annotated[
        int, typer.Option("--memory", metavar="MB", help="For designs made ready.", min=100)
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
    """Inspect a press while it runs: every page's verdict as it passes; exits 1 if there was a misprint.

    Ctrl-C ends cleanly: what has passed is still inspected; a second one drops it, and says so.
    """
    if keep not in ("all", "misprints", "none"):
        raise RequestError("keep", f"there is no {keep!r}", remedy="choose all, misprints or none")
    loaded = Press.load(press)
    inspector = Inspector.of(loaded, detector)
    job_source = JobSource(path=job, dpi=loaded.dpi, profile=profile)
    with job_source.open() as opened:
        pages, name = len(opened), opened.name
    count = sheets or pages
    given = open_source(
        source,
        press=loaded,
        job=job_source,
        pages=pages,
        sheets=count,
        framed=framed,
        wishes=DrumWishes(world=world, misprint=misprint, every=every, fault_every=fault_every, seed=seed),
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
        seed=seed,
    )
    console = Watching(
        title=f"{name} on {loaded.name}, {source}, {inspector.judge.name}",
        recent=Recent.of([sensor.name for sensor in loaded.sensors]),
        deadline_s=None if given.waits else settings.deadline_s,
        json=json,
    )
    settle_process()
    with _recorder(journal, job, inspector, settings, name=name, source=source, sheets=count) as recorder:
        running = watched(
            inspector,
            source=given.source,
            book=JobBook(job=job_source, press=loaded, pages=pages, sheets=count),
            start=SheetEdge() if trigger is None else TriggerCount(lines=trigger),
            settings=settings,
            keep=cast("Keep", keep),
            follow=follow,
            false_alarms=false_alarms,
            tell=partial(console.told, recorder=recorder),
            durable=(lambda: 0) if recorder is None else (lambda: recorder.durable),
        )
        stopped = console.until_ended(running)
        status = running.status()
        if recorder is not None:
            recorder.end(status, stopped=stopped)
    if not json:
        show.people.print(console.view(status))
    if status.phase is Phase.FAULT:
        faults.told(status.detail)
        raise typer.Exit(UNUSABLE_INPUT)
    if status.misprints:
        raise typer.Exit(MISPRINT_FOUND)


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
    facts = RunFacts(
        job=name,
        job_digest=content_digest(job),
        press=inspector.press.name,
        press_digest=inspector.press.digest,
        detector=inspector.judge.name,
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Watching:
    """What a person or a program sees of a run."""

    title: str
    recent: Recent
    deadline_s: float | None
    json: bool

    def told(self, outcome: Outcome, *, recorder: Recorder | None) -> None:
        """One sheet: into the journal first, then shown."""
        if recorder is not None:
            recorder.record(outcome.record)
        if not self.json:
            self.recent.add(outcome)
            return
        latency_ms = None if outcome.latency_s is None else round(1e3 * outcome.latency_s, 1)
        said = [asdict(one) for one in outcome.announcements]
        show.print_json(page_facts(outcome.record) | {"latency_ms": latency_ms, "announcements": said})

    def view(self, status: Status) -> RenderableType:
        """The whole screen."""
        return live_view(status, self.recent, title=self.title, deadline_s=self.deadline_s)

    def until_ended(self, running: Running) -> bool:
        """Start the run and wait for its end; whether a person ended it."""
        with _signals(running) as stops, ExitStack() as stack:
            live = None
            if not self.json and show.people.is_terminal:
                live = stack.enter_context(
                    Live(self.view(running.status()), console=show.people, transient=True, auto_refresh=False)
                )
            running.start()
            while not running.join(REFRESH_S):
                if live is not None:
                    live.update(self.view(running.status()), refresh=True)
        return bool(stops)


@contextmanager
def _signals(running: Running) -> Iterator[list[int]]:
    """The first Ctrl-C or SIGTERM ends the run cleanly, the second drops what waits."""
    stops: list[int] = []

    def stop(number: int, _frame: object) -> None:
        stops.append(number)
        running.stop(drop=len(stops) > 1)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stops
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
