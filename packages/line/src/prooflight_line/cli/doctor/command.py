"""``prooflight doctor``: what this machine lacks, and how fast an inspection will be on it."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.text import Text

from prooflight.cli import show
from prooflight.cli.options import Json
from prooflight.errors import visible
from prooflight_line.cli.runs.journals import JournalUrl, url_of

if TYPE_CHECKING:
    from prooflight_line.cli.doctor.machine import Speed

LACKING: Final = 1
"""Exit code if something that is needed is missing."""
STYLES: Final = {"good": "green", "optional": "dim", "look": "yellow", "lacking": "bold red"}


def register(program: typer.Typer) -> None:
    """Add the command to the program."""
    program.command()(doctor)


def doctor(
    press: Annotated[
        Path | None,
        typer.Option("--press", metavar="X.press", help="Press whose inspections are measured here."),
    ] = None,
    journal: JournalUrl = None,
    json: Json = False,
) -> None:
    """Report what this machine lacks, and with --press how fast an inspection will be.

    Exits 1 if something that is needed is missing.
    """
    from prooflight.press.artefact import Press
    from prooflight_line.cli.doctor.machine import SHEETS, findings, measure_speed
    from prooflight_line.journal.opening import journal_path

    loaded = None if press is None else Press.load(press)
    rows = list(findings(journal_path(url_of(journal))))
    speed = None
    if loaded is not None:
        steps = range(SHEETS) if json else show.progress(range(SHEETS), total=SHEETS, what="inspecting")
        speed = measure_speed(loaded, steps=steps)
    if json:
        show.print_json({"findings": rows, "speed": None if speed is None else asdict(speed)})
    else:
        table = show.table_of("This machine", _COLUMNS, text_columns=_COLUMNS)
        for one in rows:
            table.add_row(
                one.what, Text(one.state, style=STYLES[one.state]), visible(one.detail), visible(one.remedy)
            )
        show.people.print(table)
        show.people.print(_speed_line(speed))
    if any(one.state == "lacking" for one in rows):
        raise typer.Exit(LACKING)


_COLUMNS: Final = ("what", "state", "detail", "what helps")


def _speed_line(speed: Speed | None) -> str:
    if speed is None:
        return "How fast an inspection will be here: give --press"
    width, height = speed.page_mm
    cores = os.cpu_count() or 1
    return (
        f"By {speed.detector}, a page of {width:.0f} x {height:.0f} mm: {speed.prepare_s:.2f} CPU-s to prepare, "
        f"{speed.inspect_s:.3f} CPU-s to inspect a sheet; {cores} cores inspect "
        f"{speed.sheets_per_s(cores):.1f} sheets/s at most"
    )
