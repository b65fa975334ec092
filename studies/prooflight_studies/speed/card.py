"""A graphics card beside the processor: equal verdicts, time of a sheet on the card, and whole inspections a second."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from importlib.metadata import version
from statistics import median
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.detectors.base import StoredArrays
from prooflight.detectors.matched_filter.analysis import analyse
from prooflight.detectors.matched_filter.card_images import Designs, engine_on
from prooflight.detectors.matched_filter.detector import MatchedFilterDetector, MatchedFilterPage
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.statistics.statistic import SCREEN_MODES
from prooflight.errors import RequestError
from prooflight.inspection.inspector import Inspector
from prooflight.kernels.gpu.runners import Card, Pool, launched
from prooflight.pages.process import settle_process
from prooflight.rng import stream
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight.simulation.session import session_of

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence

    from numpy.typing import NDArray

    from prooflight.inspection.inspector import Prepared
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

REPEATS: Final = 20
IN_FLIGHT: Final = (1, 2, 4, 8)
"""Sheets on the card at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """One scan, inspected on the processor and on the card."""

    page: str
    misprint: str
    """Kind that was printed; "": a good print."""
    cpu: str
    """Verdict."""
    gpu: str
    cpu_score: float
    gpu_score: float
    statistics_off: float
    """Greatest difference of a statistic, in standard deviations of good prints."""


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
    compared: tuple[Compared, ...]
    sheet_ms: float
    """From a scan in pinned memory to its sums on the card, median."""
    upload_ms: float
    in_flight: dict[int, float]
    """Sheets a second on the card, by sheets on it at once."""
    gpu_per_s: dict[int, float]
    """Whole inspections a second by inspecting threads, images on the card ..."""
    cpu_per_s: dict[int, float]
    """... and all on the processor."""
    gpu_cpu_s: float
    """Processor time of an inspection with images on the card ..."""
    cpu_cpu_s: float
    """... and without."""


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


Scanned = tuple[int, str, "NDArray[np.uint16]"]
"""A page's index, the kind of its misprint or "", and the scan."""


def prints_of(pages: Sequence[Page], press: Press, *, seed: int, each: int) -> list[Scanned]:
    """Return prints of every page in the press world, every third a misprint; of those that cannot be, none."""
    session = session_of(press, seed)

    def printed(turn: int) -> Scanned | None:
        copy, index = divmod(turn, len(pages))
        page, kind = pages[index], KINDS[turn // 3 % len(KINDS)] if turn % 3 == 2 else ""
        try:
            scan = scan_page(
                page,
                press=press,
                request=MisprintRequest(kind=kind) if kind else None,
                others=tuple(other.number for other in pages if other.number != page.number),
                fetch=lambda number: next(one for one in pages if one.number == number),
                rng=stream(seed, "card-print", copy, index),
                session=session,
            )
        except RequestError:  # a page without cyan cannot lack it
            return None
        return index, kind, scan.dn

    printed(0)  # compiles
    with ThreadPoolExecutor(os.cpu_count() or 1) as crew:
        return [one for one in crew.map(printed, range(each * len(pages))) if one is not None]


def card_figures(
    pages: Sequence[Page],
    press: Press,
    *,
    seed: int,
    each: int = 2,
    seconds: float = 4.0,
    say: Callable[[str], None] = lambda _: None,
) -> CardFigures:
    """Measure a card on prints of some pages; RequestError: there is none."""
    settle_process()  # as processes are that inspect page after page
    inspector = Inspector.of(press, "matched_filter").with_threads(1)
    card = inspector.on("gpu")
    cores = os.cpu_count() or 1
    say("preparing designs and printing")
    inspector.prepare(pages[0])  # compiles
    with ThreadPoolExecutor(cores) as crew:
        designs = list(crew.map(inspector.prepare, pages))
    scans = prints_of(pages, press, seed=seed, each=each)
    on_card = [_with(prepared, card) for prepared in designs]
    started = time.perf_counter()
    card.inspect(on_card[scans[0][0]], scans[0][2])
    compiled_s = time.perf_counter() - started
    inspector.inspect(designs[scans[0][0]], scans[0][2])
    say(f"first inspection on the card after {compiled_s:.1f} s; comparing {len(scans)} scans")
    with ThreadPoolExecutor(cores) as crew:
        compared = tuple(
            crew.map(
                lambda one: _compared(
                    one[1], inspector, designs[one[0]], card, on_card[one[0]], np.ascontiguousarray(one[2])
                ),
                scans,
            )
        )
    say("timing the card alone")
    good = next((index, scan) for index, kind, scan in scans if not kind)
    sheet_ms, upload_ms, in_flight = _card_alone(designs[good[0]], good[1], say)
    say("timing whole inspections")
    threads = sorted({1, cores // 2 or 1, cores})
    gpu = {n: _inspections(card, on_card, scans, n, seconds) for n in threads}
    cpu = {n: _inspections(inspector, designs, scans, n, seconds) for n in threads}
    return CardFigures(
        card=card.engine,
        numba_cuda=version("numba-cuda"),
        host_cores=cores,
        threshold=_threshold(press),
        camera_mpx=scans[0][2].size / 1e6,
        compiled_s=compiled_s,
        compared=compared,
        sheet_ms=sheet_ms,
        upload_ms=upload_ms,
        in_flight=in_flight,
        gpu_per_s={n: one[0] for n, one in gpu.items()},
        cpu_per_s={n: one[0] for n, one in cpu.items()},
        gpu_cpu_s=gpu[1][1],
        cpu_cpu_s=cpu[1][1],
    )


def _threshold(press: Press) -> float:
    return model_of(press).threshold


def _with(prepared: Prepared, inspector: Inspector) -> Prepared:
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
    features = one.stored_arrays["portrait"][None]
    deviations = [
        detector_page.model.deviations(each.stored_arrays["values"][None], features)[0]
        for each in (one, other)
    ]
    off = np.abs(deviations[0] - deviations[1])
    return Compared(
        page=prepared.page.name,
        misprint=kind,
        cpu=f"{one.verdict.verdict} {one.verdict.kind or ''}".strip(),
        gpu=f"{other.verdict.verdict} {other.verdict.kind or ''}".strip(),
        cpu_score=float(scores[0]),
        gpu_score=float(scores[1]),
        statistics_off=float(off[np.isfinite(off)].max(initial=0.0)),
    )


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


def _inspections(
    inspector: Inspector,
    designs: Sequence[Prepared],
    scans: Sequence[tuple[int, str, NDArray[np.uint16]]],
    threads: int,
    seconds: float,
) -> tuple[float, float]:
    """Return whole inspections of good prints a second, and processor time of one, with so many at once."""
    good = [(index, scan) for index, kind, scan in scans if not kind]

    def work(turn: int) -> int:
        done = 0
        while time.perf_counter() < end:
            index, scan = good[(turn + done) % len(good)]
            inspector.inspect(designs[index], scan)
            done += 1
        return done

    def warm(turn: int) -> None:
        index, scan = good[turn % len(good)]
        inspector.inspect(designs[index], scan)

    with ThreadPoolExecutor(threads) as crew:
        list(crew.map(warm, range(2 * threads)))
        begin, spent = time.perf_counter(), time.process_time()
        end = begin + seconds
        count = sum(crew.map(work, range(threads)))
        took = time.perf_counter() - begin
    return count / took, (time.process_time() - spent) / max(count, 1)
