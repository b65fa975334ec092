"""``prooflight study content``: codes and numbers on prints of the press world."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from prooflight.cli import show
from prooflight.cli.options import ClusterAt
from prooflight_studies.commands.study import (
    CACHE,
    Cache,
    Json,
    Quick,
    Results,
    processes_of,
    report_results,
)

if TYPE_CHECKING:
    from prooflight.pages.parallel import Processes


class Part(StrEnum):
    """Parts of the study."""

    CODES = "codes"
    TEXT = "text"


def content(
    out: Results = Path("docs/results/jobs"),
    part: Annotated[Part, typer.Option(help="codes: bar codes. text: digits of numbers.")] = Part.CODES,
    seed: Annotated[int, typer.Option(help="Of what is printed, its prints and its damage.", min=0)] = 19,
    sheets: Annotated[
        int, typer.Option(help="Of numbers of each size; each gives three wrong digits.", min=4)
    ] = 168,
    pitch: Annotated[
        list[float] | None, typer.Option(help="Of the camera, for numbers; default 0.254 and 0.127. [mm]")
    ] = None,
    cache: Cache = CACHE,
    cluster: ClusterAt = None,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Print codes of eight symbologies, or numbers of 6 to 10 pt, and count what is caught; writes content.md."""
    if part is Part.TEXT:
        _text(
            out,
            seed=seed,
            sheets=sheets,
            pitches_mm=pitch,
            cache=cache,
            processes=processes_of(cluster),
            quick=quick,
            json=json,
        )
        return
    from prooflight_studies.content.study import run_content_study

    results = run_content_study(out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(asdict(results), out / "content.md", json=json)


def _text(
    out: Path,
    *,
    seed: int,
    sheets: int,
    pitches_mm: list[float] | None,
    cache: Path,
    processes: Processes,
    quick: bool,
    json: bool,
) -> None:
    from prooflight_studies.content.numbers import PITCHES_MM, run_text_study
    from prooflight_studies.content.study import write_text

    results = run_text_study(
        cache / "content-text",
        seed=seed,
        sheets=sheets,
        pitches_mm=pitches_mm or PITCHES_MM,
        processes=processes,
        quick=quick,
        progress=show.steps(quiet=json),
    )
    write_text(out, results)
    report_results(asdict(results), out / "content.md", json=json)
