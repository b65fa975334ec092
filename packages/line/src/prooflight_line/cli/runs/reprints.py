"""``prooflight run reprint-job`` and ``reprinted``: sheets to print again as a job, and what its run leaves."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.cli.options import Json
from prooflight.errors import RequestError, visible
from prooflight.reporting.wording import count
from prooflight_line.cli.runs.gate import TraysFile
from prooflight_line.cli.runs.journals import JournalUrl, RunNumber, reading, run_of

REMAINS = 3
"""Exit code of ``run reprinted`` if sheets must be printed once more."""


def register_of_runs(app: typer.Typer) -> None:
    """Add these commands to ``prooflight run``."""
    app.command("reprint-job")(reprint_job)
    app.command()(reprinted)


def reprint_job(
    job: Annotated[Path, typer.Option("--job", metavar="JOB.pdf", help="The PDF that the run printed.")],
    out: Annotated[
        Path,
        typer.Option(
            "-o",
            "--out",
            metavar="AGAIN.pdf",
            help="PDF to write; its list goes to AGAIN.json, its ticket, in XJDF, to AGAIN.xjdf.",
        ),
    ],
    run: RunNumber = "last",
    trays: TraysFile = None,
    journal: JournalUrl = None,
) -> None:
    """Write the pages of all sheets to print again as one PDF, in the order of the reprint list, and its ticket."""
    from prooflight.files.atomic import whole_file
    from prooflight.files.content import content_digest
    from prooflight.pages.pdf.rip import PdfJob
    from prooflight_line.plant.reprint_job import ReprintJob, reprint_sheets
    from prooflight_line.plant.run_messages import reprint_ticket
    from prooflight_line.run_package.accounts import accounts_of

    if out.suffix.lower() != ".pdf":
        raise RequestError(out, "is not the name of a PDF", remedy="end it in .pdf")
    with reading(journal) as opened:
        row = run_of(opened, run)
        listed, _ = accounts_of(opened, row, trays)
    if content_digest(job) != row.facts.job_digest:
        what = f"is not the job of run {row.id}, {row.facts.job}"
        raise RequestError(job, what, remedy="give the file that was printed, unchanged")
    sheets = reprint_sheets(listed)
    with whole_file(out) as unfinished, PdfJob(job) as pdf:
        pdf.extract([page for sheet in sheets for page in sheet.pages], unfinished)
    again = ReprintJob(
        run=row.id,
        started_s=row.facts.started_s,
        job=row.facts.job,
        job_digest=content_digest(out),
        sheets=sheets,
    )
    with whole_file(out.with_suffix(".json")) as unfinished:
        unfinished.write_text(again.text, encoding="utf-8")
    with whole_file(out.with_suffix(".xjdf")) as unfinished:
        unfinished.write_bytes(reprint_ticket(again, row, file=out.name, time_s=time.time()))
    show.written(out)
    show.people.print(
        f"{count(len(sheets), 'sheet')}, {count(len(again.pages), 'page')}; print it with the run's layout"
    )


def reprinted(
    again: Annotated[
        Path, typer.Argument(metavar="AGAIN.json", help="List that `run reprint-job` wrote next to its PDF.")
    ],
    run: RunNumber = "last",
    trays: TraysFile = None,
    journal: JournalUrl = None,
    json: Json = False,
) -> None:
    """Reconcile a reprint with the run that printed it; exits 3 if sheets must be printed once more."""
    from prooflight_line.plant.reprint_job import ReprintJob, facts_of, remaining
    from prooflight_line.run_package.accounts import accounts_of

    job = ReprintJob.read(again)
    with reading(journal) as opened:
        row = run_of(opened, run)
        left = remaining(job, row, accounts_of(opened, row, trays)[0])
    if json:
        show.print_json(facts_of(job, left))
    else:
        done = len(job.sheets) - len(left)
        show.people.print(
            f"{done} of {count(len(job.sheets), 'sheet')} of run {job.run} were printed well in run {row.id}."
        )
        headings = ("copy", "page", "set", "belongs after")
        table = show.table_of("To print once more", headings, text_columns=headings[1:])
        for one in left:
            number = f"{one.number} ({visible(one.page)})"
            table.add_row(str(one.copy), number, str(one.set_number), visible(one.behind or "nothing"))
        if left:
            show.people.print(table)
    if left:
        raise typer.Exit(REMAINS)
