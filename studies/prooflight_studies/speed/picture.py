"""Page and picture of the speeds of one run: ``docs/performance.md``."""

from __future__ import annotations

import os
import platform
import time
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from llvmlite import binding  # type: ignore[import-untyped]
from matplotlib.figure import Figure

from prooflight.kernels.compiled import Kernel
from prooflight_studies.harness.page import write_page
from prooflight_studies.harness.picture import write_figure
from prooflight_studies.speed.card import add_card_section
from prooflight_studies.speed.compare import in_turns
from prooflight_studies.speed.study import REPEATS, bench_pages, detector_works

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from prooflight.press.artefact import Press
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


# --- memory traffic of a page, counted, and the calculated throughput of many cores ---

LEAST_BYTES: Final = 2**21 + 1
"""Least size of an array that comes from memory; assumed: a smaller one (a table, a row, a patch) stays in cache."""
WORKS: Final = {
    "first look": "matched filter: whole, first look, mixed",
    "both looks": "matched filter: whole, both looks, mixed",
    "first look, fresh design": "matched filter: whole, first look, fresh design, mixed",
}
CORES: Final = (1, 2, 4, 8, 16, 32, 64)
MEMORIES: Final = {
    "2 channels of DDR4-3200": 51.2,
    "8 channels of DDR4-3200": 204.8,
    "12 channels of DDR5-4800": 460.8,
}
"""Memory bandwidth: channels x 8 bytes x transfers a second (JEDEC). [GB/s]"""
REACHED: Final = 0.8
"""Share of the bandwidth that reading reaches. (assumed: as STREAM shows for such machines)"""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageCost:
    """Cost of one page of one sensor."""

    work: str
    cpu_s: float
    gigabytes: float
    """Data passed to compiled loops in arrays larger than a core's cache, each counted once a call."""
    pages_per_s: Mapping[str, tuple[float, ...]]
    """Throughput by memory, for each of ``CORES``: the limit of the cores or of the memory, whichever is lower."""


def page_costs(press: Press, *, quick: bool = False) -> list[PageCost]:
    """Return the costs of a mixed page, with one thread."""
    works = detector_works("mixed", bench_pages(press, quick=quick)["mixed"], press)
    selected = {name: works[of][0] for name, of in WORKS.items()}
    times = in_turns(selected, REPEATS, clock=time.process_time)
    costs = []
    for name, work in selected.items():
        with counted() as moved:
            work()
        costs.append(page_cost(name, cpu_s=float(np.median(times[name])), moved_bytes=moved[0]))
    return costs


def page_cost(work: str, *, cpu_s: float, moved_bytes: int) -> PageCost:
    """Compute the throughput from the measured time and memory traffic."""
    gigabytes = moved_bytes / 1e9
    return PageCost(
        work=work,
        cpu_s=round(cpu_s, 3),
        gigabytes=round(gigabytes, 2),
        pages_per_s={
            memory: tuple(
                round(min(cores / cpu_s, REACHED * gb_per_s / max(gigabytes, 1e-9)), 1) for cores in CORES
            )
            for memory, gb_per_s in MEMORIES.items()
        },
    )


@contextmanager
def counted() -> Iterator[list[int]]:
    """Count the bytes that are passed to compiled loops within the context, in the one element of a list."""
    plain, moved = Kernel.__call__, [0]

    def call(kernel: Kernel, *arguments: Any, **named: Any) -> Any:
        moved[0] += sum(map(_bytes_of, (*arguments, *named.values())))
        return plain(kernel, *arguments, **named)

    Kernel.__call__ = call  # type: ignore[method-assign, assignment]
    try:
        yield moved
    finally:
        Kernel.__call__ = plain  # type: ignore[method-assign]


def _bytes_of(argument: Any) -> int:
    if isinstance(argument, np.ndarray):
        return argument.nbytes if argument.nbytes >= LEAST_BYTES else 0
    return sum(map(_bytes_of, argument)) if isinstance(argument, tuple) else 0
