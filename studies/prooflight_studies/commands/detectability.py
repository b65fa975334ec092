"""``prooflight study detectability``: defects that would be caught on a job's pages, before they are printed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import Json, Quick, Results, report_results

QUICK_TRIALS = 3
QUICK_LEARNING = 16


def detectability(
    job: Annotated[Path, typer.Argument(metavar="JOB", help="PDF, CMYK TIFF or JPEG, or a folder of them.")],
    press: Annotated[
        Path, typer.Option("--press", metavar="X.press", help="Press artefact with the matched filter.")
    ],
    out: Results = Path("docs/results/detector"),
    pages: Annotated[str | None, typer.Option(metavar="1,4-6", help="Pages; default all.")] = None,
    profile: Annotated[Path | None, typer.Option(metavar="ICC", help="CMYK profile of the job.")] = None,
    seed: Annotated[int, typer.Option(help="Of press days, prints and places.", min=0)] = 1,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Map the least spot, streak and density change that is caught, and verify the maps; writes detectability.md."""
    from prooflight.pages.job import parse_pages
    from prooflight.press.artefact import Press
    from prooflight.press.pages import job_source
    from prooflight_studies.detectability.study import LEARNING, TRIALS, run_detectability_study

    loaded = Press.load(press)
    source = job_source(job, loaded, profile=profile)
    with source.open() as opened:
        numbers = parse_pages(pages, len(opened)) if pages else None
    results = run_detectability_study(
        source,
        loaded,
        out,
        pages=numbers,
        learning=QUICK_LEARNING if quick else LEARNING,
        trials=QUICK_TRIALS if quick else TRIALS,
        seed=seed,
        progress=show.steps(quiet=json),
    )
    rows: list[dict[str, Any]] = [
        {"page": page.name, "inks_percent": page.reach.inks_percent}
        | {name: {"of": one.of, "caught": one.caught} for name, one in page.verified.items()}
        for page in results.pages
    ] + [{"page": name, "good_prints_alarm": True} for name in results.alarming]
    report_results(rows, out / "detectability.md", json=json)
