"""``prooflight study``: regenerate a table or a figure of docs/results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from prooflight.cli import show

app = typer.Typer(help="Regenerate a table or a figure of docs/results.", no_args_is_help=True)

Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Quick = Annotated[bool, typer.Option("--quick", help="A minute's version.")]
Results = Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Where to write.")]


@app.command()
def ink(
    chart: Annotated[Path, typer.Option(metavar="CHART", help="A characterisation chart with spectra.")],
    out: Results = Path("docs/results"),
    folds: Annotated[int, typer.Option(help="Parts of the chart that are left out in turn.")] = 10,
    seed: Annotated[int, typer.Option(help="Of folds and added noise.", min=0)] = 0,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """All ink models on one chart: cross-validation, learning curves, speed; writes ink.md and its picture."""
    from prooflight.studies.ink_study import run_ink_study

    tell = None if json else show.step
    rows = run_ink_study(chart, out, folds=folds, seed=seed, quick=quick, progress=tell)
    if json:
        show.print_json(rows)
        return
    table = Table(title="Ink models", title_justify="left")
    for heading in ("model", "median", "95 %", "greatest", "rms reflectance"):
        table.add_column(heading, justify="left" if heading == "model" else "right")
    for row in rows:
        delta = row["delta_e00"]
        assert isinstance(delta, dict)
        cells = (f"{delta[key]:.3f}" for key in ("median", "p95", "max"))
        table.add_row(str(row["model"]), *cells, f"{row['rms_reflectance']:.5f}")
    show.people.print(table)
    show.people.print(f"Written: [bold]{out / 'ink.md'}[/bold]")


@app.command()
def inks(
    fit: Annotated[bool, typer.Option("--fit", help="Fit the coefficients again.")] = False,
    json: Json = False,
) -> None:
    """The built-in inks against the ISO 12647-2 coated aims."""
    from prooflight.printing.built_in import COEFFICIENTS
    from prooflight.studies.built_in_fit import aim_differences, fit_built_in

    coefficients = fit_built_in() if fit else dict(COEFFICIENTS)
    differences = aim_differences(coefficients)
    if json:
        show.print_json({"delta_e00": differences, "coefficients": coefficients})
        return
    table = Table(title="Built-in inks, CIEDE2000 from the coated aims", title_justify="left")
    table.add_column("colour")
    table.add_column("difference", justify="right")
    for name, difference in differences.items():
        table.add_row(name, f"{difference:.2f}")
    show.people.print(table)
