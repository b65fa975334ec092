"""``prooflight study zones``: the cost of zones, as predicted and as observed."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import Json, Quick, Results, show_table


def zones(
    out: Results = Path("docs/results/jobs"),
    seed: Annotated[int, typer.Option(help="Of pages, zones, prints and defects.", min=0)] = 37,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the predicted and observed cost of careful and ignored zones, and false alarms; writes zones.md."""
    from prooflight_studies.zones.study import run_zones_study

    results = run_zones_study(out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    if json:
        show.print_json(asdict(results))
        return
    cells = (
        (str(row["zones"]), *(f"{row[at]['alarms']} of {row[at]['prints']}" for at in ("without", "with")))
        for row in results.good
    )
    show_table("Good prints that alarm", ("zones", "without", "with"), cells)
    show.written(out / "zones.md")
