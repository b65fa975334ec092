"""``prooflight study content``, ``zones``: codes and numbers on prints, and the cost of zones."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import CACHE, Cache, Json, Quick, Results, report_results


class Part(StrEnum):
    """Parts of the study."""

    CODES = "codes"
    TEXT = "text"


def content(
    out: Results = Path("docs/results/jobs"),
    part: Annotated[Part, typer.Option(help="codes: bar codes. text: digits of numbers.")] = Part.CODES,
    seed: Annotated[
        int, typer.Option(help="Seed of what is printed, its prints and its damage.", min=0)
    ] = 19,
    sheets: Annotated[
        int, typer.Option(help="Number of numbers of each size; each gives three wrong digits.", min=4)
    ] = 168,
    pitch: Annotated[
        list[float] | None,
        typer.Option(help="Pixel pitches of the camera, for numbers; default 0.254 and 0.127. [mm]"),
    ] = None,
    cache: Cache = CACHE,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Print codes of eight symbologies, or numbers of 6 to 10 pt, and count what is caught; writes content.md."""
    if part is Part.TEXT:
        _text(out, seed=seed, sheets=sheets, pitches_mm=pitch, cache=cache, quick=quick, json=json)
        return
    from prooflight_studies.content.study import run_content_study

    results = run_content_study(out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(results, out / "content.md", json=json)


def _text(
    out: Path, *, seed: int, sheets: int, pitches_mm: list[float] | None, cache: Path, quick: bool, json: bool
) -> None:
    from prooflight_studies.content.numbers import PITCHES_MM, run_text_study
    from prooflight_studies.content.study import write_text

    results = run_text_study(
        cache / "content-text",
        seed=seed,
        sheets=sheets,
        pitches_mm=pitches_mm or PITCHES_MM,
        quick=quick,
        progress=show.steps(quiet=json),
    )
    write_text(out, results)
    report_results(results, out / "content.md", json=json)


def zones(
    out: Results = Path("docs/results/jobs"),
    seed: Annotated[int, typer.Option(help="Seed of pages, zones, prints and defects.", min=0)] = 37,
    quick: Quick = False,
    json: Json = False,
) -> None:
    """Measure the predicted and observed cost of careful and ignored zones, and false alarms; writes zones.md."""
    from prooflight_studies.zones.study import run_zones_study

    results = run_zones_study(out, seed=seed, quick=quick, progress=show.steps(quiet=json))
    report_results(results, out / "zones.md", json=json)
