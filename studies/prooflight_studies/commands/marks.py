"""``prooflight study visible``, ``golden``, ``real``: marks that people see, golden scans, and real sheets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
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
