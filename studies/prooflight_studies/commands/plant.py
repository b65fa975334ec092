"""``prooflight study plant``: causes of defects named from a journal, and corrections in a closed loop."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.cli.options import ClusterAt
from prooflight.errors import RequestError
from prooflight_studies.commands.study import CACHE, Cache, Json, Quick, Results, processes_of, report_results


def plant(
    press: Annotated[
        Path, typer.Option("--press", metavar="X.press", help="A press with a trained matched filter.")
    ],
    out: Results = Path("docs/results/running"),
    cache: Cache = CACHE,
    part: Annotated[list[str] | None, typer.Option(metavar="PART", help="causes; all if not given.")] = None,
    processes: Annotated[int | None, typer.Option(help="At a time; all cores if not given.", min=1)] = None,
    cluster: ClusterAt = None,
    seed: Annotated[int, typer.Option(help="Of designs, prints, defects and drifts.", min=0)] = 499,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Name the causes of simulated defects in a blind test, and correct a press that drifts; writes plant.md."""
    from prooflight_studies.plant.study import PARTS_OF_STUDY, CausesPlan, run_plant_study

    for name in part or ():
        if name not in PARTS_OF_STUDY:
            remedy = f"choose of {', '.join(PARTS_OF_STUDY)}"
            raise RequestError("part", f"there is no {name!r}", remedy=remedy)
    out.mkdir(parents=True, exist_ok=True)
    results = run_plant_study(
        out,
        press=press,
        plan=CausesPlan.quick(seed) if quick else CausesPlan(seed=seed),
        cache=cache / "plant",
        processes=processes_of(cluster, processes),
        quick=quick,
        progress=show.steps(quiet=json),
    )
    report_results(asdict(results), out / "plant.md", json=json)
