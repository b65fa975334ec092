"""``prooflight study records``, ``cluster``: many presses in one database, and work shared by workers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight_studies.commands.study import Json, PressFileAt, Quick, Results, report_results


def records(
    out: Results = Path("docs/results/running"),
    part: Annotated[
        str, typer.Option(help="shipping, backlog, search or migration; the others stay as measured.")
    ] = "shipping",
    seed: Annotated[int, typer.Option(help="Seed of searches, and of the jobs of a week.", min=0)] = 1,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Ship 40 journals while all parts fail in turn, and one of a week; search 10 million sheets; upgrade a million.

    Writes records.md.
    """
    from prooflight_studies.records.study import PARTS, run_records_study

    if part not in PARTS:
        raise RequestError("part", f"there is no {part!r}", remedy=f"choose {' or '.join(PARTS)}")
    figures = run_records_study(out, part, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(figures, out / "records.md", json=json)


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
