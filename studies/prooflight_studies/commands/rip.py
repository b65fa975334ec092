"""``prooflight study rip``, ``ripped``, ``content``, ``zones``: PDFs, codes and numbers on prints, cost of zones."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight_studies.commands.study import (
    CACHE,
    Cache,
    Json,
    PagesDir,
    Quick,
    Results,
    report_results,
    show_table,
)

if TYPE_CHECKING:
    from prooflight_studies.ripped.study import FalseAlarmPlan

CasesDir = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder of PDFs that were once printed wrongly.")
]
PARTS = ("specification", "press")


def rip(
    out: Results = Path("docs/results/jobs"),
    part: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART",
            help="specification (rip.md) or press (ripped.md, or its like by the world that the press states).",
        ),
    ] = None,
    cases: CasesDir = None,
    pages: PagesDir = None,
    press: Annotated[
        Path | None,
        typer.Option(metavar="X.press", help="Press artefact of `press build`; for the part press."),
    ] = None,
    prints: Annotated[int, typer.Option(help="Good prints in each row of the part press.", min=1)] = 320,
    learned: Annotated[int, typer.Option(help="Good pages that are learned; 0: none.", min=0)] = 40,
    row: Annotated[
        list[str] | None,
        typer.Option(metavar="RIP", help="Only these RIPs of the part press; all if not given."),
    ] = None,
    world: Annotated[
        list[str] | None,
        typer.Option(metavar="WORLD", help="Only the world press or measured; default both."),
    ] = None,
    statement: Annotated[
        list[str] | None,
        typer.Option(metavar="STATEMENT", help="Only nothing, stated or identified; all three if not given."),
    ] = None,
    cache: Cache = CACHE,
    processes: Annotated[
        int | None, typer.Option(help="Number of processes at a time; default all cores.", min=1)
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of days, prints and misprints.", min=0)] = 401,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Rasterise PDFs whose ink the specification fixes, or judge prints of presses that rip and screen themselves."""
    parts = part or [PARTS[0]]
    for name in parts:
        if name not in PARTS:
            raise RequestError("part", f"there is no {name!r}", remedy=f"choose from {', '.join(PARTS)}")
    if PARTS[0] in parts:
        _specification(out, cases, pages, quick=quick, json=json)
    if PARTS[1] in parts:
        from prooflight_studies.ripped.printing import RIPS, STATEMENTS
        from prooflight_studies.ripped.study import WORLDS, FalseAlarmPlan

        if press is None or pages is None:
            what = "needs a press and a folder of pages"
            raise RequestError("part press", what, remedy="give --press X.press and --pages DIR")
        plan = FalseAlarmPlan(
            seed=seed,
            prints=4 if quick else prints,
            learned=0 if quick else learned,
            rips=tuple(row or (one.name for one in RIPS)),
            worlds=tuple(world or WORLDS),
            statements=tuple(statement or STATEMENTS),
        )
        _press(press, pages, out, cache, plan, processes, json=json)


def _specification(out: Path, cases: Path | None, pages: Path | None, *, quick: bool, json: bool) -> None:
    from prooflight_studies.rip.study import run_rip_study

    results = run_rip_study(
        out, cases=cases, pages=pages, most=4 if quick else None, progress=show.steps(quiet=json)
    )
    if json:
        show.print_json(asdict(results))
        return
    cells = (
        (
            row.name,
            row.clause,
            *(" ".join(map(str, inks)) or "-" for inks in (row.right, row.ours, row.ghostscript)),
        )
        for row in results.rows
    )
    show_table("Ink of 255", ("case", "clause", "right", "ours", "Ghostscript"), cells, text_columns=2)
    show.written(out / "rip.md")


def _press(
    press: Path,
    pages: Path,
    out: Path,
    cache: Path,
    plan: FalseAlarmPlan,
    processes: int | None,
    *,
    json: bool,
) -> None:
    from prooflight_studies.ripped.study import PAGES, run_false_alarm_study

    results = run_false_alarm_study(
        press,
        pages,
        out,
        cache=cache / "rip",
        plan=plan,
        processes=processes,
        progress=show.steps(quiet=json),
    )
    if json:
        show.print_json(asdict(results))
        return
    cells = (
        (
            row.title,
            row.world,
            row.statement,
            str(row.learned or "-"),
            row.false_alarms,
            str(row.uninspected),
            row.misprints_caught,
        )
        for row in results.rows
    )
    headings = ("the press prints", "world", "stated", "learned", "alarms", "not inspected", "caught")
    show_table("Good prints that alarm, and misprints that are caught", headings, cells, text_columns=4)
    show.written(out / f"{PAGES[results.varies]}.md")


class Part(StrEnum):
    """Parts of the study."""

    CODES = "codes"
    TEXT = "text"


def content(
    out: Results = Path("docs/results/jobs"),
    part: Annotated[Part, typer.Option(help="codes: bar codes. text: digits of numbers.")] = Part.CODES,
    seed: Annotated[
        int, typer.Option(help="Seed of what is printed, its prints and its damage.", min=0)
    ] = 19,
    sheets: Annotated[
        int, typer.Option(help="Number of numbers of each size; each gives three wrong digits.", min=4)
    ] = 168,
    pitch: Annotated[
        list[float] | None,
        typer.Option(help="Pixel pitches of the camera, for numbers; default 0.254 and 0.127. [mm]"),
    ] = None,
    cache: Cache = CACHE,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Print codes of eight symbologies, or numbers of 6 to 10 pt, and count what is caught; writes content.md."""
    if part is Part.TEXT:
        _text(out, seed=seed, sheets=sheets, pitches_mm=pitch, cache=cache, quick=quick, json=json)
        return
    from prooflight_studies.content.study import run_content_study

    results = run_content_study(out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(results, out / "content.md", json=json)


def _text(
    out: Path, *, seed: int, sheets: int, pitches_mm: list[float] | None, cache: Path, quick: bool, json: bool
) -> None:
    from prooflight_studies.content.numbers import PITCHES_MM, run_text_study
    from prooflight_studies.content.study import write_text

    results = run_text_study(
        cache / "content-text",
        seed=seed,
        sheets=sheets,
        pitches_mm=pitches_mm or PITCHES_MM,
        quick=quick,
        progress=show.steps(quiet=json),
    )
    write_text(out, results)
    report_results(results, out / "content.md", json=json)


def zones(
    out: Results = Path("docs/results/jobs"),
    seed: Annotated[int, typer.Option(help="Seed of pages, zones, prints and defects.", min=0)] = 37,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the predicted and observed cost of careful and ignored zones, and false alarms; writes zones.md."""
    from prooflight_studies.zones.study import run_zones_study

    results = run_zones_study(out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(results, out / "zones.md", json=json)
