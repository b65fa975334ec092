"""``prooflight run causes``, ``roll-map`` and ``corrections``: what a run's journal says of the press."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from prooflight.cli import show
from prooflight.cli.options import Json
from prooflight.errors import RequestError, visible
from prooflight.reporting.wording import count
from prooflight_line.cli.runs.journals import JournalUrl, RunNumber, reading, run_of

if TYPE_CHECKING:
    from prooflight.press.press_file import PressFile
    from prooflight_line.journal.records import PageRecord, RunRow
    from prooflight_line.run.monitor.corrections import Correction

FORMATS: Final = (".csv", ".xml", ".png", ".svg", ".pdf")
PlantFile = Annotated[
    Path,
    typer.Option(
        "--plant",
        metavar="PRESS.toml",
        help="Press file of the run: its lines' pitch, and the rollers and heads of [press].",
    ),
]


def register_of_runs(app: typer.Typer) -> None:
    """Add these commands to ``prooflight run``."""
    app.command()(causes)
    app.command("roll-map")(roll_map)
    app.command()(corrections)


def causes(plant: PlantFile, run: RunNumber = "last", journal: JournalUrl = None, json: Json = False) -> None:
    """Name the causes of a run's defects: rollers by their repeat distance, nozzles by their streaks, drifts."""
    from prooflight_line.causes.naming import named_causes

    row, records, file = _read(run, journal, plant)
    named = named_causes(records, geometry=file.geometry(file.camera()), parts=file.parts)
    if json:
        show.print_json({"run": row.id, "causes": [asdict(one) for one in named]})
        return
    headings = ("cause", "what", "sheets", "from", "to")
    table = show.table_of(f"Causes of run {row.id}", headings, text_columns=headings[:2])
    for one in named:
        numbers = (f"{one.sheets:,}", str(one.first_sheet), str(one.last_sheet))
        table.add_row(one.kind, visible(one.text), *numbers)
    show.people.print(table if named else "No defects, no drifts.")


def roll_map(
    plant: PlantFile,
    run: RunNumber = "last",
    journal: JournalUrl = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="FILE",
            help="File to write, by its suffix: .csv, .xml, or a picture, .png, .svg or .pdf; default CSV to "
            "standard output.",
        ),
    ] = None,
) -> None:
    """List a run's defects by metre of the web, for a rewinder."""
    from prooflight.files.atomic import whole_file
    from prooflight_line.causes import roll_map as maps

    suffix = ".csv" if out is None else out.suffix.lower()
    if suffix not in FORMATS:
        what = f"{visible(str(out))} has no known suffix"
        raise RequestError("run roll-map", what, remedy=f"end its name in {', '.join(FORMATS)}")
    row, records, file = _read(run, journal, plant)
    stretches = maps.roll_map(records, file.geometry(file.camera()))
    if out is None:
        typer.echo(maps.as_csv(stretches), nl=False)
        return
    with whole_file(out) as unfinished:
        if suffix == ".csv":
            unfinished.write_text(maps.as_csv(stretches), encoding="utf-8")
        elif suffix == ".xml":
            unfinished.write_bytes(maps.as_xml(stretches, row))
        else:
            figure = maps.picture(stretches, title=f"Run {row.id}, {visible(row.facts.job)}")
            figure.savefig(unfinished, format=suffix[1:], dpi=150)
    show.written(out)


def corrections(
    run: RunNumber = "last",
    journal: JournalUrl = None,
    since: Annotated[
        int, typer.Option(metavar="SHEET", help="First sheet printed after the last correction.", min=0)
    ] = 0,
    damping: Annotated[
        float | None,
        typer.Option(help="Share of a deviation that is offered; default half.", min=0.01, max=1.0),
    ] = None,
    xjmf: Annotated[
        Path | None,
        typer.Option("--xjmf", metavar="FILE", help="Write the offers as an XJMF notification as well."),
    ] = None,
    json: Json = False,
) -> None:
    """Offer offsets of density and register to the press, damped, with their uncertainty; none is applied."""
    from prooflight_line.causes.corrections import corrections_of
    from prooflight_line.run.monitor.corrections import DAMPING

    damping = damping or DAMPING
    with reading(journal) as opened:
        row = run_of(opened, run)
        offers = corrections_of(list(opened.pages(row.id)), since_sheet=since, damping=damping)
    if xjmf is not None:
        _write_xjmf(xjmf, row, offers)
    if json:
        facts = [asdict(one) | {"channel": one.channel.name, "unit": _unit(one)} for one in offers]
        show.print_json({"run": row.id, "damping": damping, "corrections": facts})
        return
    headings = ("channel", "deviation", "+- 2 sd", "offer", "unit", "sheets")
    table = show.table_of(f"Corrections offered, run {row.id}", headings, text_columns=("channel", "unit"))
    for one in offers:
        scale = one.channel.scale
        offer = f"{scale * one.offset:+.3f}" if one.offset else "none"
        amounts = (f"{scale * one.deviation:+.3f}", f"{2 * scale * one.sd:.3f}", offer)
        table.add_row(one.channel.what, *amounts, one.channel.unit, str(one.sheets))
    show.people.print(table if offers else "Too few sheets on which density or register was measured.")
    if xjmf is not None:
        show.written(xjmf)


def _unit(one: Correction) -> str:
    """Return the unit of a channel's own numbers: those of densities are shares of the ink."""
    return "1" if one.channel.scale != 1 else one.channel.unit


def _write_xjmf(path: Path, row: RunRow, offers: list[Correction]) -> None:
    from prooflight.files.atomic import whole_file
    from prooflight_line.plant.outlets.xjmf_messages import offered

    lines = [
        f"{one.channel.what}: offset {one.channel.scale * one.offset:+.3f} {one.channel.unit}, "
        f"standard deviation {one.channel.scale * one.sd:.3f}, by {count(one.sheets, 'sheet')} up to {one.last_sheet}"
        for one in offers
        if one.offset
    ]
    message = offered(lines, device_id=row.facts.press, job=row.facts.job, time_s=row.facts.started_s)
    with whole_file(path) as unfinished:
        unfinished.write_bytes(message)


def _read(run: str, journal: str | None, plant: Path) -> tuple[RunRow, list[PageRecord], PressFile]:
    """Return a run, its rows and the press file; the errors of all three."""
    from prooflight.press.press_file import PressFile

    file = PressFile.read(plant)
    with reading(journal) as opened:
        row = run_of(opened, run)
        records: list[Any] = list(opened.pages(row.id))
    return row, records, file
