"""``prooflight study running``: the running press in real time, under faults and slow drift."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight_studies.commands.study import CACHE, Cache, Json, Quick, Results, report_results


def running(
    press: Annotated[
        Path | None,
        typer.Option(metavar="X.press", help="One sensor, taught; default the prototype, untaught."),
    ] = None,
    press_two: Annotated[
        Path | None, typer.Option(metavar="Y.press", help="Two sensors; default two-sensors.toml, untaught.")
    ] = None,
    part: Annotated[
        list[str] | None,
        typer.Option(
            help="started, repeated, different, matched_filter, soak, drift, streak, picture; default all."
        ),
    ] = None,
    pages: Annotated[
        Path | None,
        typer.Option(metavar="JOB", help="Job of different pages, for the part started; default none."),
    ] = None,
    out: Results = Path("docs/results/running"),
    cache: Cache = CACHE,
    threads: Annotated[int | None, typer.Option(help="That inspect; default one a core.", min=1)] = None,
    seed: Annotated[int, typer.Option(help="Of prints, faults and days.", min=0)] = 1,
    sheets: Annotated[
        int | None, typer.Option(help="Of the rows in real time at the speed asked; default 2,000.", min=1)
    ] = None,
    again: Annotated[bool, typer.Option("--again", help="Measure parts that are known already.")] = False,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the running press part by part, resuming an interrupted study; writes running.md after each part."""
    from prooflight_studies.running.study import PARTS, Plan, Study

    for one in part or ():
        if one not in PARTS:
            raise RequestError("part", f"there is no {one!r}", remedy=f"choose of {', '.join(PARTS)}")
    plan = Plan.of(quick=quick)
    out.mkdir(parents=True, exist_ok=True)
    study = Study(
        out=out,
        cache=cache,
        plan=plan if sheets is None else replace(plan, live_sheets=sheets),
        seed=seed,
        one=press,
        two=press_two,
        inspectors=threads or os.cpu_count() or 1,
        progress=show.steps(quiet=json),
        pages=pages,
    )
    results = study.run(tuple(part) if part else PARTS, again=again)
    report_results(results, out / "running.md", json=json)
