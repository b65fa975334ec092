"""``prooflight study records``: shipping of many journals into one database, search there, and upgrades."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight_studies.commands.study import Json, Quick, Results, report_results


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
