"""``docs/performance.md``: the speeds of one run in a table and a picture."""

from __future__ import annotations

import os
import platform
from typing import TYPE_CHECKING, Final

import matplotlib as mpl

mpl.use("Agg")
from llvmlite import binding  # type: ignore[import-untyped]
from matplotlib import pyplot as plt

from prooflight.files.atomic import whole_file

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from prooflight_studies.speed.study import SpeedRow

PICTURE: Final = "performance.png"
VECTORS: Final = ("avx512bw", "avx2", "sse4.2", "neon")


def machine() -> str:
    """Cores and vector instructions, without names."""
    features = binding.get_host_cpu_features()
    vectors = next((name for name in VECTORS if features.get(name)), "no vector instructions known")
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return f"{os.cpu_count()} cores, {platform.machine()}, {vectors}{load}"


def write_speed_page(rows: Sequence[SpeedRow], folder: Path) -> None:
    """Write ``performance.md`` and its picture into ``folder``."""
    lines = [
        "# Performance",
        "",
        "Written by `prooflight bench`; do not edit. Megapixels a second of one core's processor time, median and",
        "range of interleaved repeats in one run: of the raster in look-ups, of the camera elsewhere.",
        "",
        f"Machine: {machine()}. Others may have been at work on it: compare ratios.",
        "",
        "How much faster is the first row of its group, ours, than this one; in the groups of growth and by the wall,",
        "how fast this row is beside the first.",
        "",
        f"![speeds](images/{PICTURE})",
        "",
        "| step | Mpx/s | range | ratio |",
        "|---|---:|---:|---:|",
    ]
    lines += [
        f"| {row.name} | {row.mpx_per_cpu_s:,.1f} | {row.lowest_mpx_per_cpu_s:,.1f} .. "
        f"{row.highest_mpx_per_cpu_s:,.1f} | {row.ratio:.2f} |"
        for row in rows
    ]
    with whole_file(folder / "performance.md") as unfinished:
        unfinished.write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "images").mkdir(exist_ok=True)
    with whole_file(folder / "images" / PICTURE) as unfinished:
        _draw(rows, unfinished)


def _draw(rows: Sequence[SpeedRow], path: Path) -> None:
    """Bars on a logarithmic axis: photo pages beside baselines, then growth."""
    kept = [row for row in rows if row.name.endswith(", photo")]
    grown = [row for row in rows if row.name.startswith("growth")]
    figure, axes = plt.subplots(
        2, 1, figsize=(8, 7.5), height_ratios=[len(kept), max(len(grown), 1)], layout="constrained"
    )
    for axis, part, title in (
        (axes[0], kept, "A photo page, one core"),
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
    figure.savefig(path, dpi=110, format="png")
    plt.close(figure)
