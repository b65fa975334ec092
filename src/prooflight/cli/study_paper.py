"""``prooflight study paper``: the paper's tables, reproduced and audited."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.cli.study import Json, PressFileAt, Quick, Results
from prooflight.cli.study_world import CACHE, Cache


def register(app: typer.Typer) -> None:
    """Add these commands to ``prooflight study``."""
    for command in (paper,):
        app.command()(command)


def paper(
    press_file: PressFileAt = None,
    out: Results = Path("docs/results"),
    cache: Cache = CACHE,
    seed: Annotated[int, typer.Option(help="Of designs, days, prints and misprints.", min=0)] = 1,
    cluster: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="A Dask scheduler; default this machine.")
    ] = None,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Tables 1 to 4 in the ideal and the press world, oracle and honest thresholds; writes paper.md."""
    from prooflight.press_file import PressFile
    from prooflight.studies.paper_study import run_paper_study

    if press_file is None:
        press_file = Path(str(resources.files("prooflight").joinpath("two-sensors.toml")))
    out.mkdir(parents=True, exist_ok=True)
    parts = run_paper_study(
        PressFile.read(press_file),
        out,
        cache=cache,
        seed=seed,
        quick=quick,
        cluster=cluster,
        progress=show.steps(quiet=json),
    )
    if json:
        show.print_json(parts)
    else:
        show.people.print(f"Written: [bold]{out / 'paper.md'}[/bold]")
