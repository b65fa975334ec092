"""Memory traffic of a page, counted, and the calculated throughput of many cores."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.kernels.compiled import Kernel
from prooflight_studies.speed.compare import in_turns
from prooflight_studies.speed.detector import detector_works
from prooflight_studies.speed.study import REPEATS, bench_pages

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from prooflight.press.artefact import Press

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
