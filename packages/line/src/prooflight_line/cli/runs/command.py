"""Runs in the journal: ``prooflight runs``, and one run: ``run show``, export, replay, reconcile, tidy."""

from __future__ import annotations

import sys
import time
from collections import deque
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from prooflight.cli import faults, imposition, show
from prooflight.cli.exit_codes import UNUSABLE_INPUT
from prooflight.cli.options import Json
from prooflight.errors import RequestError, visible
from prooflight.reporting.wording import count
from prooflight_line.cli.runs import causes, feedback, package, reprints
from prooflight_line.cli.runs import gate as run_gate
from prooflight_line.cli.runs import sheets as sheets_of_run
from prooflight_line.cli.runs.gate import TraysFile
from prooflight_line.cli.runs.journals import JournalUrl, RunNumber, reading, run_of, url_of

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import TextIO

    from prooflight_line.journal.aside import Unclaimed
    from prooflight_line.journal.journal import Journal
    from prooflight_line.journal.records import Due, PageRecord, Retention, RunRow, Tidied
    from prooflight_line.journal.schema import JournalError

DAMAGED_SHOWN = 5
"""Number of damaged rows that are named; the rest are counted."""
DIFFERS = 1
"""Exit code of ``run replay`` if a figure differs."""
STATE_STYLE = {
    "running": "cyan",
    "interrupted": "yellow",
    "finished": "green",
    "stopped": "yellow",
    "fault": "bold red",
}
COUNTS = {
    "misprints": "misprints",
    "not_inspected": "not inspected",
    "late": "late",
    "faulty": "faults",
    "dropped_pages": "not recorded",
}
"""Counts in a list of runs, shown if any of the runs has some."""

app = typer.Typer(
    help="Show, label, export, package, replay or reconcile one run of the journal; tidy up.",
    no_args_is_help=True,
)

feedback.register_of_runs(app)
causes.register_of_runs(app)
reprints.register_of_runs(app)
package.register_of_runs(app)


def register(program: typer.Typer) -> None:
    """Add these commands to the program."""
    program.command()(runs)
    program.add_typer(app, name="run")


def runs(
    journal: JournalUrl = None,
    last: Annotated[int | None, typer.Option(metavar="N", help="Show the last N runs only.", min=1)] = None,
    json: Json = False,
) -> None:
    """List all runs in the journal, oldest first."""
    from prooflight_line.journal.exporting import run_facts

    damaged = Damaged()
    with reading(journal) as opened:
        listed = opened.runs(damaged=damaged.add)[-last if last else 0 :]
        path = opened.path
    if json:
        show.print_json([run_facts(run) for run in listed])
    else:
        show.people.print(_runs_table(listed, path))
    damaged.report()


def _runs_table(listed: list[RunRow], path: Path) -> Table:
    table = Table(title=f"Runs in {path}", title_justify="left")
    for heading in ("run", "began", "state", "job"):
        table.add_column(
            heading, no_wrap=heading in ("run", "state"), min_width=len("2026-11-21") * (heading == "began")
        )
    table.add_column("pages", justify="right", no_wrap=True)
    shown = [name for name in COUNTS if any(getattr(run, name) for run in listed)]
    for name in shown:
        table.add_column(COUNTS[name], justify="right")
    for run in listed:
        table.add_row(
            str(run.id),
            _local(run.facts.started_s),
            Text(run.state, style=STATE_STYLE[run.state]),
            visible(run.facts.job),
            f"{run.pages:,}",
            *(f"{getattr(run, name):,}" if getattr(run, name) else "" for name in shown),
        )
    return table


@app.command("show")
def show_run(
    run: RunNumber = "last",
    journal: JournalUrl = None,
    every: Annotated[bool, typer.Option("--all", help="Show good pages as well.")] = False,
    last: Annotated[int, typer.Option(metavar="N", help="Show the last N of the pages.", min=1)] = 40,
    csv: Annotated[bool, typer.Option("--csv", help="Print all pages as CSV.")] = False,
    sheets: Annotated[
        bool, typer.Option("--sheets", help="With --json, print its sheets and sets instead of its pages.")
    ] = False,
    json: Json = False,
) -> None:
    """Show one run: its facts, and the pages that a person should examine; --json and --csv print all its pages."""
    damaged = Damaged()
    with reading(journal) as opened:
        run_row = run_of(opened, run)
        if json or csv:
            if sheets and json:
                sheets_of_run.run_facts(opened, run_row, damaged=damaged.add)
            else:
                _write_pages(opened.pages(run_row.id, damaged=damaged.add), json=json)
            damaged.report()
            return
        shown, total = _last_pages(opened.pages(run_row.id, passed=every, damaged=damaged.add), last)
        assembled = sheets_of_run.of_run(opened, run_row, damaged=damaged.add)
        _print_run(run_row, opened)
    if total:
        show.people.print(_page_table(shown, title="All pages" if every else "Pages to check"))
    elif not damaged.count:
        show.people.print(
            "Every page was good, in time and without a fault." if run_row.pages else "No pages."
        )
    if total > len(shown):
        show.people.print(
            f"{count(total - len(shown), 'page')} before these; see --last, or `prooflight run export`"
        )
    if assembled is not None:
        imposition.print_sheets([*assembled.sheets, *assembled.sets], assembled.counts, last=last)
    elif sheets:
        show.people.print("The run was watched without --layout: every page is a sheet of its own.")
    damaged.report()


def _write_pages(pages: Iterable[PageRecord], *, json: bool) -> None:
    """Print pages for programs, as JSON or as CSV."""
    from prooflight_line.journal.exporting import page_facts, write_csv

    if json:
        show.print_json([page_facts(page) for page in pages])
    else:
        write_csv(pages, sys.stdout)


def _last_pages(pages: Iterable[PageRecord], last: int) -> tuple[deque[PageRecord], int]:
    """Return the last pages, and how many there are in all."""
    total = 0
    shown: deque[PageRecord] = deque(maxlen=min(last, sys.maxsize))
    for page in pages:
        total += 1
        shown.append(page)
    return shown, total


def _print_run(run: RunRow, journal: Journal) -> None:
    """Print a run's facts, its hold, its warnings and the labels of its sample."""
    from prooflight_line.journal.exporting import job_warnings
    from prooflight_line.journal.labels import LabelStore, run_key
    from prooflight_line.run.labelled_sheets import sample_of_run

    labels = LabelStore(journal.path)
    sampled, hold = sample_of_run(journal, labels, run), labels.on_hold().get(run_key(run))
    show.people.print(_facts_table(run))
    if hold is not None:
        show.people.print(f"On legal hold since {_local(hold.at_s)}, by {hold.by}: {hold.note}")
    for line in job_warnings(run):
        show.people.print(f"warning: {line}")
    if run.facts.settings.get("sample") or any(one.label for one in sampled):
        for line in feedback.sample_lines(run, sampled):
            show.people.print(line)
        if open_questions := sum(not one.state for one in sampled):
            show.people.print(
                f"not yet labelled: {count(open_questions, 'sheet')}; see `prooflight run sampled {run.id}`"
            )


@app.command()
def pair(
    fronts: Annotated[str, typer.Argument(metavar="FRONTS", help="Run of the fronts, or `last`.")],
    backs: Annotated[str, typer.Argument(metavar="BACKS", help="Run of the backs, or `last`.")],
    journal: JournalUrl = None,
    backs_journal: Annotated[
        str | None,
        typer.Option(
            "--backs-journal", metavar="URL", help="Journal of the backs; default that of the fronts."
        ),
    ] = None,
    pages_a_set: Annotated[
        int | None, typer.Option(metavar="N", help="Number of pages, of both sides, in a set.", min=2)
    ] = None,
    json: Json = False,
) -> None:
    """Pair two runs of a press with a camera a side into sheets; exits 1 for a misprint, 3 for a missing side."""
    from prooflight_line.cli.runs.sheets import pair as of_sides

    damaged = Damaged()
    with reading(journal) as of_fronts, reading(backs_journal or journal) as of_backs:
        one, other = (of_fronts, run_of(of_fronts, fronts)), (of_backs, run_of(of_backs, backs))
        if one[0].path == other[0].path and one[1].id == other[1].id:
            what = f"run {one[1].id} is given for fronts and for backs"
            raise RequestError("run pair", what, remedy="give two runs, or --backs-journal")
        try:
            of_sides(one, other, pages_a_set=pages_a_set, damaged=damaged.add, json=json)
        finally:
            damaged.report()


@app.command()
def export(
    run: RunNumber = "last",
    journal: JournalUrl = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write CSV, the default.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Write JSON, one object a line.")] = False,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help="File to write; default standard output."),
    ] = None,
) -> None:
    """Export all pages of one run as CSV or JSON."""
    from prooflight.files.atomic import whole_file

    if csv and json:
        raise RequestError("run export", "cannot write both CSV and JSON", remedy="choose one")
    damaged = Damaged()
    with reading(journal) as opened:
        pages = opened.pages(run_of(opened, run).id, damaged=damaged.add)
        if out is None:
            _write(pages, sys.stdout, json=json)
        else:
            with whole_file(out) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as file:
                _write(pages, file, json=json)
    damaged.report()


@app.command()
def replay(
    run: RunNumber,
    sheet: Annotated[int, typer.Argument(metavar="SHEET", help="Number of the sheet in its run.")],
    press: Annotated[Path, typer.Option("--press", metavar="X.press", help="The press artefact of the run.")],
    journal: JournalUrl = None,
    json: Json = False,
) -> None:
    """Recalculate a verdict from the stored evidence; exits 1 if a figure differs."""
    from prooflight.inspection.redeciding import replayed
    from prooflight_line.run_package.accounts import press_of_run

    with reading(journal) as opened:
        run_row = run_of(opened, run)
        loaded = press_of_run(press, name=run_row.facts.press, digest=run_row.facts.press_digest)
        page = opened.page(run_row.id, sheet)
        where = opened.path
    if page.evidence is None:
        what = f"no evidence of sheet {sheet} of run {run_row.id} is stored"
        raise RequestError(where, what, remedy="store more, or for longer: see docs/how-to/journal.md")
    figures = replayed(page.verdict, page.evidence, loaded)
    same = all(figure.same for figure in figures)
    if json:
        rows = {figure.name: {"recorded": figure.recorded, "again": figure.again} for figure in figures}
        show.print_json(
            {
                "run": run_row.id,
                "sheet": sheet,
                "page": page.verdict.page,
                "same": same,
                "promise_suspended": page.verdict.promise_suspended,
                "figures": rows,
            }
        )
    else:
        headings = ("", "recorded", "again", "")
        parts = (f"Sheet {sheet} of run {run_row.id}", page.verdict.page, show.reserved(page.verdict))
        title = ", ".join(filter(None, parts))
        table = show.table_of(title, headings, text_columns=headings)
        for figure in figures:
            label = Text("same", style="green") if figure.same else Text("differs", style="bold red")
            table.add_row(figure.name.replace("_", "-"), str(figure.recorded), str(figure.again), label)
        show.people.print(table)
    if not same:
        raise typer.Exit(DIFFERS)


@app.command()
def reconcile(
    run: RunNumber = "last", trays: TraysFile = None, journal: JournalUrl = None, json: Json = False
) -> None:
    """Account for every sheet of a run with a gate, in the journal and in the trays alike.

    Exits 1 if a sheet is in the good tray against its decision, 3 if one has a verdict and was not seen at the gate,
    or if the controller's log differs from what the controller reported over the wire.
    """
    with reading(journal) as opened:
        run_gate.reconcile(opened, run_of(opened, run), trays=trays, json=json)


@app.command("reprint-list")
def reprint_list(
    run: RunNumber = "last",
    trays: TraysFile = None,
    journal: JournalUrl = None,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE.json", help="File to write; default standard output."),
    ] = None,
    json: Json = False,
) -> None:
    """List every sheet that the job needs and that is not in the good tray, its position in the stack, and why.

    For a run without a gate, list every sheet that was not judged good, nor labelled a false alarm, nor
    released manually.
    """
    with reading(journal) as opened:
        run_gate.reprint_list(opened, run_of(opened, run), trays=trays, out=out, json=json)


@app.command()
def hold(
    run: RunNumber,
    reason: Annotated[str, typer.Option(metavar="TEXT", help="Why; recorded.")],
    by: Annotated[str, typer.Option(metavar="NAME", help="Name of the person who decides it.")],
    lift: Annotated[bool, typer.Option("--lift", help="End the hold.")] = False,
    journal: JournalUrl = None,
) -> None:
    """Put a run on legal hold: tidying removes nothing of it until the hold is lifted."""
    from prooflight_line.journal.labels import LabelStore, run_key

    with reading(journal) as opened:
        run_row = run_of(opened, run)
        label_store = LabelStore(opened.path)
    label_store.hold(run=run_key(run_row), by=by, at_s=time.time(), reason=reason, lift=lift)
    show.people.print(f"Run {run_row.id} is {'no longer ' if lift else ''}on legal hold")


@app.command()
def tidy(
    days: Annotated[
        float, typer.Option(help="Days for which runs are stored after their end.", min=0.001)
    ] = float("inf"),
    megabytes: Annotated[
        float,
        typer.Option(
            help="Megabytes that remain; the oldest evidence is removed first, then runs.", min=0.001
        ),
    ] = float("inf"),
    rules: Annotated[
        Path | None,
        typer.Option("--rules", metavar="RULES.toml", help="Rules by customer and class, instead of --days."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="List what would be removed, and remove nothing.")
    ] = False,
    journal: JournalUrl = None,
    json: Json = False,
) -> None:
    """Remove runs and evidence beyond the given age or size; the last run stays. Exits 2 if something had to stay.

    Runs and evidence to be removed by age are listed first.
    """
    from prooflight_line.journal.journal import Journal
    from prooflight_line.plant.gate.log import log_path

    retention = _retention(days=days, megabytes=megabytes, rules=rules)
    if dry_run:
        if megabytes < float("inf"):
            remedy = "leave --megabytes out: the evidence to remove for it is determined during removal"
            raise RequestError("run tidy", "--dry-run lists only what is removed by its age", remedy=remedy)
        with reading(journal) as seen:
            _print_due(seen.due(retention, now_s=time.time()), json=json)
        return
    messages: list[str] = []
    with Journal.open(url_of(journal), announce=messages.append) as opened:
        if not json:
            _print_due(opened.due(retention, now_s=time.time()), json=False)
        tidied = opened.tidy(retention, now_s=time.time())
        for removed in tidied.runs:
            log_path(opened.path, removed).unlink(missing_ok=True)
        runs_left, megabytes_left = len(opened.runs(damaged=lambda _: None)), opened.megabytes
        trouble, aside = opened.health.trouble, opened.unclaimed
    if json:
        left = {"runs": runs_left, "megabytes": round(megabytes_left, 3)}
        show.print_json(_tidied_facts(tidied, aside) | left)
    else:
        _print_tidied(tidied, left=f"{count(runs_left, 'run')}, {megabytes_left:.1f} MB left")
    for line in (*messages, *tidied.refused):
        faults.report(line)
    if tidied.refused or trouble is not None:
        raise typer.Exit(UNUSABLE_INPUT)


def _retention(*, days: float, megabytes: float, rules: Path | None) -> Retention:
    """Return what is kept; RequestError: the options say nothing, or say it twice."""
    from prooflight_line.journal.records import Retention
    from prooflight_line.journal.retention_rules import Rules

    stated = None if rules is None else Rules.read(rules)
    try:
        return Retention(days=days, megabytes=megabytes, rules=stated)
    except ValueError as error:
        remedy = "give days, megabytes or both, or a file of rules alone"
        raise RequestError("run tidy", str(error), remedy=remedy) from error


def _tidied_facts(tidied: Tidied, aside: Unclaimed) -> dict[str, Any]:
    """Return what was removed and put aside, for programs."""
    return {
        "removed_runs": tidied.runs,
        "removed_evidence": tidied.packs,
        "thinned_evidence": tidied.thinned,
        "removed_evidence_megabytes": round(tidied.pack_bytes / 1e6, 3),
        "on_hold": tidied.on_hold,
        "refused": tidied.refused,
        "put_aside": aside.moved,
        "put_aside_megabytes": round(aside.moved_bytes / 1e6, 3),
        "put_aside_in": str(aside.aside),
        "taken_back": aside.taken_back,
        "left_among_evidence": aside.left,
    }


def _print_tidied(tidied: Tidied, *, left: str) -> None:
    """Print what was removed, for people; left: what is left."""
    evidence = f"{count(tidied.packs, 'file')} of evidence ({tidied.pack_bytes / 1e6:.1f} MB)"
    thinned = f", {count(tidied.thinned, 'file')} thinned" if tidied.thinned else ""
    show.people.print(f"{count(len(tidied.runs), 'run')} and {evidence} removed{thinned}; {left}")
    if tidied.on_hold:
        show.people.print(f"On legal hold: run {', '.join(map(str, tidied.on_hold))}")


def _print_due(every: list[Due], *, json: bool) -> None:
    """Print what retention removes of each run."""
    if json:
        show.print_json([asdict(one) for one in every])
        return
    headings = ("run", "job", "customer", "ended", "what", "files", "MB")
    table = show.table_of("To be removed by age", headings, text_columns=headings[1:5])
    for one in every:
        what = "all" if "verdicts" in one.classes else ", ".join(one.classes)
        named = (visible(one.job), visible(", ".join(one.customers)), f"{one.days:,.0f} days ago", what)
        table.add_row(str(one.run), *named, str(one.packs), f"{one.bytes / 1e6:.1f}")
    show.people.print(table if every else "Nothing is stored longer than its age allows.")


class Damaged:
    """Rows that cannot be read: the others are shown first, then these are named, and the command exits 2."""

    def __init__(self) -> None:
        self.count = 0
        self._first: list[JournalError] = []

    def add(self, error: JournalError) -> None:
        """Add one damaged row."""
        self.count += 1
        if len(self._first) < DAMAGED_SHOWN:
            self._first.append(error)

    def report(self) -> None:
        """Name the rows and exit, if there are any."""
        for error in self._first:
            faults.report(error)
        if more := self.count - len(self._first):
            faults.report(f"{count(more, 'more row')} cannot be read")
        if self.count:
            raise typer.Exit(UNUSABLE_INPUT)


def _write(pages: Iterable[PageRecord], file: TextIO, *, json: bool) -> None:
    from prooflight_line.journal.exporting import page_facts, write_csv
    from prooflight_line.journal.schema import json_text

    if not json:
        write_csv(pages, file)
        return

    for page in pages:
        file.write(json_text(page_facts(page)) + "\n")


def _local(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s).astimezone().strftime("%Y-%m-%d %H:%M")


def _facts_table(run: RunRow) -> Table:
    facts, end = run.facts, run.end
    table = Table(title=f"Run {run.id}", title_justify="left", show_header=False)
    of_planned = f" of {facts.sheets:,}" if facts.sheets else ""
    rows: dict[str, Any] = {
        "job": facts.job,
        "press": f"{facts.press}, digest {facts.press_digest[:16]}",
        "detector": facts.detector,
        "source": facts.source,
        "began": _local(facts.started_s),
        "ended": _local(end.ended_s) if end else "",
        "state": f"{run.state}{f': {end.detail}' if end and end.detail else ''}",
        "pages": f"{run.pages:,}{of_planned}",
        "misprints": run.misprints,
        "not inspected": run.not_inspected,
        "late": run.late,
        "with faults": run.faulty,
        "not recorded": run.dropped_pages,
        "evidence given up": run.dropped_evidence,
        "promise": ""
        if (first := run.promise_suspended_from) is None
        else f"suspended from sheet {first} on",
    }
    for name, value in rows.items():
        if value not in ("", 0) or name == "misprints":
            table.add_row(name, visible(value))
    return table


def _page_table(pages: Iterable[PageRecord], *, title: str) -> Table:
    text_columns = ("page", "verdict", "disposition", "what")
    table = show.table_of(
        title, ("sheet", "page", "verdict", "disposition", "score", "what"), text_columns=text_columns
    )
    for page in pages:
        verdict = page.verdict
        what = [show.what(verdict)]
        what += ["late"] if page.late else []
        what += filter(None, [show.reserved(verdict)])
        table.add_row(
            str(page.sheet),
            visible(verdict.page),
            Text(verdict.verdict, style=show.VERDICT_STYLE[verdict.verdict]),
            show.disposed(page.disposition, page.decided_by),
            "" if verdict.score is None else f"{verdict.score:.3g}",
            visible("; ".join(filter(None, (*what, *page.faults, *page.notes)))),
        )
    return table
