"""``prooflight study``: regenerate a table or a figure of docs/results."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click
import typer
from rich.table import Table

from prooflight.cli import show
from prooflight.cli.workers import workers
from prooflight.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from prooflight.pages import parallel

app = typer.Typer(help="Regenerate a table or a figure of docs/results.", no_args_is_help=True)

Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Quick = Annotated[bool, typer.Option("--quick", help="Version that takes about a minute.")]
JobFile = Annotated[Path | None, typer.Option(metavar="F.pdf", help="A job; default the sample job.")]
PressFileAt = Annotated[
    Path | None, typer.Option(metavar="PRESS.toml", help="Press file; default the prototype.")
]
Cache = Annotated[
    Path,
    typer.Option(metavar="DIR", help="Where results are stored, so that an interrupted study continues."),
]
CACHE = Path("study-cache")
Processes = Annotated[
    int | None, typer.Option(help="Number of processes at a time; default all cores.", min=1)
]
PagesDir = Annotated[
    Path | None, typer.Option(metavar="DIR", help="A folder of real pages, PDF or CMYK TIFF.")
]
Results = Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Where to write.")]


def chosen(part: Sequence[str] | None, parts: Sequence[str]) -> tuple[str, ...]:
    """Return the parts of a study that were asked for, or all of them; RequestError: there is no such part."""
    for one in part or ():
        if one not in parts:
            raise RequestError("part", f"there is no {one!r}", remedy=f"choose from {', '.join(parts)}")
    return tuple(part or parts)


def processes_of(cluster: str | None, processes: int | None = None) -> parallel.Processes:
    """Return the workers of ``--cluster`` as long as the command runs; None: so many processes of this machine."""
    if cluster is None:
        return processes
    return click.get_current_context().with_resource(workers(cluster))


def report_results(results: object, path: Path, *, json: bool) -> None:
    """Print the results for programs, or where they are written for people, who read them there."""
    if json:
        show.print_json(results)
    else:
        show.written(path)


def show_table(
    title: str, headings: Sequence[str], rows: Iterable[Sequence[str]], *, text_columns: int = 1
) -> None:
    """Print rows as a table for people; text_columns: number of columns aligned left, before the numbers."""
    table = Table(title=title, title_justify="left")
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="left" if place < text_columns else "right")
    for row in rows:
        table.add_row(*row)
    show.people.print(table)


@app.command()
def ink(
    chart: Annotated[Path, typer.Option(metavar="CHART", help="A characterisation chart with spectra.")],
    out: Results = Path("docs/results/prediction"),
    folds: Annotated[int, typer.Option(help="Parts of the chart that are left out in turn.")] = 10,
    seed: Annotated[int, typer.Option(help="Seed of folds and added noise.", min=0)] = 0,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Evaluate all ink models on one chart: cross-validation, learning curves, speed; writes ink.md and its picture."""
    from prooflight_studies.ink.study import run_ink_study

    tell = show.steps(quiet=json)
    rows = run_ink_study(chart, out, folds=folds, seed=seed, quick=quick, progress=tell)
    report_results(rows, out / "ink.md", json=json)


@app.command()
def inks(
    fit: Annotated[bool, typer.Option("--fit", help="Fit the coefficients again.")] = False,
    json: Json = False,
) -> None:
    """Compare the built-in inks with the ISO 12647-2 coated aims."""
    from prooflight.inks.built_in import COEFFICIENTS
    from prooflight_studies.ink.built_in_fit import aim_differences, fit_built_in

    coefficients = fit_built_in() if fit else dict(COEFFICIENTS)
    differences = aim_differences(coefficients)
    if json:
        show.print_json({"delta_e00": differences, "coefficients": coefficients})
        return
    cells = ((name, f"{difference:.2f}") for name, difference in differences.items())
    show_table("Built-in inks, CIEDE2000 from the coated aims", ("colour", "difference"), cells)


@app.command()
def tables(
    pages: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Pages whose colours count: a folder of PDFs, or a PDF."),
    ] = None,
    job: JobFile = None,
    press_file: PressFileAt = None,
    chart: Annotated[
        Path | None,
        typer.Option(metavar="CHART", help="Judge the same press with this chart's inks as well."),
    ] = None,
    out: Results = Path("docs/results/prediction"),
    seed: Annotated[int, typer.Option(help="Seed of the specimen and of colours drawn.", min=0)] = 1,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Compare the look-up tables with the exact model, on the colours of real pages; writes tables.md."""
    from prooflight.press.press_file import PressFile
    from prooflight_studies.tables.study import run_table_study, with_chart

    press = PressFile.read(press_file) if press_file else PressFile.prototype()
    presses = [press] if chart is None else [press, with_chart(press, chart)]
    tell = show.steps(quiet=json)
    with job_or_sample(job) as job_path:
        jobs = {"sample job" if job is None else job.stem: job_path}
        if pages is not None:
            jobs["real pages"] = pages
        rows = run_table_study(presses, jobs, out, seed=seed, quick=quick, progress=tell)
    report_results(rows, out / "tables.md", json=json)


@app.command()
def page(
    results: Annotated[
        Path, typer.Argument(metavar="RESULTS.json", help="JSON file that a study wrote next to its page.")
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="PAGE.md", help="Default next to the results.")
    ] = None,
    json: Json = False,
) -> None:
    """Write a study's page again from its results, without measuring."""
    from prooflight_studies.harness.page import page_again

    path = page_again(results, out)
    report_results({"page": str(path)}, path, json=json)


@contextlib.contextmanager
def job_or_sample(job: Path | None) -> Iterator[Path]:
    """Yield the job's path, or that of the sample job, which exists as long as the context lasts."""
    if job is not None:
        yield job
        return
    from prooflight.simulation.corpus.sample_job.sample_job import make_sample_job

    with tempfile.TemporaryDirectory() as folder:
        yield make_sample_job(Path(folder) / "sample.pdf").path


@app.command()
def edges(
    pages: Annotated[
        Path,
        typer.Option(
            metavar="DIR", help="PDF pages; their manifest, pages_manifest.json, must be next to them."
        ),
    ],
    out: Results = Path("docs/results/prediction"),
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Compare prediction at the edges of letters and lines with the exact camera; writes edges.md."""
    from prooflight_studies.edges.study import run_edge_study

    study = run_edge_study(pages, out, quick=quick, progress=show.steps(quiet=json))
    report_results(study, out / "edges.md", json=json)
