"""``prooflight study soak``: a run with faults of the paper path and the camera."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import Json, Quick, Results, report_results


def soak(
    out: Results = Path("docs/results/running"),
    sheets: Annotated[int | None, typer.Option(help="That pass; default 3600, an hour.", min=20)] = None,
    seed: Annotated[int, typer.Option(help="Of pages, prints and faults.", min=0)] = 12,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Play an hour of pages with random faults, as fast as possible, and check the reports; writes soak.md."""
    from prooflight_studies.soak.study import run_soak_study

    results = run_soak_study(out, sheets=sheets, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(asdict(results), out / "soak.md", json=json)
