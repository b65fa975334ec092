"""``prooflight study golden``: inspection against a golden scan, on real pairs with marked defects."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import Json, Quick, Results, report_results


def golden(
    pairs: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="NAME_temp.jpg, NAME_test.jpg and NAME.txt with marked defects, as DeepPCB has them.",
        ),
    ],
    out: Results = Path("docs/results/detector"),
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png", help="Contact sheet of what was missed, false and found; shows the scans."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the bootstrap.", min=0)] = 0,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Inspect scans against golden ones, tuned on every second pair and judged on the others; writes golden.md."""
    from prooflight_studies.golden.study import plain, run_golden_study

    rows = run_golden_study(
        pairs, out, seed=seed, quick=quick, picture=picture, progress=show.steps(quiet=json)
    )
    report_results(plain(rows), out / "golden.md", json=json)
