"""``prooflight study golden``: inspection against a golden scan, on real pairs with marked defects."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import Json, Quick, Results, show_table


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
    if json:
        show.print_json(plain(rows))
        return
    cells = []
    for row in rows:
        numbers = (f"{row.found_percent:.1f}", f"{row.false_per_image:.2f}", f"{row.mean_overlap:.2f}")
        cells.append((row.method, row.tuned_on, *numbers))
    headings = ("method", "tuned on", "found %", "false an image", "mean overlap")
    show_table("Marked defects found against a golden scan", headings, cells, text_columns=2)
    show.written(out / "golden.md")
