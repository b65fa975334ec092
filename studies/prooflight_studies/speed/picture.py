"""Page and picture of the speeds of one run: ``docs/performance.md``."""

from __future__ import annotations

import os
import platform
from typing import TYPE_CHECKING, Final

from llvmlite import binding  # type: ignore[import-untyped]
from matplotlib.figure import Figure

from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.picture import write_figure
from prooflight_studies.speed.card_section import add_card_section
from prooflight_studies.speed.cores import CORES, REACHED

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from prooflight_studies.speed.cores import PageCost
    from prooflight_studies.speed.study import SpeedRow

PICTURE: Final = "performance.png"
VECTORS: Final = ("avx512bw", "avx2", "sse4.2", "neon")


def machine() -> str:
    """Return cores and vector instructions, without names."""
    features = binding.get_host_cpu_features()
    vectors = next((name for name in VECTORS if features.get(name)), "no vector instructions known")
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return f"{os.cpu_count()} cores, {platform.machine()}, {vectors}{load}"


def write_speed_page(rows: Sequence[SpeedRow], costs: Sequence[PageCost], folder: Path) -> None:
    """Write ``performance.md``, its figures as JSON and its picture into ``folder``."""
    results = {
        "machine": machine(),
        "picture": PICTURE,
        "rows": rows,
        "cores": CORES,
        "reached": REACHED,
        "costs": costs,
    }
    write_page(folder / "performance.md", "speed", results)
    add_card_section(folder)
    (folder / "images").mkdir(exist_ok=True)
    write_figure(_drawn(rows), folder / "images" / PICTURE)


def _drawn(rows: Sequence[SpeedRow]) -> Figure:
    """Draw bars on a logarithmic axis: photo pages with their baselines, then growth."""
    photos = [row for row in rows if row.name.endswith(", photo")]
    grown = [row for row in rows if row.name.startswith("growth")]
    figure = Figure(figsize=(8, 7.5), dpi=110, layout="constrained")
    axes = figure.subplots(2, 1, height_ratios=[len(photos), max(len(grown), 1)])
    for axis, part, title in (
        (axes[0], photos, "A photo page, one core"),
        (axes[1], grown, "Prediction of a mixed page as things grow, one core"),
    ):
        names = [row.name.removesuffix(", photo").removeprefix("growth: ") for row in part]
        speeds = [row.mpx_per_cpu_s for row in part]
        bars = axis.barh(names, speeds, color="#3b6ea5")
        axis.bar_label(bars, [f"{speed:,.0f}" for speed in speeds], padding=3)
        axis.invert_yaxis()
        axis.set_title(title, loc="left")
        axis.spines[["top", "right"]].set_visible(False)
        axis.margins(x=0.12)
    axes[0].set_xscale("log")
    axes[1].set_xlabel("megapixels a second of processor time")
    return figure
