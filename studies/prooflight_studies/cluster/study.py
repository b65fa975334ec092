"""Press, designs and verdicts without a cluster and on 1, 2 and 4 workers, some of them killed; writes cluster.md."""

from __future__ import annotations

import hashlib
import os
import resource
import signal
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from prooflight import __version__
from prooflight.cluster.connection import connected
from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.simulated_days import DESIGNS_A_DAY, ScatterWork, fitted
from prooflight.commissioning.training.train import FEWEST, Plan, trained
from prooflight.errors import InputError
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.job import InspectPage, paired
from prooflight.inspection.prepared_store import HEAD_BYTES, PreparedStore
from prooflight.pages.files import write_tiff
from prooflight.pages.parallel import NO_FILES, Files, in_order
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.press.pages import job_source
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.files import ScanToFile
from prooflight_line.run.sheet_inspector import PrepareDesign
from prooflight_studies.cluster.plant import DESIGNS, PRESSES, Measured, needs, processors, shipped_rows_per_s
from prooflight_studies.harness.page import write_page
from prooflight_studies.paper.study import REDUCED_PITCH_MM, at_pitch

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from prooflight.cluster.cluster import Cluster
    from prooflight.pages.parallel import Processes
    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile

SPECIMEN_SEED: Final = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ClusterPlan:
    """Numbers of pages."""

    seed: int
    pages: int = 12
    """Pages that are prepared and inspected in all ways."""
    labels: int = 2000
    """Small pages by which the memory of the head is judged."""
    full: int = 6
    """Pages at the press's own resolution, by which a plant is computed."""
    quick: bool = False

    @classmethod
    def quickly(cls, seed: int) -> Self:
        """Return a size that is enough to see that all of it works."""
        return cls(seed=seed, pages=4, labels=40, full=2, quick=True)


def run_cluster_study(
    press_file: PressFile,
    out: Path,
    *,
    plan: ClusterPlan,
    progress: Callable[[str], None] = lambda _step: None,
) -> dict[str, Any]:
    """Share the work of three commands in all ways, and write ``cluster.md``.

    press_file: of the press that is built, prints and inspects. InputError: ``out`` has no results of the study of
    records.
    """
    rows_per_s = shipped_rows_per_s(out)
    bare = build_press(at_pitch(press_file, REDUCED_PITCH_MM), seed=SPECIMEN_SEED)
    with tempfile.TemporaryDirectory(prefix="prooflight-cluster-") as place:
        folder = Path(place)
        build, latest = build_task(bare, plan.seed)
        progress(f"{build.name}, without a cluster")
        rows = [done(build)]
        press = latest["press"]
        progress("writing and printing pages")
        job = write_designs(folder / "job", press, plan.pages, plan.seed)
        scans = write_scans(folder / "scans", press, job, plan.pages, plan.seed)
        labels = write_labels(folder / "labels", press, plan.labels, plan.seed)
        full = replace(build_press(press_file, seed=SPECIMEN_SEED), detectors=press.detectors)
        full_job = write_designs(folder / "full", full, plan.full, plan.seed)
        prepare, _ = prepare_task(press, job, plan.pages, folder / "prepared")
        inspect = inspect_task(press, job, scans)
        prepare_labels, label_store = prepare_task(press, labels, plan.labels, folder / "prepared")
        prepare_full, full_store = prepare_task(full, full_job, plan.full, folder / "prepared")
        for task in (prepare, inspect):
            progress(f"{task.name}, without a cluster")
            rows.append(done(task))
        every = (prepare, inspect, build)
        *of_two, streamed, of_full = _shared((*every, prepare_labels, prepare_full), 2, progress=progress)
        rows += _shared(every[:2], 1, progress=progress)
        rows += of_two
        rows += _shared(every[:2], 4, progress=progress)
        rows += _shared(every, 2, kill=True, progress=progress)
        one = Measured(
            design_s=(of_full.worker_s or 0.0) / plan.full,
            head_s=of_full.head_s / plan.full,
            design_bytes=sum(file.stat().st_size for file in full_store.folder.iterdir()) / plan.full,
            head_bytes=streamed.head_mib[-1] * 2**20,
            growth_bytes=max(streamed.head_mib[-1] - streamed.head_mib[1], 0) * 2**20 / (plan.labels / 2),
            search_s=_search_s(label_store, plan.labels),
            shipped_rows_per_s=rows_per_s,
        )
    figures = {
        "rows": [asdict(row) | {"efficiency": _efficiency(row, rows)} for row in rows],
        "same": {
            task.name: len({row.digest for row in rows if row.task == task.name}) == 1 for task in every
        },
        "streamed": streamed,
        "measured": one,
        "full": plan.full,
        "needs": [asdict(need) | {"share": need.share} for need in needs(one)],
        "processors": processors(one),
        "presses": PRESSES,
        "designs": DESIGNS,
        "label_mm": LABEL_MM,
        "pitch_mm": REDUCED_PITCH_MM,
        "press": press_file.name,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0] / (os.cpu_count() or 1),
        "seed": plan.seed,
        "quick": plan.quick,
        "version": __version__,
    }
    write_page(out / "cluster.md", "cluster", figures)
    return figures


def _shared(
    every: Sequence[Task], workers: int, *, kill: bool = False, progress: Callable[[str], None]
) -> list[Done]:
    """Do all tasks by so many workers."""
    rows = []
    with connected(f"local:{workers}") as cluster:
        for task in every:
            killed = ", some of them killed" if kill else ""
            progress(f"{task.name}, {task.pieces} pieces, {workers} workers{killed}")
            cluster.client.wait_for_workers(workers)  # those that were killed have come back
            rows.append(done(task, cluster, kill=kill))
    return rows


def _efficiency(row: Done, rows: Sequence[Done]) -> float | None:
    """Return the processor time without a cluster by that of head and workers; None: it is not known."""
    without = next(one for one in rows if one.task == row.task and not one.workers)
    return None if row.worker_s is None else without.head_s / (row.head_s + row.worker_s)


def _search_s(store: PreparedStore, pages: int) -> float:
    """Return the time of looking for one design among those that are stored, as `job prepare` does at its start."""
    began = time.perf_counter()
    for number in range(1, pages + 1):
        assert store.holds(number)
    return (time.perf_counter() - began) / pages


# --- processor time of head and workers during a task, with workers that are killed on the way ---

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


# --- the tasks: build, prepare, inspect ---

LABEL_MM: Final = (36.0, 24.0)
"""Width and height of a label of a personalised job."""
LINES: Final = 3
"""Lines of text that differ from label to label."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Work of one command, in pieces."""

    name: str
    work: Callable[[Any], Any]
    item: Any
    """What ``work`` is applied to, before time is taken, so that a process has loaded its program and compiled."""
    files: Files[Any]
    pieces: int
    run: Callable[[Processes, Callable[[], None]], str]
    """Does all pieces and returns the SHA-256 of their results; the function that it is given is called after each."""


def build_task(press: Press, seed: int) -> tuple[Task, dict[str, Press]]:
    """Return the training of a press on the fewest designs, and the place of the press that it trained last."""
    latest: dict[str, Press] = {}
    plan = Plan.of(FEWEST)

    def run(processes: Processes, ended: Callable[[], None]) -> str:
        def shown(days: Iterable[Any], _total: int, _what: str) -> Iterator[Any]:
            for day in days:
                ended()
                yield day

        corpus = Corpus(seed=seed, dpi=press.dpi)
        latest["press"] = trained(press, corpus, designs=FEWEST, seed=seed, processes=processes, shown=shown)
        return latest["press"].digest

    pieces = sum(-(-len(part) // DESIGNS_A_DAY) for part in (plan.pilot, plan.calibrate))
    first = ScatterWork(press=press, pages=Corpus(seed=seed, dpi=press.dpi), seed=seed)
    task = Task(name="press build", work=first, item=(0,), files=NO_FILES, pieces=pieces, run=run)
    return task, latest


def prepare_task(press: Press, job: Path, pages: int, folder: Path) -> tuple[Task, PreparedStore]:
    """Return the preparation of a job's pages, which are stored in ``folder``, and their store.

    InputError: nothing can be stored for this press.
    """
    source = job_source(job, press)
    store = PreparedStore.of(Inspector(press), source, folder=folder)
    if store is None:
        remedy = "give a press file without a RIP of its own"
        raise InputError(press.name, "cannot store prepared designs", remedy=remedy)
    work, numbers = PrepareDesign(source=source, store=store), range(1, pages + 1)
    files: Files[int] = Files(of_work=source.files)

    def run(processes: Processes, ended: Callable[[], None]) -> str:
        if processes is None or isinstance(processes, int):
            done: Iterator[tuple[int, bytes]] = enumerate(in_order(work, numbers, processes=1))
        else:
            done = processes.as_finished(work, numbers, files=files)
        heads: dict[int, bytes] = {}
        for place, content in done:
            store.put(numbers[place], content)
            heads[place] = content[:HEAD_BYTES]  # with the SHA-256 of the rest, which ``put`` has checked
            ended()
        return _digest(heads[place] for place in range(pages))

    return Task(name="job prepare", work=work, item=1, files=files, pieces=pages, run=run), store


def inspect_task(press: Press, job: Path, scans: Path) -> Task:
    """Return the inspection of a job's scans."""
    source = job_source(job, press)
    with source.open() as opened:
        pairs = paired(opened, scans, sensors=len(press.sensors))
    work = InspectPage(job=source, inspector=Inspector(press), scans=scans)

    def run(processes: Processes, ended: Callable[[], None]) -> str:
        verdicts = []
        for judged in in_order(work, pairs, processes=processes, files=work.files):
            timeless = replace(judged.verdict, milliseconds=0.0)
            verdicts.append(repr(timeless).encode())  # every figure to its last digit
            ended()
        return _digest(verdicts)

    return Task(name="inspect", work=work, item=pairs[0], files=work.files, pieces=len(pairs), run=run)


def write_designs(folder: Path, press: Press, pages: int, seed: int) -> Path:
    """Write page designs, most of them A4, as a job; return its folder."""
    corpus = Corpus(seed=seed, dpi=press.dpi)
    return _written(folder, (fitted(corpus.page(index), press.geometry) for index in range(pages)))


def write_labels(folder: Path, press: Press, pages: int, seed: int) -> Path:
    """Write labels that differ in lines of text as a job; return its folder."""
    columns, rows = (round(extent * press.dpi / MM_PER_INCH) for extent in LABEL_MM)
    stem = max(round(0.4 * press.dpi / MM_PER_INCH), 1)

    def labels() -> Iterator[Page]:
        for number in range(1, pages + 1):
            cmyk = np.zeros((rows, columns, 4), np.uint8)
            cmyk[rows // 2 :, :, :3] = (140, 60, 20)
            rng = stream(seed, "cluster-page", number)
            for line in range(LINES):
                bars = np.repeat(rng.random(-(-columns // stem)) < 0.4, stem)[:columns]
                top = (1 + 6 * line) * stem
                cmyk[top : top + 4 * stem, :, 3] = np.where(bars, 255, 0)
            yield Page(cmyk=cmyk, dpi=press.dpi, name=f"p{number}", number=number)

    return _written(folder, labels())


def write_scans(folder: Path, press: Press, job: Path, pages: int, seed: int) -> Path:
    """Print and scan a job's pages on the simulated press; return the folder of the scans."""
    folder.mkdir()
    work = ScanToFile(
        job=job_source(job, press),
        press=press,
        out=folder,
        request=None,
        seed=seed,
        job_pages=pages,
        world="press",
    )
    for number in range(1, pages + 1):
        work(number)
    return folder


def _written(folder: Path, pages: Iterable[Page]) -> Path:
    folder.mkdir()
    for number, page in enumerate(pages, start=1):
        write_tiff(page, folder / f"p{number:06d}.tif")
    return folder


def _digest(contents: Iterable[bytes]) -> str:
    """Return the SHA-256 of results, each of which is digested first."""
    whole = hashlib.sha256()
    for content in contents:
        whole.update(hashlib.sha256(content).digest())
    return whole.hexdigest()
