"""``prooflight bench``: speed relative to baselines, in one run."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from typing import Annotated

import typer

from prooflight.cli import show
from prooflight_studies.commands.study import show_table


def bench(
    quick: Annotated[bool, typer.Option("--quick", help="Small pages.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    docs: Annotated[
        Path | None, typer.Option("--docs", help="Write performance.md and its picture into this folder.")
    ] = None,
) -> None:
    """Speed of prediction, comparison and whole pages as ratios to baselines measured in the same run, one core."""
    from prooflight.commissioning.build import build_press
    from prooflight.pages.process import settle_process
    from prooflight.press.press_file import PressFile
    from prooflight_studies.speed.start import start_seconds
    from prooflight_studies.speed.study import bench as timed
    from prooflight_studies.speed.study import bench_pages

    if not json:
        show.step("building the prototype and timing")
    press = build_press(PressFile.prototype(), seed=1)
    settle_process()  # as processes are that inspect page after page; baselines gain by it too
    rows = timed(press, quick=quick)
    if not json:
        starts = start_seconds(press, bench_pages(press, quick=True)["mixed"])
        show.step(f"first verdict {median(starts):.1f} s after the start of a warm installation")
    if docs is not None:
        from prooflight_studies.speed.cores import page_costs
        from prooflight_studies.speed.picture import write_speed_page

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
