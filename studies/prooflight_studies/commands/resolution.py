"""``prooflight study resolution``: PDFs that a press prints at a resolution of its own."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import Json, Quick, Results, show_table


def resolution(
    press: Annotated[Path, typer.Option(metavar="X.press", help="As `press build` makes it.")],
    pages: Annotated[
        Path, typer.Option(metavar="DIR", help="A folder of PDFs; their first pages are printed.")
    ],
    out: Results = Path("docs/results/jobs"),
    most: Annotated[int | None, typer.Option(help="So many pages; default all that fit.", min=1)] = None,
    seed: Annotated[int, typer.Option(help="Of prints, misprints and days.", min=0)] = 1,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Print real PDFs at 600 and 1200 dpi, and inspect them against coarser rasters; writes resolution.md."""
    from prooflight.press.artefact import Press
    from prooflight_studies.resolution.study import run_resolution_study

    results = run_resolution_study(
        Press.load(press), pages, out, seed=seed, most=most, quick=quick, progress=show.steps(quiet=json)
    )
    if json:
        show.print_json(asdict(results))
        return
    cells = (
        (
            f"{row['printed_dpi']} dpi" if row["printed_dpi"] else "the same raster",
            str(row["finer"]),
            row["false_alarms"],
            f"{row['caught']} of {row['misprints']}",
        )
        for row in results.rows
    )
    show_table(
        "Printed and expected", ("printed at", "drawn finer", "false alarms", "caught"), cells, text_columns=1
    )
    show.written(out / "resolution.md")
