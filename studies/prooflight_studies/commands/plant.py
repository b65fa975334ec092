"""``prooflight study plant``: causes of defects, corrections in a closed loop, and jobs that come by themselves."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Final

import typer

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight_studies.commands.study import CACHE, Cache, Json, PagesDir, Quick, Results, report_results

PARTS: Final = ("causes", "jobs")


def plant(
    press: Annotated[
        Path | None,
        typer.Option("--press", metavar="X.press", help="For causes: with a trained matched filter."),
    ] = None,
    out: Results = Path("docs/results/running"),
    cache: Cache = CACHE,
    part: Annotated[
        list[str] | None, typer.Option(metavar="PART", help="causes or jobs; both if not given.")
    ] = None,
    processes: Annotated[
        int | None, typer.Option(help="Number of processes at a time; default all cores.", min=1)
    ] = None,
    pages: PagesDir = None,
    seed: Annotated[
        int, typer.Option(help="Seed of designs, prints, defects, drifts and files.", min=0)
    ] = 499,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Name the causes of simulated defects in a blind test, and correct a press that drifts; writes plant.md.

    Part jobs sends files of all sorts into a hot folder while the process that takes them in is killed; writes jobs.md.
    """
    for name in part or ():
        if name not in PARTS:
            raise RequestError("part", f"there is no {name!r}", remedy=f"choose from {', '.join(PARTS)}")
    parts = part or PARTS
    if "causes" in parts and press is None:
        raise RequestError("--press", "causes need a press", remedy="give one, or `--part jobs` alone")
    out.mkdir(parents=True, exist_ok=True)
    progress = show.steps(quiet=json)
    if "causes" in parts and press is not None:
        from prooflight_studies.plant.study import CausesPlan, run_plant_study

        causes = run_plant_study(
            out,
            press=press,
            plan=CausesPlan.quick(seed) if quick else CausesPlan(seed=seed),
            cache=cache / "plant",
            processes=processes,
            quick=quick,
            progress=progress,
        )
        report_results(asdict(causes), out / "plant.md", json=json)
    if "jobs" in parts:
        from prooflight_studies.jobs.study import JobsPlan, run_jobs_study

        plan = JobsPlan.quick(seed) if quick else JobsPlan(seed=seed)
        jobs = run_jobs_study(out, plan=plan, pages=pages, quick=quick, progress=progress)
        report_results(asdict(jobs), out / "jobs.md", json=json)
