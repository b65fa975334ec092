"""``prooflight run reconcile`` and ``reprint-list``: the account of every sheet, and the sheets to print again."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.text import Text

from prooflight.cli import faults, show
from prooflight.cli.exit_codes import EXIT_MISPRINT, NOT_ALL_INSPECTED
from prooflight.errors import visible
from prooflight.reporting.wording import count

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_line.journal.journal import Journal
    from prooflight_line.journal.records import RunRow
    from prooflight_line.plant.gate.reconciling import Accounted, Reconciliation

    Opened = Callable[[str | None], Journal]
    Chosen = Callable[[Journal, str], RunRow]

SHOWN: Final = 20
TraysFile = Annotated[
    Path | None,
    typer.Option(
        "--trays",
        metavar="FILE",
        help="The controller's log: JSON lines or CSV of session, tag, tray, count; default its reports over the wire.",
    ),
]
ACCOUNT_TEXTS: Final = {
    "accepted": "in the good tray, as decided",
    "diverted": "rejected, as decided",
    "lost": "good, but rejected",
    "unseen": "rejected, never judged",
    "not-at-gate": "judged, not seen at the gate",
    "did-not-come": "page that did not come",
    "wrong": "IN THE GOOD TRAY AGAINST THE DECISION",
}


def reconcile(opened: Journal, run: RunRow, *, trays: Path | None, json: bool) -> None:
    """Account for every sheet of a run.

    Exits 1 if one is in the good tray that must not be, 3 if one is open or the controller's log and the wire
    differ.
    """
    from prooflight_line.plant.gate.log import REMEDY, PlantError, log_path
    from prooflight_line.run_package.accounts import accounts_of

    listed, accounts = accounts_of(opened, run, trays)
    if accounts is None:
        raise PlantError(log_path(opened.path, run.id), "does not exist", remedy=REMEDY)
    if json:
        show.print_json(
            {
                "run": run.id,
                "counts": dict(accounts.counts),
                "lost_by": dict(accounts.lost_by),
                "off_mm": _off_facts(accounts),
                "to_print_again": len(listed),
                "unprinted": len(listed.unprinted),
                "trays_from": accounts.source,
                "disagreements": [asdict(one) for one in accounts.disagreements],
                "not_in_the_journal": sum(
                    not one.in_journal and one.sheet is not None for one in accounts.sheets
                ),
                "sheets": [asdict(one) for one in accounts.sheets],
            }
        )
    else:
        _print(accounts, run)
        show.people.print(f"To print again: {count(len(listed), 'sheet')}; see `prooflight run reprint-list`")
    if accounts.wrong:
        raise typer.Exit(EXIT_MISPRINT)
    if accounts.open or accounts.disagreements:
        raise typer.Exit(NOT_ALL_INSPECTED)


def reprint_list(opened: Journal, run: RunRow, *, trays: Path | None, out: Path | None, json: bool) -> None:
    """List the sheets to print again, their positions in the stack, and why."""
    from prooflight.files.atomic import whole_file
    from prooflight_line.journal.schema import json_text
    from prooflight_line.plant.reprinting import NOT_PRINTED
    from prooflight_line.run_package.accounts import accounts_of

    listed, _ = accounts_of(opened, run, trays)
    if out is not None or json:
        facts = {
            "run": run.id,
            "job": run.facts.job,
            "count": len(listed),
            "unprinted": len(listed.unprinted),
            "by": listed.by,
            "trays_from": listed.trays_from,
            "vouched": listed.vouched,
            "reprints": [asdict(one) for one in listed.all()],
        }
        if out is None:
            show.print_json(facts)
            return
        with whole_file(out) as unfinished:
            unfinished.write_text(json_text(facts) + "\n", encoding="utf-8")
        show.written(out)
        return
    headings = ("copy", "page", "set", "belongs after", "why")
    table = show.table_of(f"To print again, run {run.id}", headings, text_columns=headings[1:])
    for one in listed.sheets:
        why = f"{one.why}; take it out of the good tray" if one.take_out else one.why
        number = f"{one.number} ({visible(one.page)})"
        table.add_row(
            str(one.copy), number, str(one.set_number), visible(one.behind or "nothing"), visible(why)
        )
    if rest := listed.unprinted:
        number = f"{count(len(rest), 'sheet')} from sheet {rest.start} of the run on"
        table.add_row("", number, "", "", NOT_PRINTED)
    show.people.print(table if listed else "Nothing: every sheet that the job needs is delivered.")
    if listed.vouched:
        show.people.print(
            f"{count(len(listed.vouched), 'sheet')} delivered after a person released them manually"
        )


def _print(accounts: Reconciliation, run: RunRow) -> None:
    headings = ("sheets", "result")
    table = show.table_of(f"Run {run.id}, reconciled", headings, text_columns=headings[1:])
    for account, text_columns in ACCOUNT_TEXTS.items():
        if number := accounts.counts[account]:
            style = "bold red" if account == "wrong" else ""
            table.add_row(f"{number:,}", Text(text_columns, style=style))
    table.add_row(f"{len(accounts.sheets):,}", Text("all", style="bold"))
    show.people.print(table)
    _reasons("Good sheets lost", accounts.lost_by)
    _reasons("Never judged", Counter(one.why for one in accounts.sheets if one.account == "unseen"))
    if off := _off_facts(accounts):
        show.people.print(
            f"Sheets reached the gate {off['median']:+.1f} mm from the expected position (median), "
            f"{off['greatest']:.1f} mm at most; correct [gate] distance_mm by a constant offset."
        )
    for different in accounts.disagreements[:SHOWN]:
        where = different.file or "no row for it"
        faults.report(
            f"sheet {different.sheet}: {different.wire} tray over the wire, {where} in the controller's log"
        )
    if len(accounts.disagreements) > SHOWN:
        faults.report(f"the two differ for {count(len(accounts.disagreements) - SHOWN, 'more sheet')}")
    for one in accounts.wrong[:SHOWN]:
        faults.report(f"{_name(one)} is in the good tray: {one.why}")
    if len(accounts.wrong) > SHOWN:
        faults.report(
            f"{count(len(accounts.wrong) - SHOWN, 'more sheet')} in the good tray against the decision"
        )


def _off_facts(accounts: Reconciliation) -> dict[str, float]:
    """Return the offsets at which sheets reached the gate; empty if they are not known."""
    if not accounts.off_mm:
        return {}
    greatest = max(map(abs, accounts.off_mm))
    return {"median": round(median(accounts.off_mm), 2), "greatest": round(greatest, 2)}


def _reasons(title: str, counts: Counter[str]) -> None:
    if not counts:
        return
    headings: tuple[str, ...] = ("sheets", "why")
    table: Any = show.table_of(title, headings, text_columns=headings[1:])
    for why, number in counts.most_common():
        table.add_row(f"{number:,}", visible(why))
    show.people.print(table)


def _name(one: Accounted) -> str:
    return "a sheet without a verdict" if one.sheet is None else f"sheet {one.sheet} ({visible(one.page)})"
