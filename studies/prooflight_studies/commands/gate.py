"""``prooflight study gate``: how often a bad sheet reaches the good tray."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight_studies.commands.study import CACHE, Cache, Json, Quick, Results, report_results


def gate(
    out: Results = Path("docs/results/running"),
    part: Annotated[
        list[str] | None,
        typer.Option(
            help="latency, watch, plant, counts (needs Chromium); default all. The others stay as measured."
        ),
    ] = None,
    sheets: Annotated[int | None, typer.Option(help="Of the long run; default 10,000.", min=100)] = None,
    faster: Annotated[
        float | None,
        typer.Option(help="How many times the long run is compressed; default 2.", min=1, max=50),
    ] = None,
    cache: Cache = CACHE,
    seed: Annotated[int, typer.Option(help="Of sheets, verdicts and slips.", min=0)] = 1,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Count where every sheet went under failures of camera, link, controller and watch, and who counts it; gate.md."""
    from prooflight_studies.gate.study import PARTS, run_gate_study

    for one in part or ():
        if one not in PARTS:
            raise RequestError("part", f"there is no {one!r}", remedy=f"choose {', '.join(PARTS)}")
    results = run_gate_study(
        out,
        parts=part or PARTS,
        cache=cache,
        seed=seed,
        quick=quick,
        sheets=sheets,
        faster=faster,
        progress=show.steps(quiet=json),
    )
    report_results(results, out / "gate.md", json=json)
