"""``prooflight bench``: speed relative to baselines, in one run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from prooflight.cli import show
from prooflight.cli.options import OnDevice
from prooflight_studies.commands.study import show_table

CARD_SEED: Final = 318
"""Seed of press, job and prints of ``--device gpu``."""
DESIGNS: Final = 24
"""Designs that train its press, as ``demo``'s."""


def bench(
    quick: Annotated[bool, typer.Option("--quick", help="Small pages.")] = False,
    device: OnDevice = "cpu",
    job: Annotated[
        Path | None,
        typer.Option("--job", metavar="JOB", help="With --device gpu: default the sample job."),
    ] = None,
    prints: Annotated[
        int, typer.Option(help="With --device gpu: number of prints judged on the processor and on the card.")
    ] = 100,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    docs: Annotated[
        Path | None, typer.Option("--docs", help="Write performance.md and its picture into this folder.")
    ] = None,
) -> None:
    """Measure prediction, comparison and whole pages as ratios to baselines measured in the same run, one core."""
    from prooflight.commissioning.build import build_press
    from prooflight.pages.process import settle_process
    from prooflight.press.press_file import PressFile
    from prooflight_studies.speed.study import bench as timed

    if device == "gpu":
        _of_card(job, prints=prints, docs=docs, json=json)
        return
    if not json:
        show.step("building the prototype and timing")
    press = build_press(PressFile.prototype(), seed=1)
    settle_process()  # as processes are that inspect page after page; baselines gain by it too
    rows = timed(press, quick=quick)
    if docs is not None:
        from prooflight_studies.speed.picture import page_costs, write_speed_page

        write_speed_page(rows, page_costs(press, quick=quick), docs)
    if json:
        show.print_json(rows)
        return
    cells = []
    for row in rows:
        spread = f"{row.lowest_mpx_per_cpu_s:,.0f} .. {row.highest_mpx_per_cpu_s:,.0f}"
        cells.append((row.name, f"{row.mpx_per_cpu_s:,.1f}", spread, f"{row.ratio:.2f}"))
    headings = ("step", "Mpx/s", "range", "ratio")
    show_table("Megapixels a second of processor time, one core", headings, cells)


def _of_card(job: Path | None, *, prints: int, docs: Path | None, json: bool) -> None:
    """Compare a card with the processor on a job's pages, and time both."""
    from tempfile import TemporaryDirectory

    from prooflight.commissioning.build import build_press
    from prooflight.commissioning.training.cache import trained_once
    from prooflight.detectors.base import refuse_without_card
    from prooflight.press.press_file import PressFile

    refuse_without_card()
    from prooflight_studies.harness.page import plain
    from prooflight_studies.speed.card import card_figures, card_section, write_card_section

    say = show.steps(quiet=json)
    say("building and training the prototype")
    press = trained_once(
        build_press(PressFile.prototype(), seed=CARD_SEED), designs=DESIGNS, seed=CARD_SEED, progress=say
    )
    with TemporaryDirectory() as folder:
        if job is None:
            from prooflight.simulation.corpus.sample_job.sample_job import make_sample_job

            job = make_sample_job(Path(folder) / "sample-job.pdf", seed=CARD_SEED).path
        figures = card_figures(job, press, seed=CARD_SEED, prints=prints, say=say)
    if docs is not None:
        write_card_section(figures, docs)
    if json:
        show.print_json(figures)
    else:
        show.people.print(card_section(plain(figures)))
