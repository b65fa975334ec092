"""``prooflight study cluster``: the same work on one, two and four workers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.cli.options import PressArtefact
from prooflight_studies.commands.study import Json, Quick, Results, report_results


def cluster(
    press: PressArtefact,
    out: Results = Path("docs/results/running"),
    pages: Annotated[int, typer.Option(help="Of the job that all prepare.", min=8)] = 400,
    stream_pages: Annotated[int, typer.Option(help="Of the job that is streamed.", min=8)] = 2000,
    seed: Annotated[int, typer.Option(help="Of the pages.", min=0)] = 541,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Prepare a job on 1, 2 and 4 workers, kill some, and compute what a plant needs; writes cluster.md."""
    from prooflight_studies.cluster.study import run_cluster_study

    out.mkdir(parents=True, exist_ok=True)
    figures = run_cluster_study(
        press,
        out,
        pages=16 if quick else pages,
        stream_pages=40 if quick else stream_pages,
        seed=seed,
        quick=quick,
        progress=show.steps(quiet=json),
    )
    report_results(figures, out / "cluster.md", json=json)
