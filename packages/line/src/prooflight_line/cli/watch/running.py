"""A run of ``prooflight watch`` from its first line to its exit code."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Self, TypeVar, cast

from prooflight.cli import faults, show
from prooflight.cli.exit_codes import UNUSABLE_INPUT, of_run
from prooflight.reporting.wording import suspended

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Mapping

    from prooflight.inspection.inspector import Inspector
    from prooflight.inspection.packed_design import PackedDesign
    from prooflight.inspection.prepared_store import PreparedStore
    from prooflight.pages.job import JobSource
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.pages.warnings import PageWarning
    from prooflight_line.cli.watch.plant import Plant
    from prooflight_line.cli.watch.resuming import Resumption
    from prooflight_line.cli.watch.sources import Opened
    from prooflight_line.cli.watch.view import Watching
    from prooflight_line.journal.records import RunFacts
    from prooflight_line.journal.start import StartFile
    from prooflight_line.reporting.traces import RunTraces, Traces
    from prooflight_line.run.notices import PageWarnings
    from prooflight_line.run.outcomes import Outcome
    from prooflight_line.run.page_store import JobPageStore
    from prooflight_line.run.pager import PageStart
    from prooflight_line.run.recording import Recorder
    from prooflight_line.run.settings import Settings
    from prooflight_line.run.sheet_inspector import Keep
    from prooflight_line.run.status import Status

Event = TypeVar("Event")


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
    resumption: Resumption | None = None
    """Run that broke off and is resumed; None: the run is new."""
    traces: Traces | None = None
    """Where traces of the sheets go; None: none are made."""

    def position(self, number: int) -> int:
        """Return the position at which page ``number`` of the job, from 1, first passes."""
        plan = self.plan
        return number - 1 if plan is None else plan.layout.position_of(number - 1, plan.sheets)

    @property
    def sheets(self) -> int:
        """Number of sheets that pass."""
        assert self.facts.sheets is not None  # a run on a press always says
        return self.facts.sheets


@dataclass(frozen=True, slots=True, kw_only=True)
class _PreparedJob:
    """Designs of a job that were prepared before, and those that this run prepares for later ones."""

    store: PreparedStore | None
    warnings: PageWarnings | None

    @classmethod
    def of(cls, planned: PlannedRun, page_store: JobPageStore) -> Self:
        from prooflight.inspection.prepared_store import MOST_BYTES, PreparedStore, clean

        store = PreparedStore.of(planned.inspector, planned.job)
        if store is not None:
            clean(store.folder.parent, most_bytes=MOST_BYTES, keep=store.folder)
        return cls(store=store, warnings=page_store.warnings)

    def load(self, design: Hashable) -> PackedDesign | None:
        packed = None if self.store is None else self.store.load(cast("int", design))
        if packed is not None and self.warnings is not None:
            self.warnings.add(packed.bare.page.warnings)
        return packed

    def save(self, design: Hashable, packed: PackedDesign) -> None:
        if self.store is not None:
            self.store.save(cast("int", design), packed)


def run_until_ended(
    planned: PlannedRun, plant: Plant, recorder: Recorder | None, console: Watching
) -> Status:
    """Watch until the lines end or a person stops the run, and return its final status."""
    from prooflight_line.cli.watch.run_log import RunLog
    from prooflight_line.reporting.traces import RunTraces
    from prooflight_line.run.notices import Notice, PageWarnings
    from prooflight_line.run.page_store import JobPageStore
    from prooflight_line.run.recording import ending_of
    from prooflight_line.run.watching import watched

    press, given, sheets = planned.inspector.press, planned.given, planned.sheets
    console.log = RunLog.of(planned.facts, None if recorder is None else recorder.run_id)
    console.log.began(planned.facts)
    traces = planned.traces
    traced = None if traces is None else RunTraces(traces=traces, facts=planned.facts, recorder=recorder)
    if traced is not None and recorder is not None:
        recorder.committed = traced.committed
    notify = console.noticed
    with (
        _stoppable(recorder, console),
        plant.served(
            planned.facts,
            press,
            job_pages=planned.pages,
            plan=planned.plan,
            recorder=recorder,
            resumption=planned.resumption,
            notice=lambda one: notify(one),
            progress=show.steps(quiet=console.json),
        ) as served,
    ):
        console.phase, console.too_late = served.phase, served.too_late
        page_store = JobPageStore(
            job=planned.job,
            press=press,
            pages=planned.pages,
            sheets=sheets,
            plan=planned.plan,
            warnings=PageWarnings(lambda one: notify(one), planned.warnings),
        )
        before = _PreparedJob.of(planned, page_store)
        running = watched(
            planned.inspector,
            source=served.followed(given.source),
            page_store=page_store,
            start=planned.start,
            settings=planned.settings,
            keep=planned.keep,
            follow=planned.follow,
            false_alarms=planned.false_alarms,
            recorded=None
            if recorder is None or planned.resumption is None
            else recorder.journal.pages(recorder.run_id),
            tell=_decided_first(
                _timed(served.gate_observer, traced),
                _each(
                    partial(console.observe, recorder=recorder),
                    None if traced is None else traced.observe,
                    served.stream_observer,
                ),
            ),
            notice=_each(console.noticed, served.noticed),
            arrived=served.arrived,
            name=page_store.name,
            flaws={
                planned.position(number): error for number, error in planned.flaws.items() if number <= sheets
            },
            durable=(lambda: 0) if recorder is None else (lambda: recorder.durable),
            stored=before.load,
            store=before.save,
        )
        if given.camera is not None:
            console.cameras = given.camera.healths
            given.camera.tell = lambda kind, text: running.note(Notice(kind=kind, text=text))
        notify = running.note  # from now on it stands in the journal too
        if planned.resumption is not None:
            notify(Notice(kind="resumed", text=planned.resumption.message))
        stopped = console.until_ended(running)
        notify = console.noticed
        status = running.status()
        lacks = console.lacks(status, sheets=sheets)
        detail = "; ".join(filter(None, (console.stopped_text, lacks)))
        if recorder is not None:
            recorder.end(status, stopped=stopped, detail=detail)
        if traced is not None:
            traced.close()
        console.log.ended(status, ending_of(status, stopped=stopped))
        served.ended(ending_of(status, stopped=stopped), detail)
    return status


@contextmanager
def _stoppable(recorder: Recorder | None, console: Watching) -> Iterator[None]:
    """Let people end the run from other processes, if there is a journal next to which they ask for it."""
    if recorder is None:
        yield
        return
    from prooflight_line.journal.labels import run_key
    from prooflight_line.journal.run_control import RunControl
    from prooflight_line.journal.schema import JournalError

    control = RunControl(journal=recorder.journal.path)
    with control.stoppable():
        try:
            key = run_key(recorder.journal.run(recorder.run_id))
        except JournalError:  # the disk is full, and the run is not in the journal yet
            key = console.log.key or ""
        console.stop_request = partial(control.stop_request, key)
        yield


def _timed(
    decide: Callable[[Outcome], Outcome] | None, traced: RunTraces | None
) -> Callable[[Outcome], Outcome] | None:
    """Return the gate's function, timed for the traces if there are any."""
    return decide if decide is None or traced is None else traced.deciding(decide)


def _decided_first(
    decide: Callable[[Outcome], Outcome] | None, tell: Callable[[Outcome], None]
) -> Callable[[Outcome], None]:
    """Return a function that lets the gate decide a sheet before it is reported; ``decide`` None: there is no gate.

    A sheet that the gate fails to decide is reported as held.
    """
    if decide is None:
        return tell

    def observe(outcome: Outcome) -> None:
        decided = replace(outcome, record=replace(outcome.record, gate="hold"))
        try:
            decided = decide(outcome)
        finally:
            tell(decided)

    return observe


def _each(*tells: Callable[[Event], None] | None) -> Callable[[Event], None]:
    """Return a function that calls all given ones in order; an error of one does not keep the others from
    being called.
    """
    there = [one for one in reversed(tells) if one is not None]

    def tell(what: Event) -> None:
        with ExitStack() as stack:
            for one in there:
                stack.callback(one, what)

    return tell


def exit_code(status: Status, lacks: str) -> int:
    """Report why a run is incomplete or its false-alarm rate does not hold, if so; return its exit code."""
    from prooflight_line.run.status import Phase

    broke_off = status.phase is Phase.FAULT
    if status.promise_suspended:
        faults.report(suspended(status.promise_suspended))
    if broke_off or lacks:
        faults.report("; ".join(filter(None, (status.detail, lacks))))
    if broke_off and not status.good + status.misprints:
        return UNUSABLE_INPUT
    complete = not (broke_off or lacks)
    return of_run(misprints=status.misprints, complete=complete, overloaded=status.overloads > 0)


def start_file_of(journal: str | None) -> StartFile | None:
    """Return the file in which consoles read how far the start has got; None if there is no journal."""
    from prooflight_line.journal.opening import default_journal, journal_path
    from prooflight_line.journal.start import StartFile

    if journal == "none":
        return None
    return StartFile(journal=journal_path(journal or str(default_journal())))


@contextmanager
def lines_shown(planned: PlannedRun, journal: str | None) -> Iterator[PlannedRun]:
    """Give the run with a source that the console can view, if there is a journal next to which the view is stored."""
    if journal == "none":
        yield planned
        return
    from prooflight_line.cli.watch.camera_view import ShownLines
    from prooflight_line.journal.camera_view import CameraExchange
    from prooflight_line.journal.opening import default_journal, journal_path

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
def recorder_of(
    journal: str | None, facts: RunFacts, resumption: Resumption | None = None
) -> Iterator[Recorder | None]:
    """Give the recorder of a run in the journal of the option, new or resumed; None if there is to be none."""
    if journal == "none":
        yield None
        return
    from prooflight_line.journal.journal import Journal
    from prooflight_line.journal.opening import default_journal
    from prooflight_line.plant.gate.log import set_aside
    from prooflight_line.run.recording import Recorder

    if resumption is not None:
        with Journal.open(journal or str(default_journal())) as opened:
            resumption.take_over(opened)
            with Recorder(
                opened, resumption.run_id, recorded=opened.run(resumption.run_id).pages
            ) as recorder:
                yield recorder
        return
    with (
        Journal.open(journal or str(default_journal())) as opened,
        Recorder(opened, opened.begin_run(facts)) as recorder,
    ):
        if (aside := set_aside(opened.path, recorder.run_id)) is not None:
            faults.report(
                f"{aside} is the gate's log of a run that this journal does not know; it was put aside"
            )
        yield recorder
