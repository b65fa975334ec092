"""``prooflight study cluster``: the work of three commands, shared by workers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import Json, PressFileAt, Quick, Results, report_results


def cluster(
    press_file: PressFileAt = None,
    out: Results = Path("docs/results/running"),
    seed: Annotated[int, typer.Option(help="Seed of designs, prints and labels.", min=0)] = 541,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Build, prepare and inspect on 1, 2 and 4 workers, kill some, and compute what 100 presses need.

    Writes cluster.md.
    """
    from prooflight.press.press_file import PressFile
    from prooflight_studies.cluster.study import ClusterPlan, run_cluster_study

    file = PressFile.prototype() if press_file is None else PressFile.read(press_file)
    plan = ClusterPlan.quickly(seed) if quick else ClusterPlan(seed=seed)
    figures = run_cluster_study(file, out, plan=plan, progress=show.steps(quiet=json))
    report_results(figures, out / "cluster.md", json=json)
