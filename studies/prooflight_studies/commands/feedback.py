"""``prooflight study feedback``: a press recalibrated by labels that people give its sheets."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.cli.options import ClusterAt
from prooflight_studies.commands.study import CACHE, Cache, Json, Quick, Results, processes_of, report_results


def feedback(
    out: Results = Path("docs/results/running"),
    cache: Cache = CACHE,
    processes: Annotated[int | None, typer.Option(help="At a time; all cores if not given.", min=1)] = None,
    cluster: ClusterAt = None,
    seed: Annotated[int, typer.Option(help="Of designs, days, prints and weeks.", min=0)] = 23,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Compare target and realised false alarms of a drifted press before and after feedback; writes feedback.md."""
    from prooflight_studies.feedback.pool import PoolPlan
    from prooflight_studies.feedback.study import run_feedback_study

    results = run_feedback_study(
        out,
        cache=cache / "feedback",
        plan=PoolPlan.quick(seed) if quick else PoolPlan(seed=seed),
        quick=quick,
        processes=processes_of(cluster, processes),
        progress=show.steps(quiet=json),
    )
    report_results(asdict(results), out / "feedback.md", json=json)
