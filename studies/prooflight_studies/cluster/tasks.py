"""The work that is shared: a press that is built, designs that are prepared, scans that are inspected."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

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

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from prooflight.pages.parallel import Processes
    from prooflight.press.artefact import Press

LABEL_MM: Final = (36.0, 24.0)
"""Width and height of a label of a personalised job."""
LINES: Final = 3
"""Lines of text that differ from label to label."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Work of one command, in pieces."""

    name: str
    """The command."""
    work: Callable[[Any], Any]
    item: Any
    """What ``work`` is applied to, before time is taken, so that a process has loaded its program and compiled."""
    files: Files[Any]
    pieces: int
    run: Callable[[Processes, Callable[[], None]], str]
    """Does all pieces and returns the SHA-256 of their results; the function that it is given is called after each."""


def build(press: Press, seed: int) -> tuple[Task, dict[str, Press]]:
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


def prepare(press: Press, job: Path, pages: int, folder: Path) -> tuple[Task, PreparedStore]:
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


def inspect(press: Press, job: Path, scans: Path) -> Task:
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
