"""A run of ``prooflight watch`` from its first line to its exit code."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Self, TypeVar, cast

from prooflight.cli import faults, show
from prooflight.cli.exit_codes import UNUSABLE_INPUT, of_run
from prooflight.reporting.wording import suspended
from prooflight_line.run.notices import Notice

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator

    from prooflight.inspection.packed_design import PackedDesign
    from prooflight.inspection.prepared_store import PreparedStore
    from prooflight_line.cli.watch.planned_run import PlannedRun
    from prooflight_line.cli.watch.plant import ServedPlant
    from prooflight_line.cli.watch.resuming import Resumption
    from prooflight_line.cli.watch.view import Watching
    from prooflight_line.journal.records import RunFacts
    from prooflight_line.reporting.traces import RunTraces
    from prooflight_line.run.notices import PageWarnings
    from prooflight_line.run.outcomes import Outcome
    from prooflight_line.run.prefetch import JobPageStore
    from prooflight_line.run.recording import Recorder
    from prooflight_line.run.runner import Running
    from prooflight_line.run.sheet_inspector import Keep
    from prooflight_line.run.status import Status

Event = TypeVar("Event")


@dataclass(frozen=True, slots=True, kw_only=True)
class _PreparedJob:
    """Designs of a job that were prepared before, and those that this run prepares for later ones."""

    store: PreparedStore | None
    warnings: PageWarnings | None

    @classmethod
    def of(cls, planned: PlannedRun, page_store: JobPageStore) -> Self:
        from prooflight.inspection.prepared_store import MOST_BYTES, PreparedStore, clean

        store = PreparedStore.of(planned.inspector, planned.read.source)
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


def run_until_ended(planned: PlannedRun, recorder: Recorder | None, console: Watching) -> Status:
    """Watch until the lines end or a person stops the run, and return its final status."""
    from prooflight_line.cli.watch.run_log import RunLog

    console.log = RunLog.of(planned.facts, None if recorder is None else recorder.run_id)
    console.log.began(planned.facts)
    traced = _traced(planned, recorder)
    notices = _Notices(console.noticed)
    with (
        _stoppable(recorder, console),
        planned.read.plant.served(
            planned.facts,
            planned.inspector.press,
            job_pages=planned.read.pages,
            plan=planned.read.plan,
            recorder=recorder,
            resumption=planned.resumption,
            notice=notices,
            progress=show.steps(quiet=console.json),
        ) as served,
    ):
        console.phase, console.too_late = served.phase, served.too_late
        running = _ready(planned, served, recorder, console, traced, notices)
        notices.receive = running.note  # from now on they stand in the journal too
        _connect_camera(planned, running, console)
        if planned.resumption is not None:
            notices(Notice(kind="resumed", text=planned.resumption.message))
        stopped = console.until_ended(running)
        notices.receive = console.noticed
        status = running.status()
        _end(status, stopped, planned, served, recorder, console, traced)
    return status


@dataclass(slots=True)
class _Notices:
    """Receiver of notices that may be exchanged: the run, while it goes on, and the display before and after."""

    receive: Callable[[Notice], None]

    def __call__(self, notice: Notice) -> None:
        self.receive(notice)


def _traced(planned: PlannedRun, recorder: Recorder | None) -> RunTraces | None:
    """Return the traces of the run's sheets, if any are made; they learn what the recorder has committed."""
    from prooflight_line.reporting.traces import RunTraces

    if planned.traces is None:
        return None
    traced = RunTraces(traces=planned.traces, facts=planned.facts, recorder=recorder)
    if recorder is not None:
        recorder.committed = traced.committed
    return traced


def _ready(
    planned: PlannedRun,
    served: ServedPlant,
    recorder: Recorder | None,
    console: Watching,
    traced: RunTraces | None,
    notices: _Notices,
) -> Running:
    """Return the run, ready to start; sheets and notices go to the gate, the display, the traces and the plant."""
    from prooflight_line.run.decided_first import DecidedFirst
    from prooflight_line.run.notices import PageWarnings
    from prooflight_line.run.prefetch import JobPageStore
    from prooflight_line.run.watching import watched

    page_store = JobPageStore(
        job=planned.read.source,
        press=planned.inspector.press,
        pages=planned.read.pages,
        sheets=planned.read.passings,
        plan=planned.read.plan,
        warnings=PageWarnings(notices, planned.read.early.warnings),
    )
    before = _PreparedJob.of(planned, page_store)
    decided_first = DecidedFirst(
        decide=_timed(served.gate_observer, traced),
        tell=_each(
            partial(console.observe, recorder=recorder),
            None if traced is None else traced.observe,
            served.stream_observer,
        ),
    )
    recorded = None
    if recorder is not None and planned.resumption is not None:
        recorded = recorder.journal.pages(recorder.run_id)
    return watched(
        planned.inspector,
        source=served.followed(planned.given.source),
        page_store=page_store,
        start=planned.start,
        settings=planned.settings,
        keep=cast("Keep", planned.options.record.keep),
        follow=planned.options.pace.follow,
        false_alarms=planned.options.false_alarms,
        recorded=recorded,
        tell=decided_first,
        misprint=decided_first.early,
        notice=_each(console.noticed, served.noticed),
        arrived=served.arrived,
        name=page_store.name,
        flaws={
            planned.position(number): error
            for number, error in planned.read.flaws.items()
            if number <= planned.read.passings
        },
        durable=(lambda: 0) if recorder is None else (lambda: recorder.durable),
        stored=before.load,
        store=before.save,
    )


def _connect_camera(planned: PlannedRun, running: Running, console: Watching) -> None:
    """Let the display show the health of the source's cameras, and the run report when one is away."""
    camera = planned.given.camera
    if camera is not None:
        console.cameras = camera.healths
        camera.tell = lambda kind, text: running.note(Notice(kind=kind, text=text))


def _end(
    status: Status,
    stopped: bool,
    planned: PlannedRun,
    served: ServedPlant,
    recorder: Recorder | None,
    console: Watching,
    traced: RunTraces | None,
) -> None:
    """Record and publish how the run ended; ``stopped`` if a person ended it."""
    from prooflight_line.run.recording import ending_of

    lacks = console.lacks(status, sheets=planned.read.passings)
    detail = "; ".join(filter(None, (console.stopped_text, lacks)))
    if recorder is not None:
        recorder.end(status, stopped=stopped, detail=detail)
    if traced is not None:
        traced.close()
    ending = ending_of(status, stopped=stopped)
    console.log.ended(status, ending)
    served.ended(ending, detail)


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
                f"{aside} is the gate's log of a run that is not in this journal; it was moved there"
            )
        yield recorder
