"""``prooflight study rip``: our RIP and Ghostscript compared with the specification."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import Json, PagesDir, Quick, Results, show_table

CasesDir = Annotated[
    Path | None, typer.Option(metavar="DIR", help="A folder of PDFs that were once printed wrong.")
]


def rip(
    out: Results = Path("docs/results/jobs"),
    cases: CasesDir = None,
    pages: PagesDir = None,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Rasterise PDFs whose ink the specification fixes, by our RIP and by Ghostscript; writes rip.md."""
    from prooflight_studies.rip.study import run_rip_study

    results = run_rip_study(
        out, cases=cases, pages=pages, most=4 if quick else None, progress=show.steps(quiet=json)
    )
    if json:
        show.print_json(asdict(results))
        return
    cells = (
        (
            row.name,
            row.clause,
            *(" ".join(map(str, inks)) or "-" for inks in (row.right, row.ours, row.ghostscript)),
        )
        for row in results.rows
    )
    show_table("Ink of 255", ("case", "clause", "right", "ours", "Ghostscript"), cells, text_columns=2)
    show.written(out / "rip.md")
