"""An hour of pages with random faults of the paper path and the camera, as fast as possible; writes ``soak.md``."""

from __future__ import annotations

import tempfile
import time
import zlib
from dataclasses import dataclass, fields, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.build import build_press
from prooflight.prediction.predict import predict
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight.simulation.corpus.corpus import design_page
from prooflight.simulation.corpus.designs.faces import OutlineFace
from prooflight.simulation.corpus.designs.sheet import Sheet
from prooflight.simulation.drum import AMOUNTS, LINE_FAULTS, ORDER_FAULTS, Drum, DrumFault, turns
from prooflight.simulation.scans import scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of, worlds_digest
from prooflight_line.journal.journal import Journal
from prooflight_line.journal.records import RunFacts
from prooflight_line.run.outcomes import missing_page, skipped
from prooflight_line.run.pager import Pager
from prooflight_line.run.sheets.records import MissingPage, SeenPage
from prooflight_line.run.sheets.thumbnails import thumbnail_of
from prooflight_line.run.status import VERDICTS
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight.simulation.drum import Turn
    from prooflight_line.journal.records import PageRecord
    from prooflight_line.run.sheets.thumbnails import Thumbnail

SHEETS, QUICK_SHEETS = 3600, 240
"""Numbers of sheets: an hour at a page a second, the paper's slowest."""
FAULT_EVERY: Final = 12
"""Sheets from fault to fault, on average; a press with so many would be stopped."""
LEAST_SPACING: Final = 6
"""Least number of sheets between faults, so that effects can be attributed to one of them."""
BLOCKS_TIMED: Final = 45
"""Number of blocks timed together, a page's worth."""
IN_STEP: Final = 2
"""Sheets from a fault's first on within which the run must be in step again."""
DETECTOR: Final = "none"
"""Name of the detector in the journal: none inspects the sheets, since only their place in the job is evaluated."""
UNITS: Final = {
    "slip": "mm",
    "stretch": "%",
    "lost-lines": "lines",
    "extra-lines": "lines",
    "splice": "mm",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SoakFigures:
    """Results of the soak."""

    kinds: dict[str, dict[str, int]]
    """Counts for each kind: drawn, named, in_step."""
    sheets: int
    seen: int
    """Sheets that came out; a difference from the number passed means that some were lost or invented."""
    false_faults: int
    """Faults reported for sheets that no fault concerned."""
    wrong_pages: int
    """Such sheets identified as another page or none."""
    unlike: int
    """Such sheets whose crop differs from that in a run without faults."""
    missing_said: int
    """Pages reported as missing."""
    missing_true: int
    """Pages reported as missing that did not come."""
    missing_in_truth: int
    unconcerned: int
    """Sheets that no fault concerned."""
    verdicts: dict[str, int]
    """Number of the sheets that came by verdict, of ``VERDICTS``."""
    paging_ms_per_page: float
    notes: tuple[str, ...]
    """Errors, one line each."""


def soak_results(figures: SoakFigures, size: Mapping[str, int], *, seed: int) -> dict[str, Any]:
    """Return all figures of the page; size: of the job, as ``SIZE`` has it."""
    kinds = []
    for kind, counts in figures.kinds.items():
        least, greatest = AMOUNTS.get(kind, (0.0, 0.0))
        amounts = {"unit": UNITS.get(kind), "least": least, "greatest": greatest}
        kinds.append({"kind": kind, **amounts, **counts})
    values = {field.name: getattr(figures, field.name) for field in fields(figures)}
    stated = {
        "detector": DETECTOR,
        "job": size,
        "seed": seed,
        "every": FAULT_EVERY,
        "apart": LEAST_SPACING,
        "worlds": worlds_digest(),
    }
    return values | stated | {"kinds": kinds}


def run_soak_study(
    results: Path,
    *,
    sheets: int | None = None,
    seed: int = 12,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
) -> SoakFigures:
    """Play the sheets, page them, keep a journal, read it and compare it with the truth; write ``soak.md``."""
    progress("building the press")
    press = build_press(PressFile.prototype(), seed=1)
    size = (
        {"designs": 10, "templates": 1, "forms": 4} if quick else {"designs": 30, "templates": 2, "forms": 8}
    )
    ring = soak_ring(press, **size, seed=seed, progress=progress)
    count = sheets or (QUICK_SHEETS if quick else SHEETS)
    faults = drawn_faults(count, every=FAULT_EVERY, spacing=LEAST_SPACING, rng=stream(seed, "soak-faults"))
    passing = turns(count, faults)
    progress("a run without faults")
    usual = _played(press, ring, turns(2 * len(ring.scans), {}), sheets=2 * len(ring.scans))
    progress(f"{count} sheets with {len(faults)} faults")
    with tempfile.TemporaryDirectory() as folder:
        url = f"sqlite:///{Path(folder) / 'soak.db'}"
        run = _played(press, ring, passing, sheets=count, journal=url)
        with Journal.open(url, read_only=True) as journal:
            rows = list(journal.pages(journal.last_run().id))
    figures = compared(
        rows,
        run.digests,
        truth(passing, faults),
        faults,
        _usual(usual, len(ring.scans)),
        cpu_s=run.cpu_s,
    )
    write_page(results / "soak.md", "soak", soak_results(figures, size, seed=seed))
    return figures


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """Output of the pager, in order."""

    digests: tuple[int | None, ...]
    """Digest of each record's page in its scan; None: a missing page."""
    cpu_s: float


def _played(
    press: Press, ring: SoakRing, passing: list[Turn], *, sheets: int, journal: str | None = None
) -> _Run:
    drum = Drum(ring.scans, press=press, passing=passing, blank=ring.blank, foreign=ring.foreign)
    expected = RepeatedJob(ring.thumbnails, sheets)
    pager = Pager(press, expected=expected)
    opened = None if journal is None else Journal.open(journal)
    run_id = 0 if opened is None else opened.begin_run(_facts(press, sheets))
    digests, cpu_s = list[int | None](), 0.0

    def record(pages: list[SeenPage | MissingPage], time_s: float) -> None:
        for page in pages:
            number = len(digests)
            if isinstance(page, MissingPage):
                digests.append(None)
                outcome = missing_page(number, page, time_s)
            else:
                thumbnail = None if page.job_page is None else expected[page.job_page]
                digests.append(_digest(page, thumbnail, press))
                outcome = skipped(number, page, "only its place in the job is looked at")
            if opened is not None:
                opened.record(run_id, outcome.record)

    # The clock is asked once in many blocks: on some machines that takes longer than a block.
    blocks = drum.blocks()
    while some := list(islice(blocks, BLOCKS_TIMED)):
        begun_s = time.process_time()
        pages = [page for block in some for page in pager.push(block)]
        cpu_s += time.process_time() - begun_s
        record(pages, some[-1].time_s)
    record(pager.flush(), 0.0)
    if opened is not None:
        opened.close()
    return _Run(digests=tuple(digests), cpu_s=cpu_s)


def _digest(page: SeenPage, thumbnail: Thumbnail | None, press: Press) -> int:
    """Return the digest of the sheet in its scan.

    The backing before and after the sheet is left out, since it differs in every turn.
    """
    geometry = press.geometry
    first = round(geometry.lead_in_mm / geometry.line_pitch_mm)
    height_mm = thumbnail.height_mm if thumbnail is not None else 0.0
    lines = page.scan[:, first : first + int(height_mm / geometry.line_pitch_mm)]
    return zlib.crc32(np.ascontiguousarray(lines).tobytes())


def _facts(press: Press, sheets: int) -> RunFacts:
    return RunFacts(
        job="soak",
        job_digest="",
        press=press.name,
        press_digest=press.digest,
        detector=DETECTOR,
        source="drum",
        started_s=time.time(),
        sheets=sheets,
    )


def compared(
    rows: Sequence[PageRecord],
    digests: Sequence[int | None],
    sheets: Sequence[Passed],
    faults: Mapping[int, DrumFault],
    usual: Mapping[int, int],
    *,
    cpu_s: float,
) -> SoakFigures:
    """Compare rows of the journal with what passed.

    digests: of each row's scan, None where the row is of a page that did not come. usual: of each design's scan in a
    run without faults.
    """
    kinds = list(faults.values())
    came = [row for row, digest in zip(rows, digests, strict=True) if digest is not None]
    cut = [digest for digest in digests if digest is not None]
    missing = [row.job_page for row, digest in zip(rows, digests, strict=True) if digest is None]
    never = {sheet for sheet, fault in faults.items() if fault.kind in ("missing", "blank", "unknown")}
    counts: dict[str, dict[str, int]] = {
        kind: {"drawn": 0, "named": 0, "in_step": 0} for kind in (*ORDER_FAULTS, *LINE_FAULTS)
    }
    false_faults = wrong_pages = unlike = 0
    notes = list[str]()
    first = {sheet.fault: place for place, sheet in reversed(list(enumerate(sheets)))}
    for number, fault in enumerate(kinds):
        place, count = first[number], counts[fault.kind]
        near = {kind for row in came[place : place + IN_STEP] for kind in row.faults}
        after = range(place + IN_STEP, min(place + LEAST_SPACING - 1, len(sheets), len(came)))
        in_step = all(came[n].job_page == sheets[n].page and not came[n].faults for n in after)
        count["drawn"] += 1
        count["named"] += fault.kind in near
        count["in_step"] += in_step
        if fault.kind not in near or not in_step:
            notes.append(
                f"{fault}: reported {', '.join(sorted(near)) or 'nothing'}, {'' if in_step else 'not '}in step"
            )
    for place, (sheet, row, digest) in enumerate(zip(sheets, came, cut, strict=False)):
        if sheet.fault is not None:
            continue
        false_faults += bool(row.faults)
        wrong_pages += row.job_page != sheet.page
        odd = row.job_page is not None and digest != usual.get(row.job_page % len(usual))
        unlike += odd
        if row.faults or row.job_page != sheet.page:
            notes.append(
                f"sheet {place}: reported page {row.job_page} for {sheet.page}, {', '.join(row.faults)}"
            )
    return SoakFigures(
        kinds=counts,
        sheets=len(sheets),
        seen=len(came),
        false_faults=false_faults,
        wrong_pages=wrong_pages,
        unlike=unlike,
        missing_said=len(missing),
        missing_true=len(never & set(missing)),
        missing_in_truth=len(never),
        unconcerned=sum(sheet.fault is None for sheet in sheets),
        verdicts={name: sum(row.verdict.verdict == name for row in came) for name in VERDICTS},
        paging_ms_per_page=1e3 * cpu_s / max(len(sheets), 1),
        notes=tuple(notes),
    )


def _usual(run: _Run, designs: int) -> dict[int, int]:
    """Return the digest of each design's scan in its second turn, without a fault."""
    second = run.digests[designs : 2 * designs]
    return {design: digest for design, digest in enumerate(second) if digest is not None}


# --- input: prints of whole designs and of forms that differ in three words, and the faults ---

TEXTS: Final = 3
"""Number of words by which the forms of one template differ."""
FIELD_MM: Final = (34.0, 6.0)
LETTERS: Final = "ABCDEFGHKLMNPRSTUVWXYZ"
TYPE_PT: Final = 11.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SoakRing:
    """A job printed once in the press world, and two sheets that are not part of it."""

    thumbnails: tuple[Thumbnail, ...]
    scans: tuple[NDArray[np.uint16], ...]
    blank: NDArray[np.uint16]
    foreign: NDArray[np.uint16]


class RepeatedJob:
    """A job's thumbnails, repeated for so many sheets; ``following.Expected``."""

    def __init__(self, designs: Sequence[Thumbnail | None], sheets: int) -> None:
        self._designs, self._sheets = designs, sheets

    def __len__(self) -> int:
        return self._sheets

    def __getitem__(self, sheet: int) -> Thumbnail | None:
        if not 0 <= sheet < self._sheets:
            raise IndexError(sheet)
        return self._designs[sheet % len(self._designs)]


def soak_ring(
    press: Press,
    *,
    designs: int,
    templates: int,
    forms: int,
    seed: int,
    progress: Callable[[str], None],
) -> SoakRing:
    """Print a job: so many whole designs, then so many forms of each of some templates, one after the other."""
    session = Session.draw(amounts_of(press), press, stream(seed, "session"))
    thumbnails, scans = [], []

    def printed(page: Page, index: int) -> NDArray[np.uint16]:
        rng = stream(seed, "soak-print", index)
        scan = scan_page(
            page, press=press, request=None, others=(), fetch=lambda _: page, rng=rng, session=session
        )
        return scan.dn

    count = designs + templates * forms
    for index, drawn in enumerate(_pages(press.dpi, designs, templates, forms, seed)):
        progress(f"printing page {index + 1} of {count}")
        page = press.geometry.lay(drawn)
        good = predict(page, sensors=press.sensors, geometry=press.geometry)
        thumbnails.append(thumbnail_of(page, good, press))
        scans.append(printed(page, index))
    unknown_sheet = design_page(seed, count + 1000, dpi=press.dpi)
    white = replace(unknown_sheet, cmyk=np.zeros_like(unknown_sheet.cmyk))
    return SoakRing(
        thumbnails=tuple(thumbnails),
        scans=tuple(scans),
        blank=printed(white, count),
        foreign=printed(unknown_sheet, count + 1),
    )


def _pages(dpi: float, designs: int, templates: int, forms: int, seed: int) -> Iterator[Page]:
    for index in range(designs):
        yield design_page(seed, index, dpi=dpi)
    for template in range(templates):
        empty = design_page(seed, designs + template, dpi=dpi)
        rng = stream(seed, "soak-forms", template)
        high, wide = (extent - size for extent, size in zip(_extent(empty), FIELD_MM[::-1], strict=True))
        places = [
            (float(rng.uniform(10, wide - 10)), float(rng.uniform(10, high - 10))) for _ in range(TEXTS)
        ]
        for _ in range(forms):
            yield _filled_in(empty, places, rng)


def _extent(page: Page) -> tuple[float, float]:
    return page.height_mm, page.width_mm


def _filled_in(empty: Page, places_mm: list[tuple[float, float]], rng: np.random.Generator) -> Page:
    """Return a form with its own words in white fields."""
    cmyk = empty.cmyk.copy()
    for x_mm, y_mm in places_mm:
        field = Sheet(width_mm=FIELD_MM[0], height_mm=FIELD_MM[1], dpi=empty.dpi)
        letters = "".join(rng.choice(list(LETTERS), 8))
        field.draw_text(1.0, 4.6, letters, OutlineFace("DejaVuSans"), TYPE_PT)
        top, left = round(y_mm / empty.pixel_mm), round(x_mm / empty.pixel_mm)
        rows, columns = field.cmyk.shape[:2]
        cmyk[top : top + rows, left : left + columns] = field.cmyk
    return replace(empty, cmyk=cmyk)


def drawn_faults(sheets: int, *, every: int, spacing: int, rng: np.random.Generator) -> dict[int, DrumFault]:
    """Draw faults of all kinds, evenly, one in ``every`` sheets on average.

    They are at least ``spacing`` sheets from each other.
    """
    kinds = (*ORDER_FAULTS, *LINE_FAULTS)
    faults, sheet = dict[int, DrumFault](), spacing
    while True:
        sheet += spacing + int(rng.geometric(1 / (every - spacing + 1)) - 1)
        if sheet >= sheets - spacing:
            return faults
        faults[sheet] = DrumFault.draw(kinds[int(rng.integers(len(kinds)))], rng)


@dataclass(frozen=True, slots=True, kw_only=True)
class Passed:
    """True state of a sheet that passes the camera."""

    page: int | None
    """Page of the job; None: the sheet is not part of it."""
    fault: int | None
    """Index of the fault, among those drawn, that concerns the sheet; None: none does."""


def truth(passing: list[Turn], faults: dict[int, DrumFault]) -> list[Passed]:
    """Return the sheets that pass, one an entry.

    A fault concerns its own sheet, both of two sheets that changed places, the second print of a repeated page, and the
    sheet after a missing page.
    """
    number = {sheet: index for index, sheet in enumerate(faults)}
    of_fault = {id(fault): number[sheet] for sheet, fault in faults.items()}
    swapped = {
        place: number[sheet]
        for sheet, fault in faults.items()
        if fault.kind == "out-of-order"
        for place in (sheet, sheet + 1)
    }
    twice = {sheet: number[sheet] for sheet, fault in faults.items() if fault.kind == "repeated"}
    sheets, pending, came = list[Passed](), None, set[int]()
    for turn in passing:
        if turn.fault is not None and turn.fault.kind == "missing":
            pending = of_fault[id(turn.fault)]
            continue
        fault = pending if turn.fault is None else of_fault[id(turn.fault)]
        if fault is None and turn.page is not None:
            fault = swapped.get(turn.page, twice.get(turn.page) if turn.page in came else None)
        if turn.page is not None:
            came.add(turn.page)
        sheets.append(Passed(page=turn.page, fault=fault))
        pending = None
    return sheets
