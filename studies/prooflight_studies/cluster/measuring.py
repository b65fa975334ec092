"""Processor time of head and workers while they do a task, and workers that are killed on the way."""

from __future__ import annotations

import os
import resource
import signal
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from prooflight.pages.parallel import in_order

if TYPE_CHECKING:
    from collections.abc import Iterable

    from prooflight.cluster.cluster import Cluster
    from prooflight_studies.cluster.tasks import Task

KILLED_AT: Final = (0.5,)
"""Parts of a task after which a worker is killed."""
MEMORY_AT: Final = (0.1, 0.5, 1.0)
"""Parts of a task after which the head's memory is noted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """A task that was done once."""

    task: str
    workers: int
    """Number of workers; 0: without a cluster."""
    killed: int
    """Number of workers that were killed on the way."""
    pieces: int
    wall_s: float
    head_s: float
    """Processor time of the head, its scheduler included; without a cluster, of all."""
    worker_s: float | None
    """Processor time of all workers, from the first piece on; None: some of them were killed, with their counts."""
    before_s: float
    """Processor time of a worker until then: for the first task of a cluster, of its start."""
    digest: str
    """SHA-256 of all results."""
    head_mib: tuple[float, ...]
    """Memory of the head after ``MEMORY_AT``. [MiB]"""


def done(task: Task, cluster: Cluster | None = None, *, kill: bool = False) -> Done:
    """Do a task by the workers of a cluster, or here; kill: with workers that are killed after ``KILLED_AT``.

    Every process has done a piece before, so that the time contains no start.
    """
    marks, deaths = _places(task.pieces, MEMORY_AT), _places(task.pieces, KILLED_AT if kill else ())
    number = 0 if cluster is None else len(cluster.client.nthreads())
    for _ in in_order(task.work, [task.item] * max(number, 1), processes=cluster or 1, files=task.files):
        pass
    before = _worker_seconds(cluster)
    pieces, killed, memory = 0, 0, list[float]()

    def ended() -> None:
        nonlocal pieces, killed
        pieces += 1
        if pieces in marks:
            memory.append(_resident_mib())
        if cluster is not None and pieces in deaths:
            with suppress(ProcessLookupError):
                os.kill(next(iter(cluster.client.run(os.getpid).values())), signal.SIGKILL)
                killed += 1

    wall_s, head_s = time.perf_counter(), time.process_time()
    digest = task.run(cluster or 1, ended)
    head_s, wall_s = time.process_time() - head_s, time.perf_counter() - wall_s
    after = _worker_seconds(cluster)
    return Done(
        task=task.name,
        workers=number,
        killed=killed,
        pieces=pieces,
        wall_s=wall_s,
        head_s=head_s,
        worker_s=None if killed else sum(after.values()) - sum(before.values()),
        before_s=sum(before.values()) / max(number, 1),
        digest=digest,
        head_mib=tuple(memory),
    )


def _worker_seconds(cluster: Cluster | None) -> dict[str, float]:
    """Return the processor time of each worker since it began. [s]"""
    return {} if cluster is None else dict(cluster.client.run(time.process_time))


def _places(pieces: int, parts: Iterable[float]) -> set[int]:
    return {max(round(part * pieces), 1) for part in parts}


def _resident_mib() -> float:
    """Return the memory of this process. [MiB]"""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * resource.getpagesize() / 2**20
    except OSError:  # not Linux: the greatest so far
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
