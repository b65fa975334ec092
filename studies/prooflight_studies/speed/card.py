"""A graphics card beside the processor: equal verdicts, time of a sheet on the card, and whole inspections a second."""

from __future__ import annotations

import itertools
import json
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from statistics import median
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.base import StoredArrays
from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.card.designs import Designs
from prooflight.detectors.matched_filter.card.images import engine_on
from prooflight.detectors.matched_filter.detector import MatchedFilterDetector, MatchedFilterPage
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES
from prooflight.errors import RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.kernels.gpu.runners import Card, Pool, launched
from prooflight.pages.parallel import in_order
from prooflight.pages.process import settle_process
from prooflight.press.pages import open_job
from prooflight.rng import stream
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight.simulation.session import session_of
from prooflight_line.run.inspection_workers import THREADS_A_WORKER, InspectionWorkers, worker_count
from prooflight_line.run.sheet_inspector import SheetInspector
from prooflight_studies.harness.page import plain

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.inspection.inspector import Prepared
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.session import Session

REPEATS: Final = 20
IN_FLIGHT: Final = (1, 2, 4, 8)
"""Sheets on the card at once."""
TIMED_PAGES: Final = 8
"""First pages of the job, of which one good print each is timed."""
OFF_QUANTILES: Final = (0.5, 0.95, 0.99, 1.0)
FARTHEST: Final = 10
SECONDS: Final = 5.0
"""Time for which whole inspections are counted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CardFigures:
    """What a card did, with its name and driver."""

    card: str
    numba_cuda: str
    host_cores: int
    threshold: float
    camera_mpx: float
    """Camera pixels of a sheet, all sensors together. [Mpx]"""
    compiled_s: float
    """Time of the first analysis, which compiles."""
    pages: int
    prints: int
    """Number of prints that were judged by both."""
    misprints: int
    """Number of these prints that were misprinted."""
    score_off: tuple[float, ...]
    """``OFF_QUANTILES`` of the difference of the two scores of a print."""
    differing: tuple[Compared, ...]
    """Prints whose verdicts differ."""
    other_kinds: int
    """Misprints to both whose kinds differ."""
    farthest: tuple[Compared, ...]
    """Prints whose scores differ most."""
    sheet_ms: float
    """Median time from a scan in pinned memory to its sums on the card."""
    upload_ms: float
    in_flight: dict[int, float]
    """Sheets a second on the card, by sheets on it at once."""
    gpu_per_s: dict[int, float]
    """Whole inspections a second by number of worker processes, images on the card."""
    cpu_per_s: dict[int, float]
    """Whole inspections a second by number of worker processes, all on the processor."""
    gpu_cpu_s: float
    """Processor time of an inspection with images on the card."""
    cpu_cpu_s: float
    """Processor time of an inspection without the card."""


class RecordedCard(Card):
    """A card that can repeat the steps of its last scan."""

    def __init__(self) -> None:
        super().__init__()
        self.steps: list[Hashable] = []

    def step(self, key: Hashable, launches: Callable[[], None]) -> None:
        """See ``Card``."""
        super().step(key, launches)
        self.steps.append(key)

    def upload(self, scan: NDArray[np.uint16]) -> None:
        """Send the scan that lies in pinned memory."""
        room = self.room("scan", scan.shape, scan.dtype)
        room.copy_to_device(self.pinned(room), stream=self.stream)

    def again(self) -> None:
        """Launch all steps of the last scan, one after the other; returns before they are done."""
        for key in self.steps:
            launched(self.graphs[key], self.stream)


def card_figures(
    job: Path,
    press: Press,
    *,
    seed: int,
    prints: int,
    say: Callable[[str], None] = lambda _: None,
) -> CardFigures:
    """Measure a card on ``prints`` of a job's pages; RequestError: there is no card."""
    settle_process()  # as processes are that inspect page after page
    inspector = Inspector.of(press, "matched_filter").with_threads(1)
    card, cores = inspector.on("gpu"), os.cpu_count() or 1
    with open_job(job, press) as opened:
        count = len(opened)
        pages = [press.geometry.lay(opened.page(number)) for number in range(1, min(count, TIMED_PAGES) + 1)]
    say("preparing designs and printing")
    inspector.prepare(pages[0])  # compiles
    with ThreadPoolExecutor(cores) as crew:
        designs = list(crew.map(inspector.prepare, pages))
    session = session_of(press, seed)
    scans = [
        _good_print(page, press, session, stream(seed, "card-print", turn, 0))
        for turn, page in enumerate(pages)
    ]
    on_card = [with_inspector(prepared, card) for prepared in designs]
    inspector.inspect(designs[0], scans[0])
    started = time.perf_counter()
    card.inspect(on_card[0], scans[0])
    compiled_s = time.perf_counter() - started
    say(f"first inspection on the card after {compiled_s:.1f} s")
    sheet_ms, upload_ms, in_flight = _card_alone(designs[0], scans[0], say)
    gpu_cpu_s, cpu_cpu_s = (
        _cpu_seconds(one, of_it, scans) for one, of_it in ((card, on_card), (inspector, designs))
    )
    compared = judged_by_both(job, press, pages=count, prints=prints, seed=seed, processes=cores, say=say)
    say("timing whole inspections")
    gpu, cpu = (_rates(one, pages, scans, cores=cores, say=say) for one in (card, inspector))
    return CardFigures(
        card=card.engine,
        numba_cuda=version("numba-cuda"),
        host_cores=cores,
        threshold=_threshold(press),
        camera_mpx=scans[0].size / 1e6,
        compiled_s=compiled_s,
        pages=count,
        prints=len(compared),
        misprints=sum(bool(one.misprint) for one in compared),
        score_off=tuple(
            float(one) for one in np.quantile([one.score_off for one in compared], OFF_QUANTILES)
        ),
        differing=tuple(one for one in compared if one.differs),
        other_kinds=sum(one.cpu != one.gpu and not one.differs for one in compared),
        farthest=tuple(sorted(compared, key=lambda one: -one.score_off)[:FARTHEST]),
        sheet_ms=sheet_ms,
        upload_ms=upload_ms,
        in_flight=in_flight,
        gpu_per_s=gpu,
        cpu_per_s=cpu,
        gpu_cpu_s=gpu_cpu_s,
        cpu_cpu_s=cpu_cpu_s,
    )


def _good_print(
    page: Page, press: Press, session: Session | None, rng: np.random.Generator
) -> NDArray[np.uint16]:
    printed = scan_page(page, press=press, request=None, others=(), fetch=_no_page, rng=rng, session=session)
    return np.ascontiguousarray(printed.dn)


def _no_page(number: int) -> Page:
    raise IndexError(number)


def _threshold(press: Press) -> float:
    return model_of(press).threshold


def _card_alone(
    prepared: Prepared, scan: NDArray[np.uint16], say: Callable[[str], None]
) -> tuple[float, float, dict[int, float]]:
    """Return the time of a sheet on the card and of its upload [ms], and sheets a second by sheets in flight."""
    detector_page: Any = prepared.prepared_page
    designs, cards = Designs(), [RecordedCard() for _ in range(max(IN_FLIGHT))]

    def analysed(card: RecordedCard) -> None:
        card.steps.clear()
        engine = engine_on(Pool(lambda: card), designs)
        variance = detector_page.detector.calibrated.model.residual_variance
        analyse(
            detector_page.prepared_page,
            scan,
            residual_variance=variance,
            analysed_modes=SCREEN_MODES,
            engine=engine,
        )

    for card in cards:
        for _ in range(2):  # launched one by one, then recorded
            analysed(card)
        card.steps = [key for key in card.steps if key in card.graphs]
    first = cards[0]
    times = []
    for whole in (True, False):
        took = []
        for _ in range(REPEATS):
            first.stream.synchronize()
            begin = time.perf_counter()
            first.upload(scan)
            if whole:
                first.again()
            first.stream.synchronize()
            took.append(1e3 * (time.perf_counter() - begin))
        times.append(median(took))
    rates = {}
    for count in IN_FLIGHT:
        begin, done = time.perf_counter(), 0
        while time.perf_counter() - begin < 1.0:
            card = cards[done % count]
            card.stream.synchronize()
            card.upload(scan)
            card.again()
            done += 1
        for card in cards[:count]:
            card.stream.synchronize()
        rates[count] = done / (time.perf_counter() - begin)
        say(f"{count} in flight: {rates[count]:.0f} sheets a second")
    return times[0], times[1], rates


def _cpu_seconds(
    inspector: Inspector, designs: Sequence[Prepared], scans: Sequence[NDArray[np.uint16]]
) -> float:
    """Return the processor time of one inspection, one after the other. [s]"""
    for turn in range(2 * len(scans)):  # steps on a card are recorded the second time
        inspector.inspect(designs[turn % len(scans)], scans[turn % len(scans)])
    end, spent, done = time.perf_counter() + SECONDS, time.process_time(), 0
    while time.perf_counter() < end:
        inspector.inspect(designs[done % len(scans)], scans[done % len(scans)])
        done += 1
    return (time.process_time() - spent) / done


def _rates(
    inspector: Inspector,
    pages: Sequence[Page],
    scans: Sequence[NDArray[np.uint16]],
    *,
    cores: int,
    say: Callable[[str], None],
) -> dict[int, float]:
    """Return whole inspections a second by number of worker processes, in the workers that a run uses."""
    most = max(worker_count(cores, inspector), 1)
    workers = InspectionWorkers(most, processors=cores)
    sheets = SheetInspector(inspector=inspector.with_threads(THREADS_A_WORKER), workers=workers)
    try:
        with ThreadPoolExecutor(cores) as crew:
            ready = list(crew.map(sheets.prepare, pages))

        def inspect(turn: int) -> None:
            at = turn % len(pages)
            sheets.inspect(ready[at], scans[at], name="timed", seed=0)

        rates = {}
        for count in sorted({1, max(most // 2, 1), most}, reverse=True):
            with ThreadPoolExecutor(count) as crew:
                list(crew.map(inspect, range(3 * count * len(pages))))  # reads designs, records steps
                begin = time.perf_counter()
                turns = itertools.count()

                def work(_: int, end: float, turns: Iterator[int]) -> int:
                    done = 0
                    while time.perf_counter() < end:
                        inspect(next(turns))
                        done += 1
                    return done

                done = sum(crew.map(partial(work, end=begin + SECONDS, turns=turns), range(count)))
                rates[count] = done / (time.perf_counter() - begin)
            say(f"{inspector.engine}: {rates[count]:.1f} inspections a second by {count} workers")
        return dict(sorted(rates.items()))
    finally:
        workers.close()


# --- the section of docs/performance.md ---

HEADING: Final = "\n## On a graphics card\n"
STORED: Final = "performance-card.json"
RATES: Final = """
Whole inspections a second by the worker processes of a run, with two threads each:

| workers | images on the card | all on the processor |
|---:|---:|---:|
"""


def write_card_section(figures: CardFigures, folder: Path) -> None:
    """Store the figures beside ``performance.md`` and put the section at its end."""
    text = json.dumps(plain(figures), indent=1, allow_nan=False)
    (folder / STORED).write_text(text + "\n", encoding="utf-8")
    add_card_section(folder)


def add_card_section(folder: Path) -> None:
    """Put the section of stored figures at the end of ``performance.md``; without any, nothing changes."""
    if not (folder / STORED).is_file():
        return
    page = folder / "performance.md"
    before = page.read_text(encoding="utf-8").split(HEADING)[0]
    figures = json.loads((folder / STORED).read_text(encoding="utf-8"))
    page.write_text(before + card_section(figures), encoding="utf-8")


def card_section(figures: dict[str, Any]) -> str:
    """Return the section's text."""
    of = figures
    flights = ", ".join(f"{rate:,.0f} with {count}" for count, rate in of["in_flight"].items())
    rows = "".join(
        f"| {workers} | {rate:.1f} | {of['cpu_per_s'][workers]:.1f} |\n"
        for workers, rate in of["gpu_per_s"].items()
    )
    rates = RATES + rows if rows else ""
    middle, most_95, most_99, most = of["score_off"]
    differing = "".join(
        f"\n\n- {one['page']}, {one['misprint'] or 'good'}: {one['cpu']} (score {one['cpu_score']:.2f}) "
        f"on the processor, {one['gpu']} ({one['gpu_score']:.2f}) on the card"
        for one in of["differing"]
    )
    return f"""{HEADING}
`prooflight bench --device gpu --docs docs` writes this section. Card: {of["card"]}, numba-cuda {of["numba_cuda"]};
{of["host_cores"]} cores; scans of {of["camera_mpx"]:.2f} Mpx.

Of {of["prints"]:,} prints of {of["pages"]} pages of the sample job ({of["misprints"]:,} misprinted)
{len(of["differing"])} had another verdict on the card than on the processor, and {of["other_kinds"]} were misprints of
another kind. Scores differed by {middle:.3f} (median), by at most {most_95:.2f} on 95 of 100 prints, {most_99:.2f} on
99 of 100 and {most:.2f} on all; the threshold is {of["threshold"]:.2f}.{differing}

A sheet takes {of["sheet_ms"]:.2f} ms on the card, {of["upload_ms"]:.2f} ms of it to send the scan. Sheets a second
with so many on it at once: {flights}. The first inspection takes {of["compiled_s"]:.0f} s: the card's code is compiled.

An inspection takes {of["gpu_cpu_s"]:.3f} s of processor time with its images on the card, {of["cpu_cpu_s"]:.3f} s
without: registration, fringes, marks, glyphs and statistics remain on the processor.
{rates}"""


# --- prints judged on the processor and on the card ---

A_PART: Final = 16
"""Prints of one page that are judged one after the other, once its design is prepared."""
OTHERS: Final = 3
"""Number of other pages that may come in a page's place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """One scan, judged on the processor and on the card."""

    page: str
    misprint: str
    """Kind that was printed; "": a good print."""
    cpu: str
    """Verdict, and kind of misprint."""
    gpu: str
    cpu_score: float
    gpu_score: float
    statistics_off: float
    """Greatest difference of a statistic, in standard deviations of good prints."""

    @property
    def score_off(self) -> float:
        """Difference of the scores."""
        return abs(self.cpu_score - self.gpu_score)

    @property
    def differs(self) -> bool:
        """Whether one alarms and the other does not, or one is not inspected."""
        return self.cpu.partition(" ")[0] != self.gpu.partition(" ")[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgePart:
    """Prints of one page, each judged by both."""

    job: Path
    press: Press
    seed: int

    def __call__(self, part: tuple[int, int, int]) -> list[Compared]:
        """Return the judgements of a page's prints.

        part: number of the page, from 1; number of its first print; number of prints.
        """
        number, first, count = part
        inspector = Inspector.of(self.press, "matched_filter").with_threads(1)
        card, session = inspector.on("gpu"), session_of(self.press, self.seed)
        with open_job(self.job, self.press) as opened:

            def laid(number: int) -> Page:
                return self.press.geometry.lay(opened.page(number))

            others = tuple(1 + (number + step) % len(opened) for step in range(OTHERS))
            page = laid(number)
            design = inspector.prepare(page)
            on_card, compared = with_inspector(design, card), list[Compared]()
            for turn in range(first, first + count):
                # Every third print is a misprint, of another kind each.
                kind = KINDS[(number + turn // 3) % len(KINDS)] if turn % 3 == 2 else ""
                try:
                    scan = scan_page(
                        page,
                        press=self.press,
                        request=MisprintRequest(kind=kind) if kind else None,
                        others=others,
                        fetch=laid,
                        rng=stream(self.seed, "card-print", turn, number),
                        session=session,
                    ).dn
                except RequestError:  # a page without cyan cannot lack it
                    continue
                compared.append(_compared(kind, inspector, design, card, on_card, scan))
        return compared


def judged_by_both(
    job: Path,
    press: Press,
    *,
    pages: int,
    prints: int,
    seed: int,
    processes: int,
    say: Callable[[str], None],
) -> list[Compared]:
    """Return some ``prints`` of a job's pages judged on the processor and on the card."""
    each = -(-prints // pages)
    parts = [
        (number, first, min(A_PART, each - first))
        for first in range(0, each, A_PART)
        for number in range(1, pages + 1)
    ]
    work, compared = JudgePart(job=job, press=press, seed=seed), list[Compared]()
    for turn, done in enumerate(in_order(work, parts, processes=processes)):
        compared += done
        say(f"{len(compared)} of {prints} prints judged by both, {turn + 1} of {len(parts)} parts")
    return compared


def with_inspector(prepared: Prepared, inspector: Inspector) -> Prepared:
    """Return a prepared page for another inspector of the same press."""
    detector_page, detector = prepared.prepared_page, inspector.detector
    assert isinstance(detector_page, MatchedFilterPage)
    assert isinstance(detector, MatchedFilterDetector)
    return replace(prepared, prepared_page=replace(detector_page, detector=detector))


def _compared(
    kind: str,
    inspector: Inspector,
    prepared: Prepared,
    card: Inspector,
    on_card: Prepared,
    scan: NDArray[np.uint16],
) -> Compared:
    one, other = inspector.inspect(prepared, scan), card.inspect(on_card, scan)
    scores = [
        inspector.detector.decided_again(StoredArrays(each.stored_arrays, inspector.detector.name)).score
        for each in (one, other)
    ]
    detector_page: Any = prepared.prepared_page
    features = one.stored_arrays["page_features"][None]
    deviations = [
        detector_page.model.deviations(each.stored_arrays["values"][None], features)[0]
        for each in (one, other)
    ]
    off = np.abs(deviations[0] - deviations[1])
    return Compared(
        page=prepared.page.name,
        misprint=kind,
        cpu=_verdict(one),
        gpu=_verdict(other),
        cpu_score=float(scores[0]),
        gpu_score=float(scores[1]),
        statistics_off=float(off[np.isfinite(off)].max(initial=0.0)),
    )


def _verdict(inspection: Inspection) -> str:
    return f"{inspection.verdict.verdict} {inspection.verdict.kind or ''}".strip()
