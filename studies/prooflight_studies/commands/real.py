"""``prooflight study real``: real copies of a paper, as they are and with marks laid into them."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import Json, Quick, Results, report_results


def real(
    copies: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the paper's PDF and its scans.")],
    out: Results = Path("docs/results/detector"),
    seed: Annotated[int, typer.Option(help="Of the marks and their places.", min=0)] = 443,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Inspect real sheets of an office scanner, as they are and with marks laid into them; writes real.md."""
    from prooflight_studies.real.study import run_real_study

    results = run_real_study(copies, out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(asdict(results), out / "real.md", json=json)
