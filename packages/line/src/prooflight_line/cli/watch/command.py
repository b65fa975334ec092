"""``prooflight watch``: live inspection of the running press."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import typer

from prooflight.cli import event_log, show
from prooflight.cli.option_groups import with_options
from prooflight.errors import RequestError
from prooflight_line.cli.watch.options import WatchOptions

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight_line.cli.watch.planned_run import PlannedRun
    from prooflight_line.cli.watch.view import Watching
    from prooflight_line.job_queue.tickets.ticket import Ticket
    from prooflight_line.run.status import Status


def register(program: typer.Typer) -> None:
    """Add the command to the program."""
    program.command()(with_options(watch, WatchOptions))


def watch(
    options: WatchOptions,
    context: typer.Context = None,  # type: ignore[assignment]  # typer gives it; a call from Python has no queue
) -> None:
    """Inspect a press while it runs, and report every misprint with its place.

    Exits 1 if there was a misprint, 3 if not every sheet arrived, was inspected and was recorded, 5 if
    inspection could not keep up. Ctrl-C ends cleanly: sheets that have passed are still inspected; a second one skips
    them, and reports that.
    """
    from prooflight.inspection.inspector import Inspector
    from prooflight.pages.process import settle_process
    from prooflight.press.artefact import Press
    from prooflight_line.cli.watch import on_start as starting
    from prooflight_line.cli.watch.job import ReadJob
    from prooflight_line.cli.watch.planned_run import PlannedRun
    from prooflight_line.job_queue.hot_folder import HotFolder
    from prooflight_line.job_queue.listing import ticket_of
    from prooflight_line.reporting.traces import Traces
    from prooflight_line.run.status import Phase

    event_log.begin(options.log)
    record, start, inspection = options.record, options.start, options.inspection
    if record.keep not in ("all", "misprints", "none"):
        raise RequestError("keep", f"there is no {record.keep!r}", remedy="choose all, misprints or none")
    if start.on_start:
        starting.refuse_unfit(options)
    if start.started:
        context.with_resource(starting.started(options.job, start.started, record.journal))
    traces = Traces.of_environment()
    press = Press.load(options.press)
    inspector = Inspector.of(press, inspection.detector).on(
        inspection.device
    )  # a wrong name ends before any work
    if start.on_start:
        arguments, say = context.find_root().obj, show.steps(quiet=options.json)
        starting.run_on_start(options.job, journal=record.journal, arguments=arguments, say=say)
        return
    taken = ticket = None
    if start.queue:
        taken = context.with_resource(HotFolder.open(options.job).printing(start.started or None))
        ticket = ticket_of(taken.entry)
        options = _as_queued(options, taken.entry.file, ticket, context)
    if options.json:
        show.print_json({"phase": "preparing", "detail": "reading the job"})
    read = ReadJob.of(options, inspector, ticket)
    read.plant.refuse_unfit(options.source, press, deadline_s=inspection.deadline_ms / 1e3)
    planned = PlannedRun.of(options, replace(inspector, zones=read.zones), read, traces=traces)
    console = _display(planned)
    settle_process()
    status, unrecorded = _run(planned, console)
    if taken is not None:
        taken.finished = status.phase is Phase.STOPPED and not status.to_come
    _end(planned, status, console, unrecorded=unrecorded)


def _as_queued(
    options: WatchOptions, job: Path, ticket: Ticket | None, context: typer.Context
) -> WatchOptions:
    """Return the options with a job of the queue, and with what its ticket says where the command line says nothing."""
    record = options.record
    if ticket is not None and ticket.keep and not _given(context, "keep"):
        record = replace(record, keep=ticket.keep)
    if ticket is not None and ticket.sample is not None and not _given(context, "sample"):
        record = replace(record, sample=ticket.sample)
    return replace(options, job=job, record=record)


def _given(context: typer.Context, option: str) -> bool:
    """Return whether an option was given, and is not its default."""
    source = context.get_parameter_source(option)
    return source is not None and source.name not in ("DEFAULT", "DEFAULT_MAP")


def _display(planned: PlannedRun) -> Watching:
    """Return the display of a run, for people or for programs."""
    from prooflight.inspection.sheets import NEXT, Assembling
    from prooflight_line.cli.watch.view import Watching

    options, plan, resumption = planned.options, planned.read.plan, planned.resumption
    return Watching(
        deadline_s=None if planned.given.waits else planned.settings.deadline_s,
        json=options.json,
        at_once=options.pace.start_at_once,
        waits=planned.given.waits,
        start_file=planned.start_file,
        sheets=None if plan is None else Assembling(plan, patience=NEXT),
        first_passed="" if resumption is None else resumption.past.first_not_inspected,
    )


def _run(planned: PlannedRun, display: Watching) -> tuple[Status, int]:
    """Watch until the run ends; return its status, and how many verdicts were not recorded."""
    from prooflight_line.cli.watch.console import console_alongside
    from prooflight_line.cli.watch.running import lines_shown, recorder_of, run_until_ended

    options = planned.options
    journal, console = options.record.journal, options.console
    with (
        console_alongside(
            console.serve,
            journal=journal,
            press=options.press,
            job=options.job,
            port=console.serve_port,
            trays=console.trays,
        ),
        recorder_of(journal, planned.facts, planned.resumption) as recorder,
        lines_shown(planned, journal) as shown,
    ):
        status = run_until_ended(shown, recorder, display)
    return status, 0 if recorder is None else recorder.unrecorded


def _end(planned: PlannedRun, status: Status, display: Watching, *, unrecorded: int) -> None:
    """Show how a run ended, and end the command with the exit code of that."""
    from prooflight_line.cli.watch.running import exit_code

    display.end_sheets()
    if not planned.options.json:
        show.people.print(display.line(status))
    code = exit_code(status, display.lacks(status, sheets=planned.read.passings, unrecorded=unrecorded))
    if code:
        raise typer.Exit(code)
