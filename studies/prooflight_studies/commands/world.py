"""``prooflight study``: the simulated world itself: page designs, prints, registration, calibration."""

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
    Quick,
    Results,
    job_or_sample,
    report_results,
)


def corpus(
    pages: PagesDir = None,
    out: Results = Path("docs/results/simulation"),
    seed: Annotated[int, typer.Option(help="Seed of the designs.", min=0)] = 2,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the composed page designs of the studies, and real pages; writes corpus.md and its pictures."""
    from prooflight_studies.corpus.sheet import run_corpus_study

    out.mkdir(parents=True, exist_ok=True)
    results = run_corpus_study(out, pages=pages, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(results, out / "corpus.md", json=json)


def worlds(
    pages: Annotated[Path, typer.Option(metavar="DIR", help="PDF pages, pieces of which are printed.")],
    out: Results = Path("docs/results/simulation"),
    seed: Annotated[int, typer.Option(help="Seed of sessions and prints.", min=0)] = 1,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Compare fast scans of the press world with exact ones by the full spectral path; writes worlds.md."""
    from prooflight_studies.worlds.study import run_world_study

    out.mkdir(parents=True, exist_ok=True)
    rows = run_world_study(pages, out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(rows, out / "worlds.md", json=json)


def registration(
    pages: PagesDir = None,
    out: Results = Path("docs/results/prediction"),
    cache: Cache = CACHE,
    seed: Annotated[int, typer.Option(help="Seed of designs, sessions and prints.", min=0)] = 6,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the accuracy of registration in press-world scans; writes registration.md."""
    from prooflight.commissioning.build import build_press
    from prooflight.press.press_file import PressFile
    from prooflight_studies.registration.study import CROP_PIXELS, run_register_study

    out.mkdir(parents=True, exist_ok=True)
    press_file = PressFile.prototype()
    results = run_register_study(
        build_press(press_file, seed=1),
        build_press(press_file, seed=1, pixels=CROP_PIXELS),
        out,
        cache,
        pages=pages,
        seed=seed,
        **({"designs": 6, "prints": 2, "crop_designs": 4} if quick else {}),
        progress=show.steps(quiet=json),
    )
    report_results(results, out / "registration.md", json=json)


def calibration(
    pages: PagesDir = None,
    out: Results = Path("docs/results/prediction"),
    seed: Annotated[int, typer.Option(help="Seed of charts, sessions and prints.", min=0)] = 1,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Compare tables learned from scans of printed charts with the truth; writes calibration.md."""
    from prooflight_studies.calibration.study import run_calibration_study

    out.mkdir(parents=True, exist_ok=True)
    with job_or_sample(None) as sample:
        jobs = {"sample job": sample} | ({} if pages is None else {"real pages": pages})
        rows = run_calibration_study(jobs, out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(rows, out / "calibration.md", json=json)
