"""``prooflight study ranking``, ``stress``: the matched filter in the press world."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import (
    CACHE,
    Cache,
    Json,
    PagesDir,
    Processes,
    Quick,
    Results,
    report_results,
)


def ranking(
    out: Results = Path("docs/results/detector"),
    cache: Cache = CACHE,
    ship: Annotated[bool, typer.Option("--ship", help="Write the ranking into the package as well.")] = False,
    left_out: Annotated[
        bool, typer.Option(help="Judge each kind also by a ranking that was not trained with it.")
    ] = True,
    processes: Processes = None,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Train the shipped ranking and evaluate it by cross-validation; writes ranking.md."""
    from prooflight.detectors.matched_filter import shipped
    from prooflight_studies.ranking.rows import RankingPlan
    from prooflight_studies.ranking.study import run_ranking_study

    out.mkdir(parents=True, exist_ok=True)
    results = run_ranking_study(
        out,
        cache=cache / "ranking",
        plan=RankingPlan.quick() if quick else RankingPlan(),
        ship=Path(shipped.__file__).with_name(shipped.FILE) if ship else None,
        left_out=left_out,
        processes=processes,
        progress=show.steps(quiet=json),
    )
    report_results(results, out / "ranking.md", json=json)


def stress(
    stress_file: Annotated[
        Path, typer.Option("--stress", metavar="STRESS.toml", help="Nuisances and misprints to judge by.")
    ],
    out: Results = Path("docs/results/detector"),
    cache: Cache = CACHE,
    runs: Annotated[
        int | None,
        typer.Option(help="Number of runs of 30 good pages under each nuisance; default 10.", min=1),
    ] = None,
    marks: Annotated[
        int | None, typer.Option(help="Designs on which each mark is drawn; 120 if not given.", min=4)
    ] = None,
    wrong: Annotated[
        int | None, typer.Option(help="Designs printed wrong; 300 if not given.", min=12)
    ] = None,
    good: Annotated[
        int | None, typer.Option(help="Designs printed once more, well; 2240 if not given.", min=4)
    ] = None,
    pages: PagesDir = None,
    seed: Annotated[int, typer.Option(help="Seed of designs, days, prints and misprints.", min=0)] = 53,
    processes: Processes = None,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Evaluate on untrained nuisances, before and after learning, and on untrained misprints; writes stress.md."""
    from dataclasses import replace

    from prooflight_studies.harness.folder import Folder
    from prooflight_studies.paper.study import REDUCED_DPI
    from prooflight_studies.stress.study import StressPlan, run_stress_study

    plan = StressPlan(seed=seed)
    if quick:
        plan = replace(plan, learn=20, runs=1, per_run=6, marks=8, wrong=12, good=12, rounds=1)
    given = {"runs": runs, "marks": marks, "wrong": wrong, "good": good}
    plan = replace(plan, **{name: count for name, count in given.items() if count})
    out.mkdir(parents=True, exist_ok=True)
    results = run_stress_study(
        stress_file,
        out,
        cache=cache / "stress",
        plan=plan,
        real=None if pages is None else Folder(path=pages, dpi=REDUCED_DPI),
        processes=processes,
        progress=show.steps(quiet=json),
    )
    report_results(results, out / "stress.md", json=json)
