"""``prooflight study cameras``: cameras on loopback, their losses, failures and speed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight_studies.commands.study import CACHE, Cache, Json, Quick, Results, report_results


def cameras(
    part: Annotated[
        list[str] | None, typer.Option(help="job, losses, unseen, deaths, away, step, speed; default all.")
    ] = None,
    press: Annotated[
        Path | None,
        typer.Option(metavar="X.press", help="Taught for all detectors, for `unseen`; default the job's."),
    ] = None,
    out: Results = Path("docs/results/running"),
    cache: Cache = CACHE,
    seed: Annotated[int, typer.Option(help="Of prints and losses.", min=0)] = 1,
    again: Annotated[bool, typer.Option("--again", help="Measure parts that are known already.")] = False,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure cameras on loopback, part by part: lines, losses, failures, synchronisation, speed; writes cameras.md."""
    from prooflight_studies.cameras.study import PARTS, Plan, Study

    for one in part or ():
        if one not in PARTS:
            raise RequestError("part", f"there is no {one!r}", remedy=f"choose of {', '.join(PARTS)}")
    out.mkdir(parents=True, exist_ok=True)
    study = Study(
        out=out,
        cache=cache,
        plan=Plan.of(quick=quick),
        seed=seed,
        press=press,
        progress=show.steps(quiet=json),
    )
    results = study.run(tuple(part) if part else PARTS, again=again)
    report_results(results, out / "cameras.md", json=json)
