"""``prooflight study ranking``, ``stress``, ``visible``, ``golden``, ``real``: detectors judged on sheets."""

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
    chosen,
    report_results,
)


def golden(
    pairs: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="NAME_temp.jpg, NAME_test.jpg and NAME.txt with marked defects, as DeepPCB has them.",
        ),
    ],
    out: Results = Path("docs/results/detector"),
    seed: Annotated[int, typer.Option(help="Seed of the bootstrap.", min=0)] = 0,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Inspect scans against golden ones, tuned on every second pair and judged on the others; writes golden.md."""
    from prooflight_studies.golden.study import plain, run_golden_study

    rows = run_golden_study(pairs, out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(plain(rows), out / "golden.md", json=json)


def real(
    copies: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the paper's PDF and its scans.")],
    out: Results = Path("docs/results/detector"),
    seed: Annotated[int, typer.Option(help="Seed of the marks and their places.", min=0)] = 443,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Inspect real sheets of an office scanner, as they are and with marks laid into them; writes real.md."""
    from prooflight_studies.real.study import run_real_study

    results = run_real_study(copies, out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(results, out / "real.md", json=json)


def visible(
    out: Results = Path("docs/results/detector"),
    cache: Cache = CACHE,
    part: Annotated[
        list[str] | None,
        typer.Option(metavar="PART", help="marks, one-sensor, curves or fine-curves; all if not given."),
    ] = None,
    processes: Processes = None,
    seed: Annotated[int, typer.Option(help="Seed of presses, designs, days, prints and marks.", min=0)] = 235,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Named marks on bare paper and tints, false alarms by difficulty, and curves by place; writes visible.md."""
    from prooflight_studies.visible.study import PARTS, VisiblePlan, run_visible_study

    results = run_visible_study(
        out,
        cache=cache / "visible",
        plan=VisiblePlan.quick(seed) if quick else VisiblePlan(seed=seed),
        parts=chosen(part, PARTS),
        quick=quick,
        processes=processes,
        progress=show.steps(quiet=json),
    )
    report_results(results, out / "visible.md", json=json)


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
    from prooflight_studies.ranking.study import RankingPlan, run_ranking_study

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
