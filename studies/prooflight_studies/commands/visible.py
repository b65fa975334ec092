"""``prooflight study visible``: the share of visible marks that is caught."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.cli.options import ClusterAt
from prooflight.errors import RequestError
from prooflight_studies.commands.study import CACHE, Cache, Json, Quick, Results, processes_of, report_results


def visible(
    out: Results = Path("docs/results/detector"),
    cache: Cache = CACHE,
    part: Annotated[
        list[str] | None,
        typer.Option(metavar="PART", help="marks, one-sensor, curves or fine-curves; all if not given."),
    ] = None,
    processes: Annotated[int | None, typer.Option(help="At a time; all cores if not given.", min=1)] = None,
    cluster: ClusterAt = None,
    seed: Annotated[int, typer.Option(help="Of presses, designs, days, prints and marks.", min=0)] = 235,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Named marks on bare paper and tints, false alarms by difficulty, and curves by place; writes visible.md."""
    from prooflight_studies.visible.study import PARTS, VisiblePlan, run_visible_study

    for name in part or ():
        if name not in PARTS:
            raise RequestError("part", f"there is no {name!r}", remedy=f"choose of {', '.join(PARTS)}")
    results = run_visible_study(
        out,
        cache=cache / "visible",
        plan=VisiblePlan.quick(seed) if quick else VisiblePlan(seed=seed),
        parts=part or PARTS,
        quick=quick,
        processes=processes_of(cluster, processes),
        progress=show.steps(quiet=json),
    )
    report_results(asdict(results), out / "visible.md", json=json)
