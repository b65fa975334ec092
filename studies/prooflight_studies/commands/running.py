"""``prooflight study running``, ``cameras``, ``soak``, ``gate``, ``console``, ``feedback``: a press that runs."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight.errors import RequestError
from prooflight_studies.commands.study import (
    CACHE,
    Cache,
    Json,
    Processes,
    Quick,
    Results,
    chosen,
    report_results,
)

SCREENS = Path("docs/images/screens")
"""Folder of the pictures of the console, which all documents show."""


def running(
    press: Annotated[
        Path | None,
        typer.Option(metavar="X.press", help="Trained press of one sensor; default the prototype."),
    ] = None,
    part: Annotated[
        list[str] | None,
        typer.Option(
            help="started_one, started_two, started_pages, matched_filter, drift, streak; default all."
        ),
    ] = None,
    pages: Annotated[
        Path | None,
        typer.Option(metavar="JOB", help="Job of different pages, for the part started_pages; default none."),
    ] = None,
    out: Results = Path("docs/results/running"),
    cache: Cache = CACHE,
    threads: Annotated[
        int | None, typer.Option(help="Number of threads that inspect; default one per core.", min=1)
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of prints, faults and days.", min=0)] = 1,
    sheets: Annotated[
        int | None, typer.Option(help="Number of sheets of the rows in real time; default 2,000.", min=1)
    ] = None,
    again: Annotated[
        bool, typer.Option("--again", help="Measure again the parts that have results.")
    ] = False,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the running press part by part, resuming an interrupted study; writes running.md after each part."""
    from prooflight_studies.running.study import PARTS, Plan, Study

    plan = Plan.of(quick=quick)
    out.mkdir(parents=True, exist_ok=True)
    study = Study(
        out=out,
        cache=cache,
        plan=plan if sheets is None else replace(plan, live_sheets=sheets),
        seed=seed,
        one=press,
        inspectors=threads or os.cpu_count() or 1,
        progress=show.steps(quiet=json),
        pages=pages,
    )
    results = study.run(chosen(part, PARTS), again=again)
    report_results(results, out / "running.md", json=json)


def cameras(
    part: Annotated[
        list[str] | None, typer.Option(help="job, losses, unseen, deaths, away, step, speed; default all.")
    ] = None,
    press: Annotated[
        Path | None,
        typer.Option(
            metavar="X.press", help="Press trained for all detectors, for `unseen`; default the job's."
        ),
    ] = None,
    out: Results = Path("docs/results/running"),
    cache: Cache = CACHE,
    seed: Annotated[int, typer.Option(help="Seed of prints and losses.", min=0)] = 1,
    again: Annotated[
        bool, typer.Option("--again", help="Measure again the parts that have results.")
    ] = False,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure cameras on loopback, part by part: lines, losses, failures, synchronisation, speed; writes cameras.md."""
    from prooflight_studies.cameras.study import PARTS, Plan, Study

    out.mkdir(parents=True, exist_ok=True)
    study = Study(
        out=out,
        cache=cache,
        plan=Plan.of(quick=quick),
        seed=seed,
        press=press,
        progress=show.steps(quiet=json),
    )
    results = study.run(chosen(part, PARTS), again=again)
    report_results(results, out / "cameras.md", json=json)


def soak(
    out: Results = Path("docs/results/running"),
    sheets: Annotated[
        int | None, typer.Option(help="Number of sheets that pass; default 3600, an hour.", min=20)
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of pages, prints and faults.", min=0)] = 12,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Play an hour of pages with random faults, as fast as possible, and check the reports; writes soak.md."""
    from prooflight_studies.soak.study import run_soak_study

    results = run_soak_study(out, sheets=sheets, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(results, out / "soak.md", json=json)


def gate(
    out: Results = Path("docs/results/running"),
    part: Annotated[
        list[str] | None,
        typer.Option(
            help="latency, watch, plant, counts (needs Chromium); default all. The others stay as measured."
        ),
    ] = None,
    sheets: Annotated[
        int | None, typer.Option(help="Number of sheets of the long run; default 10,000.", min=100)
    ] = None,
    faster: Annotated[
        float | None,
        typer.Option(help="How many times the long run is compressed; default 2.", min=1, max=50),
    ] = None,
    cache: Cache = CACHE,
    seed: Annotated[int, typer.Option(help="Seed of sheets, verdicts and slips.", min=0)] = 1,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Count where every sheet went under failures of camera, link, controller and watch, and who counts it; gate.md."""
    from prooflight_studies.gate.study import PARTS, run_gate_study

    results = run_gate_study(
        out,
        parts=chosen(part, PARTS),
        cache=cache,
        seed=seed,
        quick=quick,
        sheets=sheets,
        faster=faster,
        progress=show.steps(quiet=json),
    )
    report_results(results, out / "gate.md", json=json)


def console(
    out: Results = Path("docs/results/running"),
    part: Annotated[
        str,
        typer.Option(
            help="live, browsers, beside, hour, pages, journeys or search; the others stay as measured. "
            "screens: pictures."
        ),
    ] = "live",
    press: Annotated[
        Path | None,
        typer.Option(
            metavar="X.press",
            help="Press that inspects in `beside` and `hour`, and of `screens`; there default the demo's.",
        ),
    ] = None,
    job: Annotated[
        Path | None,
        typer.Option(
            metavar="JOB", help="Job of `beside`, `hour` and `screens`; there default the sample job."
        ),
    ] = None,
    rate: Annotated[
        float, typer.Option(help="Sheets per second, for `beside` and `hour`.", min=0.01, max=50)
    ] = 2.0,
    minutes: Annotated[
        float | None,
        typer.Option(help="Duration of a part; default 10, of `hour` 60, quick 1.", min=0.3, max=1000),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the press that is trained for `journeys`.", min=0)] = 547,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the delay from a verdict to its display on 50 live pages, their load, memory, journeys and searches.

    Writes console.md. The part `screens` pictures every page of the console at three widths, light and dark, and writes
    screens.md with docs/images/screens.
    """
    from prooflight_studies.console.alongside import LoadPlan
    from prooflight_studies.console.study import (
        CLIENTS,
        PARTS,
        QUICK_CLIENTS,
        run_console_part,
        run_console_study,
    )

    chosen([part], (*PARTS, "screens"))
    steps = show.steps(quiet=json)
    if part == "screens":
        from prooflight_studies.screens.study import run_screens_study

        figures = run_screens_study(out / "screens.md", SCREENS, press=press, job=job, progress=steps)
        report_results(figures, out / "screens.md", json=json)
        return
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
        figures = run_console_part(out, part, plan=plan, quick=quick, seed=seed, progress=steps)
        report_results(figures, out / "console.md", json=json)
        return
    results = run_console_study(out, quick=quick, progress=steps)
    report_results(results, out / "console.md", json=json)


def feedback(
    out: Results = Path("docs/results/running"),
    cache: Cache = CACHE,
    processes: Processes = None,
    seed: Annotated[int, typer.Option(help="Seed of designs, days, prints and weeks.", min=0)] = 23,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Compare target and realised false alarms of a drifted press before and after feedback; writes feedback.md."""
    from prooflight_studies.feedback.pool import PoolPlan
    from prooflight_studies.feedback.study import run_feedback_study

    results = run_feedback_study(
        out,
        cache=cache / "feedback",
        plan=PoolPlan.quick(seed) if quick else PoolPlan(seed=seed),
        quick=quick,
        processes=processes,
        progress=show.steps(quiet=json),
    )
    report_results(results, out / "feedback.md", json=json)
