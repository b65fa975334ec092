"""A job of small pages prepared with and without a cluster, workers killed on the way, and a plant on paper."""

from __future__ import annotations

import hashlib
import json
import os
import resource
import signal
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight import __version__
from prooflight.cluster.connection import connected
from prooflight.errors import InputError
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.prepared_store import PreparedStore
from prooflight.pages.files import write_tiff
from prooflight.pages.parallel import Files
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source
from prooflight.rng import stream
from prooflight_line.run.prepared_designs import PrepareDesign
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

WORKERS: Final = (0, 1, 2, 4)
"""Numbers of workers; 0: without a cluster."""
KILLED_AT: Final = (0.25, 0.5, 0.75)
"""Parts of the job after which a worker is killed."""
PAGE_MM: Final = (36.0, 24.0)
"""Width and height of the pages: a label of a personalised job."""
PEOPLE: Final = 8
"""Lines of text that differ from page to page."""
PRESSES: Final = 100
DESIGNS: Final = 1_000_000
DAY_H: Final = 8.0
"""Time in which a plant's designs are to be prepared: a night."""
SHEETS_PER_S: Final = 5.0
"""Rate of a press, as in the study of records."""
A4_MM2: Final = 210.0 * 297.0
LINK_BYTES_PER_S: Final = 1.25e8
"""Rate of a network of 1 Gbit/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClusterRow:
    """One preparation of the job."""

    workers: int
    killed: int
    """Number of workers that were killed on the way."""
    designs: int
    wall_s: float
    head_s: float
    """Processor time of the head, its scheduler included; without a cluster, of all."""
    worker_s: float
    """Processor time of the workers that lived to the end."""
    design_bytes: float
    digest: str
    """Of all designs in their order."""
    head_mib: tuple[float, ...]
    """Memory of the head after a tenth, a half and all of the job. [MiB]"""


def run_cluster_study(
    artefact: Path,
    out: Path,
    *,
    pages: int,
    stream_pages: int,
    seed: int,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
) -> dict[str, Any]:
    """Prepare jobs of small pages for a press, and write ``cluster.md``.

    artefact: of a trained press that sees the pages. pages: of the job that every number of workers prepares.
    stream_pages: of the job by which the head's memory is judged, with two workers.
    """
    press = Press.load(artefact)
    rows = []
    with tempfile.TemporaryDirectory(prefix="prooflight-cluster-") as folder:
        job = _job(Path(folder) / "job", pages, press, seed)
        for workers in WORKERS:
            progress(f"preparing {pages} pages, {workers or 'no'} workers")
            rows.append(_prepared(job, press, pages, workers))
        progress("killing workers on the way")
        rows.append(_prepared(job, press, pages, 2, kill=True))
        progress(f"preparing {stream_pages} pages")
        long = _job(Path(folder) / "long", stream_pages, press, seed + 1)
        streamed = _prepared(long, press, stream_pages, 2)
    figures = {
        "rows": rows,
        "streamed": streamed,
        "same": len({row.digest for row in rows}) == 1,
        "page_mm": PAGE_MM,
        "plant": _plant(rows, _shipped(out)),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0] / (os.cpu_count() or 1),
        "seed": seed,
        "quick": quick,
        "version": __version__,
    }
    write_page(out / "cluster.md", "cluster", figures)
    return figures


def _job(folder: Path, pages: int, press: Press, seed: int) -> Path:
    """Write small pages that differ in lines of text, as TIFF files in one folder."""
    folder.mkdir()
    dpi = press.dpi
    columns, rows = (round(extent * dpi / MM_PER_INCH) for extent in PAGE_MM)
    stem = max(round(0.4 * dpi / MM_PER_INCH), 1)
    for number in range(1, pages + 1):
        cmyk = np.zeros((rows, columns, 4), np.uint8)
        cmyk[rows // 2 :, :, :3] = (140, 60, 20)
        rng = stream(seed, "cluster-page", number)
        for line in range(PEOPLE):
            bars = np.repeat(rng.random(-(-columns // stem)) < 0.4, stem)[:columns]
            top = (1 + 6 * line) * stem
            cmyk[top : top + 4 * stem, :, 3] = np.where(bars, 255, 0)
        write_tiff(Page(cmyk=cmyk, dpi=dpi, name=f"p{number}", number=number), folder / f"p{number:06d}.tif")
    return folder


def _prepared(job: Path, press: Press, pages: int, workers: int, *, kill: bool = False) -> ClusterRow:
    source = job_source(job, press)
    store = PreparedStore.of(Inspector(press), source)
    if store is None:
        raise InputError(press.name, "is not trained", remedy="build it with `press build --detector quick`")
    work, numbers = PrepareDesign(source=source, store=store), range(1, pages + 1)
    if not workers:
        return _measured(enumerate(map(work, numbers)), pages, 0, lambda: 0.0, lambda: None)
    with connected(f"local:{workers}") as cluster:
        for _ in cluster.in_order(work, [1] * workers, files=Files(of_work=source.files)):
            pass  # every worker has loaded its libraries, kernels and the press
        seconds = cluster.client.run(time.process_time)

        def spent() -> float:
            now = cluster.client.run(time.process_time)
            return float(sum(value - seconds.get(worker, 0.0) for worker, value in now.items()))

        def kill_one() -> None:
            with suppress(ProcessLookupError):
                os.kill(next(iter(cluster.client.run(os.getpid).values())), signal.SIGKILL)

        results = cluster.as_finished(work, numbers, files=Files(of_work=source.files))
        return _measured(results, pages, workers, spent, kill_one if kill else None)


def _measured(
    results: Iterator[tuple[int, bytes]],
    pages: int,
    workers: int,
    spent: Callable[[], float],
    kill: Callable[[], None] | None,
) -> ClusterRow:
    digests: dict[int, bytes] = {}
    size, killed, memory = 0, 0, []
    marks, deaths = _places(pages, (0.1, 0.5, 1.0)), _places(pages, KILLED_AT)
    wall_s, head_s = time.perf_counter(), time.process_time()
    for done, (place, content) in enumerate(results, start=1):
        digests[place] = hashlib.sha256(content).digest()
        size += len(content)
        if done in marks:
            memory.append(_resident_mib())
        if workers and kill is not None and done in deaths:
            kill()
            killed += 1
    head_s, wall_s = time.process_time() - head_s, time.perf_counter() - wall_s
    return ClusterRow(
        workers=workers,
        killed=killed,
        designs=len(digests),
        wall_s=wall_s,
        head_s=head_s,
        worker_s=spent(),
        design_bytes=size / pages,
        digest=hashlib.sha256(b"".join(digests[place] for place in sorted(digests))).hexdigest(),
        head_mib=tuple(memory),
    )


def _places(pages: int, parts: Sequence[float]) -> set[int]:
    return {max(round(part * pages), 1) for part in parts}


def _resident_mib() -> float:
    """Return the memory of this process. [MiB]"""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * resource.getpagesize() / 2**20
    except OSError:  # not Linux: its greatest so far
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def _shipped(out: Path) -> dict[str, float]:
    """Return the rates of rows that the study of records measured; InputError: it has not been run."""
    path = out / "records.json"
    try:
        records = json.loads(path.read_text(encoding="utf-8"))
        shipping, search = records["shipping"], records["search"]
        return {
            "shipped_rows_per_s": shipping["presses"] * shipping["sheets_per_s"],
            "filled_rows_per_s": search["sheets"] / search["fill_s"],
            "row_bytes": search["bytes"] / search["sheets"],
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            path, "has no rates of rows", remedy="run `prooflight study records` first"
        ) from error


def _plant(rows: Sequence[ClusterRow], shipped: dict[str, float]) -> dict[str, Any]:
    """Return what 100 presses and a million designs of A4 need; processor time and bytes grow with the area."""
    one = next(row for row in rows if row.workers == 0)
    most = max((row for row in rows if not row.killed), key=lambda row: row.workers)
    area = A4_MM2 / (PAGE_MM[0] * PAGE_MM[1])
    design_s, design_bytes = area * one.head_s / one.designs, area * one.design_bytes
    head_s = most.head_s / most.designs
    night_s = DAY_H * 3600
    return {
        **shipped,
        "presses": PRESSES,
        "designs": DESIGNS,
        "night_h": DAY_H,
        "area": area,
        "design_s": design_s,
        "design_bytes": design_bytes,
        "processors": DESIGNS * design_s / night_s,
        "disk_bytes": DESIGNS * design_bytes,
        "bytes_per_s": DESIGNS * design_bytes / night_s,
        "links": DESIGNS * design_bytes / night_s / LINK_BYTES_PER_S,
        "head_ms": 1000 * head_s,
        "head_share": DESIGNS * head_s / night_s,
        "rows_per_s": PRESSES * SHEETS_PER_S,
        "row_bytes_a_day": PRESSES * SHEETS_PER_S * night_s * shipped["row_bytes"],
    }
