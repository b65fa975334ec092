"""``prooflight queue``: jobs that come by themselves, from a hot folder to the press's queue."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.text import Text

from prooflight.cli import event_log, faults, show
from prooflight.cli.event_log import LogOption
from prooflight.cli.options import Json, Profile
from prooflight.errors import visible
from prooflight.reporting.wording import count

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight_line.job_queue.examining import Examined, PageResult
    from prooflight_line.job_queue.filling import TakenIn
    from prooflight_line.job_queue.hot_folder import Entry
    from prooflight_line.job_queue.listing import Listed
    from prooflight_line.job_queue.tickets.ticket import Ticket

WAIT_S: Final = 600.0
"""Value of ``pairing.WAIT_S``."""
SETTLE_S: Final = 2.0
"""Assumed: a copy over a network pauses for less."""
AGAIN_S: Final = 10.0
"""Time after which work goes on that this machine failed at, as on a full disk."""

FolderPath = Annotated[Path, typer.Argument(metavar="FOLDER", help="Hot folder, on a disk of this machine.")]

app = typer.Typer(help="Take jobs from a hot folder, check and queue them.", no_args_is_help=True)


def register(program: typer.Typer) -> None:
    """Add these commands to the program."""
    program.add_typer(app, name="queue")


@app.command()
def fill(
    folder: FolderPath,
    press: Annotated[
        Path | None,
        typer.Option("--press", metavar="X.press", help="Press for which jobs are checked and prepared."),
    ] = None,
    profile: Profile = None,
    settle: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="Time for which a file must not change.", min=0.1, max=3600),
    ] = SETTLE_S,
    wait: Annotated[
        float,
        typer.Option(
            metavar="SECONDS", help="Time for which a ticket waits for its file.", min=0, max=86_400
        ),
    ] = WAIT_S,
    tickets: Annotated[
        bool, typer.Option("--tickets", help="Every job has a ticket: a file waits as long for it.")
    ] = False,
    once: Annotated[
        bool, typer.Option("--once", help="Take in the files that are complete now, and end.")
    ] = False,
    json: Json = False,
    log: LogOption = "text",
) -> None:
    """Take jobs from a hot folder as they arrive: queue the good ones, reject the others with a reason.

    Runs until it is ended, at any moment and in any way: nothing is lost, and the next start continues.
    """
    from prooflight.inspection.inspector import Inspector
    from prooflight.press.artefact import Press
    from prooflight_line.job_queue.arrivals import Arrivals
    from prooflight_line.job_queue.examining import examine
    from prooflight_line.job_queue.filling import fill_once
    from prooflight_line.job_queue.hot_folder import HotFolder
    from prooflight_line.job_queue.pairing import Pairing

    event_log.begin(log)
    inspector = None if press is None else Inspector(Press.load(press))
    opened = HotFolder.open(folder)

    def examined(path: Path, ticket: Ticket | None) -> Examined:
        def shown(results: Iterator[PageResult], pages: int) -> Iterator[PageResult]:
            return results if json else show.progress(results, total=pages, what=f"checking {path.name}")

        return examine(path, ticket, inspector=inspector, profile=profile, shown=shown)

    arrivals = Arrivals(folder=folder, settle_s=settle)
    pairing = Pairing(folder=opened, wait_s=wait, needed=tickets)
    with opened.filling():
        if once:
            arrivals.whole()  # each file's state, with which its state after this time is compared
            time.sleep(settle)
        while True:
            try:
                for one in fill_once(opened, arrivals, examined, pairing):
                    show_taken_in(one, json=json)
            except OSError as error:
                if once:
                    raise
                faults.report(
                    f"{error.filename or folder}: {error.strerror or error}; tried again in {AGAIN_S:g} s"
                )
                time.sleep(AGAIN_S)
            if once:
                break
            arrivals.wait()


@app.command("list")
def list_jobs(folder: FolderPath, json: Json = False) -> None:
    """List the jobs of a hot folder in the order of printing: their stage, and the facts of ticket and file."""
    from prooflight_line.job_queue.hot_folder import STAGES, HotFolder
    from prooflight_line.job_queue.listing import listed

    entries = HotFolder.open(folder).entries(*STAGES)
    if json:
        show.print_json([_facts(entry) for entry in entries])
        return
    columns = ("job", "is", "ordered", "file", "why")
    table = show.table_of(str(folder), ("number", *columns), text_columns=columns)
    for job in listed(entries):
        cells = (job.name, job.stage, ordered(job.ticket), seen(job), job.reason)
        table.add_row(str(job.number), *map(visible, cells))
    show.people.print(table)


def show_taken_in(taken: TakenIn, *, json: bool) -> None:
    """Print where a job has ended."""
    from prooflight_line.job_queue.listing import ticket_of

    entry, examined = taken.entry, taken.examined
    event_log.write(
        "job",
        level=logging.INFO if entry.stage == "queued" else logging.WARNING,
        **_facts(entry),
        pages=examined.pages,
        warnings=examined.warnings,
        prepared=examined.prepared,
    )
    if json:
        prepared = {"warnings": examined.warnings, "prepared": examined.prepared, "remark": examined.remark}
        show.print_json(_facts(entry) | {"pages": examined.pages} | prepared)
        return
    remark = entry.reason
    if entry.stage == "queued":
        parts = [count(examined.pages, "page"), count(examined.warnings, "warning")]
        parts += filter(None, (ordered(ticket_of(entry)), examined.records, examined.condition))
        parts += examined.notes
        parts += ["prepared"] if examined.prepared else [examined.remark] if examined.remark else []
        remark = ", ".join(parts)
    style = "yellow" if entry.stage == "rejected" else ""
    line = Text.assemble(
        (entry.stage, style), f" {entry.number} {visible(entry.file.name)}: {visible(remark)}"
    )
    show.people.print(line, soft_wrap=True)


def ordered(ticket: Ticket | None) -> str:
    """Return what a job's ticket says, in a few words; None: it has none that can be read."""
    if ticket is None:
        return ""
    weight = "" if ticket.weight_gsm is None else f"{ticket.weight_gsm:g} g/m2"
    copies = "" if ticket.copies is None else f"{ticket.copies:,} copies"
    paper = " ".join(filter(None, (ticket.brand, weight)))
    named = " ".join(filter(None, (ticket.job_id, ticket.name)))
    return ", ".join(filter(None, (named, ticket.customer, copies, ticket.layout, paper)))


def seen(job: Listed) -> str:
    """Return what was seen in a job's file, in a few words; empty: it was not examined."""
    pages = [] if job.pages is None else [count(job.pages, "page")]
    return ", ".join([*pages, *job.of_file, *job.notes])


def _facts(entry: Entry) -> dict[str, Any]:
    from prooflight_line.job_queue.listing import ticket_of

    ticket = ticket_of(entry)
    return {
        "number": entry.number,
        "job": entry.file.name,
        "stage": entry.stage,
        "path": str(entry.file),
        "reason": entry.reason,
        "ticket": None if ticket is None else ticket.facts,
        "examined": entry.examined,
    }
