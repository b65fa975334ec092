"""``prooflight study paper``, ``robustness``, ``design``: the paper's tables, its claims, and its purpose."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from prooflight.cli import show
from prooflight.cli.options import ClusterAt
from prooflight_studies.commands.study import (
    CACHE,
    Cache,
    Json,
    PressFileAt,
    Processes,
    Quick,
    Results,
    processes_of,
    report_results,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight_studies.design.results import DesignRow

Seed = Annotated[int, typer.Option(help="Seed of designs, days, prints and misprints.", min=0)]

PUBLISHED_SEED = 3
"""Seed of ``paper.md``; it played no part in choosing the settings that are measured."""
OneWorld = Annotated[
    str | None, typer.Option("--world", metavar="ideal|press", help="One world; default both.")
]


def paper(
    press_file: PressFileAt = None,
    out: Results = Path("docs/results/paper"),
    cache: Cache = CACHE,
    seed: Seed = PUBLISHED_SEED,
    processes: Processes = None,
    cluster: ClusterAt = None,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Reproduce tables 1 to 4 in the ideal and the press world, oracle and honest thresholds; writes paper.md.

    Published with seed 3; with 7 the noise of table 4 was chosen.
    """
    from prooflight.press.press_file import TWO_SENSORS, PressFile
    from prooflight_studies.paper.study import run_paper_study

    out.mkdir(parents=True, exist_ok=True)
    parts = run_paper_study(
        PressFile.read(press_file) if press_file else PressFile.preset(TWO_SENSORS),
        out,
        cache=cache,
        seed=seed,
        quick=quick,
        processes=processes_of(cluster, processes),
        progress=show.steps(quiet=json),
    )
    report_results(parts, out / "paper.md", json=json)


def robustness(
    press_file: PressFileAt = None,
    out: Results = Path("docs/results/paper"),
    cache: Cache = CACHE,
    seed: Seed = 1,
    world: OneWorld = None,
    cluster: ClusterAt = None,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the cost of a wrong model of the camera to each detector, kept and relearned; writes robustness.md."""
    from prooflight.press.press_file import TWO_SENSORS, PressFile
    from prooflight_studies.robustness.study import run_robustness_study

    out.mkdir(parents=True, exist_ok=True)
    parts = run_robustness_study(
        PressFile.read(press_file) if press_file else PressFile.preset(TWO_SENSORS),
        out,
        cache=cache,
        seed=seed,
        quick=quick,
        world=world,
        processes=processes_of(cluster),
        progress=show.steps(quiet=json),
    )
    report_results(parts, out / "robustness.md", json=json)


def design(
    press_file: Annotated[Path, typer.Argument(metavar="PRESS.toml", help="The camera to start from.")],
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FIELD=a,b,c",
            help="Values of a field, as `camera explore` has it; FIELD+FIELD=a+b,c+d for values that go together; "
            "sensors=1,2 for the file's first sensors.",
        ),
    ] = None,
    each_alone: Annotated[
        bool,
        typer.Option(
            "--each-alone", help="The file as it is and one change at a time, not all combinations."
        ),
    ] = False,
    sensor_cost: Annotated[
        float,
        typer.Option(metavar="CENTS", help="Cost of one sensor with its share of lens and electronics."),
    ] = 0.0,
    computing_cost: Annotated[
        float, typer.Option(metavar="CENTS", help="Cost of computing one sensor's pixels on 10,000 pages.")
    ] = 0.0,
    price: Annotated[
        list[str] | None,
        typer.Option(metavar="FIELD=VALUE:CENTS", help="What a design with that value costs more."),
    ] = None,
    life_pages: Annotated[
        float, typer.Option(metavar="N", help="Pages over which hardware is written off.")
    ] = 1e8,
    detector: Annotated[
        str, typer.Option(help="bayes, chi-square, difference, ssim or variation.")
    ] = "bayes",
    coarser: Annotated[
        float, typer.Option(help="Study with pixels so many times as wide; 1: each design's own.")
    ] = 5.0,
    more: Annotated[int, typer.Option(help="So many times as many page designs.", min=1)] = 1,
    out: Results = Path("docs/results/paper"),
    cache: Cache = CACHE,
    seed: Seed = 1,
    world: OneWorld = None,
    cluster: ClusterAt = None,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Compare designs of a camera: errors per 10,000 pages against hardware and computing; writes design.md."""
    from prooflight.press.press_file import PressFile
    from prooflight_studies.design.choices import Prices, choices, parse_prices
    from prooflight_studies.design.study import run_design_study

    base = PressFile.read(press_file)
    chosen = choices(vary or [], each_alone=each_alone)
    prices = Prices(
        sensor_cents=sensor_cost,
        computing_cents=computing_cost,
        life_pages=life_pages,
        of_values=parse_prices(price or [], chosen),
    )
    out.mkdir(parents=True, exist_ok=True)
    rows = run_design_study(
        base,
        chosen,
        prices,
        out,
        cache=cache,
        detector=detector,
        coarser=coarser,
        seed=seed,
        quick=quick,
        world=world,
        more=more,
        command=shlex.join(["prooflight", *sys.argv[1:]]),
        processes=processes_of(cluster),
        progress=show.steps(quiet=json),
    )
    if json:
        show.print_json(rows)
        return
    show.people.print(_cents(rows))
    show.written(out / "design.md")


def _cents(rows: Iterable[DesignRow]) -> Table:
    table = Table(title="Cents per 10,000 pages", title_justify="left")
    for heading in ("world", "design", "errors", "saves", "hardware", "computing", "total", ""):
        table.add_column(heading, justify="left" if heading in ("world", "design", "") else "right")
    for row in rows:
        errors, saving = row.error_cents, row.saving_cents
        table.add_row(
            row.world,
            row.design,
            *(f"{one.value:.3g} [{one.low:.3g}, {one.high:.3g}]" for one in (errors, saving)),
            *(f"{cents:.3g}" for cents in (row.hardware_cents, row.computing_cents, row.total_cents)),
            "efficient" if row.efficient else "",
        )
    return table
