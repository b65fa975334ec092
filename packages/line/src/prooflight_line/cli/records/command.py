"""``prooflight records``: the journals of many presses in one PostgreSQL database."""

from __future__ import annotations

import csv
import signal
import threading
import time
from dataclasses import asdict, fields
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from prooflight.cli import event_log, faults, show
from prooflight.cli.event_log import LogOption
from prooflight.cli.options import Json
from prooflight.errors import visible
from prooflight.files.atomic import whole_file
from prooflight.reporting.wording import count
from prooflight_line.cli.runs.journals import JournalUrl, url_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight_line.records.searching import Hit
    from prooflight_line.records.shipping import Shipper, Step
    from prooflight_line.reporting.traces import Traces

SHOWN_EVERY_S: Final = 10.0
"""Time between two lines of a shipper that works."""

Database = Annotated[
    str | None,
    typer.Option(
        "--to",
        metavar="URL",
        help="Database, as postgresql://USER@HOST/DATABASE; default $PROOFLIGHT_RECORDS.",
        show_default=False,
    ),
]
Moment = Annotated[datetime | None, typer.Option(formats=["%Y-%m-%d", "%Y-%m-%dT%H:%M", "%Y-%m-%dT%H:%M:%S"])]

app = typer.Typer(help="Bring journals of many presses into one PostgreSQL database.", no_args_is_help=True)


def register(program: typer.Typer) -> None:
    """Add these commands to the program."""
    program.add_typer(app, name="records")


@app.command()
def upgrade(to: Database = None) -> None:
    """Create the tables, or bring them to this version; rows stay as they are."""
    from prooflight_line.records.database import upgrade as upgraded
    from prooflight_line.records.database import url_or_variable

    before, after = upgraded(url_or_variable(to))
    show.people.print(
        f"schema {after}, unchanged" if before == after else f"schema {before or 'none'} -> {after}"
    )


@app.command()
def ship(
    press: Annotated[str, typer.Option(metavar="NAME", help="Name of this press, unique among all.")],
    plant: Annotated[str, typer.Option(metavar="NAME", help="Plant of the press.")],
    to: Database = None,
    journal: JournalUrl = None,
    pictures: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Store of evidence, as file:///FOLDER or s3://BUCKET/PREFIX; default: not shipped.",
            show_default=False,
        ),
    ] = None,
    once: Annotated[
        bool, typer.Option("--once", help="Ship the present rows of the journal, and end.")
    ] = False,
    log: LogOption = "text",
) -> None:
    """Ship this press's journal as it grows. While the server does not answer, the journal stores all rows.

    End it at any moment and in any way: nothing is lost, no row is shipped twice, and the next start continues.
    """
    from prooflight_line.journal.opening import journal_path
    from prooflight_line.records.database import connect, url_or_variable
    from prooflight_line.records.pictures import ObjectStore
    from prooflight_line.records.service import ShippingService
    from prooflight_line.reporting.traces import Traces

    event_log.begin(log)
    url, total = url_or_variable(to), _Total(press, Traces.of_environment(**{"prooflight.press": press}))
    service = ShippingService(
        url=url,
        press=press,
        plant=plant,
        journal=journal_path(url_of(journal)),
        pictures=None if pictures is None else ObjectStore.open(pictures),
        announce=faults.report,
        passed=total.passed,
    )
    if once:
        connect(url).close()  # also without a journal it is said that there is no server
        try:
            while service.once():
                pass
        finally:
            service.close()
    else:
        stop = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stop.set())
        service.run(stop)
    show.people.print(total.line())
    total.close()


@app.command("presses")
def list_presses(
    to: Database = None,
    hours: Annotated[float, typer.Option(help="Number of past hours that are counted.", min=0.01)] = 24.0,
    json: Json = False,
) -> None:
    """List the presses, what runs, and their sheets of the last hours."""
    from prooflight_line.records.database import connect, refused, shown, url_or_variable
    from prooflight_line.records.searching import presses

    url = url_or_variable(to)
    with connect(url) as connection, refused(url, "presses could not be listed"):
        states = presses(connection, since=datetime.now(UTC) - timedelta(hours=hours))
    if json:
        show.print_json(states)
        return
    texts = ("plant", "press", "runs", "last sheet", "shipped")
    numbers = ("sheets", "misprints", "not inspected", "late")
    table = show.table_of(f"{shown(url)}, last {hours:g} h", (*texts, *numbers), text_columns=texts)
    for one in states:
        row = (one.plant, one.press, one.running or "", _local(one.last_at), _local(one.shipped_at))
        counts = (one.sheets, one.misprints, one.not_inspected, one.late)
        table.add_row(*(visible(value) for value in row), *(f"{value:,}" for value in counts))
    show.people.print(table)


@app.command()
def search(
    to: Database = None,
    press: Annotated[str | None, typer.Option(metavar="NAME", help="Press.")] = None,
    plant: Annotated[str | None, typer.Option(metavar="NAME", help="Plant.")] = None,
    job: Annotated[str | None, typer.Option(metavar="NAME", help="Job, or the start of its name.")] = None,
    verdict: Annotated[
        str | None, typer.Option(metavar="good|misprint|not-inspected", help="Verdict.")
    ] = None,
    kind: Annotated[str | None, typer.Option(metavar="KIND", help="Kind of misprint, as streak.")] = None,
    since: Moment = None,
    until: Moment = None,
    limit: Annotated[int, typer.Option(metavar="N", help="Greatest number of hits.", min=1)] = 100,
    csv_file: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write all hits into a file, without limit.")
    ] = None,
    json: Json = False,
) -> None:
    """Find sheets of all presses, the latest first. Times are of this machine's time zone."""
    from prooflight_line.records.database import connect, refused, url_or_variable
    from prooflight_line.records.searching import SheetQuery, find, find_all

    url = url_or_variable(to)
    query = SheetQuery(
        press=press,
        plant=plant,
        job=job,
        verdict=verdict,
        kind=kind,
        since=None if since is None else since.astimezone(),
        until=None if until is None else until.astimezone(),
    )
    with connect(url) as connection, refused(url, "the search failed"):
        if csv_file is not None:
            _write_csv(csv_file, find_all(connection, query))
            show.written(csv_file)
            return
        hits = find(connection, query, limit=limit + 1)
    if json:
        show.print_json(hits[:limit])
        return
    texts = ("time", "plant", "press", "job", "page", "verdict", "kind", "disposition")
    table = show.table_of("sheets", (*texts, "sheet", "score"), text_columns=texts)
    for hit in hits[:limit]:
        row = (
            _local(hit.at),
            hit.plant,
            hit.press,
            hit.job,
            hit.page,
            hit.verdict,
            hit.kind,
            hit.disposition,
        )
        score = "" if hit.score is None else f"{hit.score:.2f}"
        table.add_row(*(visible(value or "") for value in row), f"{hit.sheet:,}", score)
    show.people.print(table)
    if len(hits) > limit:
        show.people.print(f"There are more than {limit:,}; narrow the search, or write all with --csv.")


@app.command()
def allow(
    role: Annotated[str, typer.Argument(metavar="ROLE", help="Role of the server.")],
    plant: Annotated[str, typer.Option(metavar="NAME", help="Plant whose records it may read.")],
    to: Database = None,
) -> None:
    """Let a role of the database's server read the records of one plant, and of no other."""
    from prooflight_line.records.database import allow as let_in
    from prooflight_line.records.database import url_or_variable

    let_in(url_or_variable(to), role, plant)
    show.people.print(f"{visible(role)} may read the records of plant {visible(plant)}")


class _Total:
    """Counts of what was shipped, and a line about it now and then."""

    def __init__(self, press: str, traces: Traces | None) -> None:
        self._press, self._traces = press, traces
        self._sheets = self._labels = 0
        self._shown = datetime.now(UTC)

    def passed(self, step: Step, shipper: Shipper) -> None:
        """Count a step."""
        self._sheets += step.sheets
        self._labels += step.labels
        for one in step.ids:
            event_log.write("shipped", press=self._press, id=one)
        if self._traces is not None:
            self._traces.shipped(step.ids, (time.time() - step.seconds, time.time()))
        if (now := datetime.now(UTC)) - self._shown >= timedelta(seconds=SHOWN_EVERY_S):
            self._shown = now
            event_log.write(
                "progress",
                press=self._press,
                sheets=self._sheets,
                labels=self._labels,
                rows_behind=shipper.waiting_rows,
            )
            show.people.print(f"{self.line()}; {count(shipper.waiting_rows, 'row')} not shipped yet")

    def close(self) -> None:
        """Export the traces that wait."""
        if self._traces is not None:
            self._traces.close()

    def line(self) -> str:
        """Return what was shipped so far, in words."""
        return f"{count(self._sheets, 'sheet')} and {count(self._labels, 'label')} shipped"


def _write_csv(file: Path, hits: Iterable[Hit]) -> None:
    from prooflight_line.records.searching import Hit

    names = [field.name for field in fields(Hit) if field.name != "run_id"]
    with whole_file(file) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, names, extrasaction="ignore")
        writer.writeheader()
        for hit in hits:
            row: dict[str, Any] = asdict(hit) | {"at": hit.at.isoformat()}
            writer.writerow(
                {name: visible(value) if isinstance(value, str) else value for name, value in row.items()}
            )


def _local(at: datetime | None) -> str:
    return "" if at is None else f"{at.astimezone():%Y-%m-%d %H:%M:%S}"
