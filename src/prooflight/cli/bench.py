"""``prooflight bench``: speed beside peers, in one run."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from prooflight.cli import show


def bench(
    quick: Annotated[bool, typer.Option("--quick", help="Small pages.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Speed of prediction and comparison as ratios to peers measured in the same run, one core."""
    from prooflight.commissioning.build import build_press
    from prooflight.press_file import PressFile
    from prooflight.studies.speed import bench as timed

    if not json:
        show.step("building the prototype and timing")
    rows = timed(build_press(PressFile.prototype(), seed=1), quick=quick)
    if json:
        show.print_json(rows)
        return
    table = Table(title="Camera megapixels a second of processor time, one core", title_justify="left")
    table.add_column("step")
    table.add_column("Mpx/s", justify="right")
    table.add_column("ratio to its peer", justify="right")
    for row in rows:
        table.add_row(row.name, f"{row.mpx_per_cpu_s:,.1f}", f"{row.ratio:.2f}")
    show.people.print(table)
