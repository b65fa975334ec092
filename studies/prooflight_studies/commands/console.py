"""``prooflight study console``: the delay until a verdict is shown, and the cost of the console."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight_studies.commands.study import Json, Quick, Results, report_results

PARTS = ("live", "beside", "hour", "pages", "journeys", "search")


def console(
    out: Results = Path("docs/results/running"),
    part: Annotated[str, typer.Option(help=f"{', '.join(PARTS)}; the others stay as measured.")] = "live",
    press: Annotated[
        Path | None, typer.Option(metavar="X.press", help="Of `beside` and `hour`: what inspects.")
    ] = None,
    job: Annotated[Path | None, typer.Option(metavar="JOB", help="Of `beside` and `hour`.")] = None,
    rate: Annotated[
        float, typer.Option(help="Of `beside` and `hour`; sheets a second.", min=0.01, max=50)
    ] = 2.0,
    minutes: Annotated[
        float | None, typer.Option(help="Default 10, of `hour` 60, quick 1.", min=0.3, max=1000)
    ] = None,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the delay from a verdict to its display on 50 live pages, their load, memory, journeys and searches.

    Writes console.md.
    """
    from prooflight_studies.console.alongside import LoadPlan
    from prooflight_studies.console.study import CLIENTS, QUICK_CLIENTS, run_console_part, run_console_study

    if part not in PARTS:
        raise RequestError("part", f"there is no {part!r}", remedy=f"choose {', '.join(PARTS)}")
    steps = show.steps(quiet=json)
    if part != "live":
        plan = None
        if part in ("beside", "hour"):
            if press is None or job is None:
                raise RequestError(
                    "part", f"{part} inspects a job on a press", remedy="give --press and --job"
                )
            plan = LoadPlan(
                press=press,
                job=job,
                rate_hz=rate,
                minutes=minutes or (1.0 if quick else 60.0 if part == "hour" else 10.0),
                clients=QUICK_CLIENTS if quick else CLIENTS,
                paired=part == "beside",
                quick=quick,
            )
        figures = run_console_part(out, part, plan=plan, quick=quick, progress=steps)
        report_results(figures, out / "console.md", json=json)
        return
    results = run_console_study(out, quick=quick, progress=steps)
    report_results(asdict(results), out / "console.md", json=json)
