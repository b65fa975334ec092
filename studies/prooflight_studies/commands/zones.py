"""``prooflight study zones``: the cost of zones, as predicted and as observed."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import Json, Quick, Results, report_results


def zones(
    out: Results = Path("docs/results/jobs"),
    seed: Annotated[int, typer.Option(help="Of pages, zones, prints and defects.", min=0)] = 37,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the predicted and observed cost of careful and ignored zones, and false alarms; writes zones.md."""
    from prooflight_studies.zones.study import run_zones_study

    results = run_zones_study(out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(asdict(results), out / "zones.md", json=json)
