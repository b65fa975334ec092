"""``prooflight chart``: validation of ink models on a chart, prediction with them, and charts to print."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from prooflight.cli import show
from prooflight.cli.options import Json
from prooflight.errors import RequestError
from prooflight.files.given import shortly

if TYPE_CHECKING:
    from rich.table import Table

    from prooflight.inks.selection import CrossValidation, Score

app = typer.Typer(help="Validate ink models on charts, predict spectra, make charts.", no_args_is_help=True)

ChartPath = Annotated[Path, typer.Argument(metavar="CHART", help="CGATS text or .ti3 with CMYK and spectra.")]
Model = Annotated[str, typer.Option(help="Ink model by name, or auto.")]


def register(program: typer.Typer) -> None:
    """Add these commands to the program."""
    program.add_typer(app, name="chart")


@app.command()
def score(
    chart: ChartPath,
    model: Model = "auto",
    folds: Annotated[int, typer.Option(help="Parts of the chart that are left out in turn.")] = 10,
    report: Annotated[Path | None, typer.Option(metavar="F.html", help="Write pictures.")] = None,
    json: Json = False,
) -> None:
    """Cross-validate an ink model on a chart: each recipe is predicted by a model that was not fitted to it."""
    from prooflight.inks.chart import read_chart
    from prooflight.inks.selection import AUTO, choose, cross_validate

    measured = read_chart(chart)
    if model == AUTO:
        choice = choose(measured, folds=folds, progress=_trying(quiet=json))
        trial, scores, why = choice.best, choice.scores, choice.why
    else:
        trial = cross_validate(measured, model, folds=folds)
        scores, why = {trial.model: trial.score}, f"{model}: as requested"
    if report is not None:
        from prooflight.reporting.chart_report import write_chart_report

        write_chart_report(report, measured, trial, scores=scores, why=why)
    if json:
        show.print_json({**trial.score.as_json(), "model": trial.model, "why": why})
        return
    show.people.print(_score_table(scores, trial))
    show.people.print(why)
    if report is not None:
        show.people.print("Open", show.strong(report))


@app.command()
def predict(
    chart: ChartPath,
    cmyk: Annotated[Path, typer.Option(metavar="Q.csv", help="Recipes in per cent, header C,M,Y,K.")],
    model: Model = "auto",
    json: Json = False,
) -> None:
    """Predict the spectra of recipes by an ink model fitted to a chart."""
    from prooflight import spectra
    from prooflight.inks.chart import read_chart
    from prooflight.inks.recipes import read_recipes
    from prooflight.inks.selection import learn

    recipes = read_recipes(cmyk)
    learned = learn(read_chart(chart), model, progress=_trying(quiet=json))
    reflectance = learned.reflectance(recipes)
    if json:
        show.print_json({"wave_nm": spectra.WAVE_NM, "reflectance": reflectance, "model": learned.name})
        return
    headings = ("C", "M", "Y", "K", "L*", "a*", "b*", "450 nm", "550 nm", "650 nm")
    table = show.table_of(f"Predicted by {learned.name}", headings)
    bands = [int((wave - spectra.WAVE_NM[0]) / spectra.STEP_NM) for wave in (450, 550, 650)]
    for recipe, spectrum, colour in zip(recipes, reflectance, spectra.lab(reflectance), strict=True):
        cells = [f"{100 * ink:.0f}" for ink in recipe] + [f"{value:.1f}" for value in colour]
        table.add_row(*cells, *(f"{spectrum[band]:.3f}" for band in bands))
    show.people.print(table)


@app.command()
def make(
    out: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Where to write.")],
    patches: Annotated[int | None, typer.Option(help="Number of patches.")] = None,
    ruler: Annotated[
        bool, typer.Option("--ruler", help="Make a ruler page instead, by which a line camera is set up.")
    ] = False,
    size: Annotated[
        str, typer.Option(metavar="WxH", help="Size of the ruler page [mm] as it runs, width across the web.")
    ] = "210x297",
    ink_limit: Annotated[float, typer.Option(help="Greatest total ink [%].", min=100, max=400)] = 400.0,
    seed: Annotated[int, typer.Option(help="Seed of the patches' positions.", min=0)] = 1,
    json: Json = False,
) -> None:
    """Make a printable chart of well-chosen recipes (PDF, CMYK TIFF and a CGATS recipe file), or a ruler page (PDF)."""
    from prooflight.inks.chart_print import make_chart
    from prooflight.rng import stream

    if ruler == (patches is not None):
        raise RequestError("chart make", "makes a chart or a ruler", remedy="give --patches N, or --ruler")
    if patches is None:
        _make_ruler(out, size, json=json)
        return
    files = make_chart(out, patches, rng=stream(seed, "chart-places"), ink_limit_percent=ink_limit)
    if json:
        show.print_json({"pdf": files.pdf, "tiffs": files.tiffs, "recipes": files.recipes})
    else:
        show.people.print(
            "Print", show.strong(files.pdf), f"without colour management; its recipes: {files.recipes}"
        )


def _make_ruler(out: Path, size: str, *, json: bool) -> None:
    from prooflight.inks.ruler_layout import RulerLayout
    from prooflight.inks.ruler_print import write_ruler

    try:
        width_mm, height_mm = (float(part) for part in size.lower().split("x"))
    except ValueError:
        what = f"{shortly(size)!r} is not a width and a height"
        raise RequestError("--size", what, remedy="write e.g. 210x297") from None
    layout = RulerLayout(width_mm=width_mm, height_mm=height_mm)
    path = out / "ruler.pdf"
    out.mkdir(parents=True, exist_ok=True)
    write_ruler(path, layout)
    across, along = layout.checked_mm
    if json:
        show.print_json({"pdf": path, "size_mm": (width_mm, height_mm), "fine_lines_mm": (across, along)})
        return
    show.people.print(
        "Print",
        show.strong(path),
        f"in four inks, unscaled, without colour management; its fine lines are {across:g} and {along:g} mm apart",
    )


def _trying(*, quiet: bool) -> Callable[[str], None]:
    return lambda name: None if quiet else show.step(f"trying {name}")


def _score_table(scores: Mapping[str, Score], trial: CrossValidation) -> Table:
    title = f"{trial.folds}-fold cross-validation, CIEDE2000 (D50, 2 degrees)"
    headings = ("model", "median", "95 %", "greatest", "rms reflectance", "patches")
    table = show.table_of(title, headings, text_columns=("model",))
    for name, of_model in scores.items():
        table.add_row(
            show.strong(name) if name == trial.model else name,
            f"{of_model.median_delta_e00:.3f}",
            f"{of_model.p95_delta_e00:.3f}",
            f"{of_model.max_delta_e00:.2f}",
            f"{of_model.rms_reflectance:.5f}",
            str(of_model.patches),
        )
    return table
