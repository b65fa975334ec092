"""Numbers on prints of the press world: whether a wrong digit alarms, by the ranking alone and with the glyph test."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training import DESIGNS
from prooflight.commissioning.training.train import DEFAULT_RATE, trained
from prooflight.detectors.base import StoredArrays
from prooflight.detectors.matched_filter.calibrated import CalibratedDetector
from prooflight.detectors.matched_filter.detector import MatchedFilterDetector
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.inspection.inspector import Inspector
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.press.artefact import Press
from prooflight.press.press_file import PressFile
from prooflight.rng import stream
from prooflight.scans.scan import Scan
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.scans import scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import amounts_of
from prooflight_studies.harness.result_cache import digest_of, run_pieces
from prooflight_studies.harness.versions import ALGORITHMS
from prooflight_studies.paper.study import at_pitch

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection, PreparedPage
    from prooflight_studies.harness.result_cache import Rows

PITCHES_MM: Final = (0.254, 0.127)
SHEETS: Final = 168
"""Number of sheets of each size: 504 wrong digits, a third of each kind."""
SHEETS_A_DAY: Final = 4
QUICK: Final = 4
QUICK_DESIGNS: Final = 24
SPECIMEN_SEED: Final = 1
TRAINING_SEED: Final = 70_001
"""Seed of the designs on which `press build` trains a press."""
NEAR_MM: Final = 1.0
"""Tolerance between the position that the verdict reports and the wrong digit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TextResults:
    """Results of the part on numbers."""

    seed: int
    sheets: int
    """Number of sheets of each size, at each pitch."""
    pitches_mm: list[float]
    promise: float
    """Target false-alarm rate: one good page in 1 / promise may alarm."""
    caught: list[dict[str, float | int | str]]
    """Counts by pitch, size and kind of error."""
    good: list[dict[str, float | int | str]]
    """Counts by pitch."""
    margins: list[dict[str, float]]
    """Glyph score S of good prints and of wrong ones, by pitch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TextPiece:
    """Sheets of one size, of one press day."""

    pitch_mm: float
    points: int
    first: int
    sheets: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TextWork:
    """Inspection of a day's sheets, each printed once well and once with each kind of wrong digit."""

    press: Path
    seed: int

    def __call__(self, piece: TextPiece) -> Rows:
        """Return the rows of a day.

        Columns: points, wrong (an index of ``WRONGS``; -1: good), before, after, near, named, s.
        """
        bench = _Bench.at(self.press)
        at = POINTS.index(piece.points)
        session = Session.draw(
            amounts_of(bench.press), bench.press, stream(self.seed, "content-text-session", piece.first, at)
        )
        rows: list[dict[str, Any]] = []
        for number in range(piece.first, piece.first + piece.sheets):
            rng = stream(self.seed, "content-text", number, at)
            sheet = text_sheet(piece.points, rng=rng)
            page = sheet.raster(number + 1, dpi=bench.press.dpi)
            ready = bench.detector.prepare(bench.inspector.planned(page, threads=1))
            for wrong in (-1, *range(len(WRONGS))):
                printed = page
                if wrong >= 0:
                    printed = with_wrong_digit(sheet, WRONGS[wrong], rng=rng).raster(
                        number + 1, dpi=bench.press.dpi
                    )
                row = {"points": piece.points, "wrong": wrong}
                rows.append(row | bench.inspected(ready, page, printed, session, rng))
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Bench:
    """A press with its detector as it is, and with the same detector without the glyph test."""

    press: Press
    inspector: Inspector
    detector: MatchedFilterDetector
    before: MatchedFilterDetector

    @classmethod
    def at(cls, path: Path) -> _Bench:
        return _bench(path)

    def inspected(
        self, ready: PreparedPage, page: Page, printed: Page, session: Session, rng: np.random.Generator
    ) -> dict[str, Any]:
        scan = scan_page(
            printed,
            press=self.press,
            request=None,
            others=(),
            fetch=lambda _: printed,
            rng=rng,
            session=session,
        )
        done = ready.inspect(Scan(dn=scan.dn, name="print"))
        stored = {name: array for name, array in done.stored_arrays.items() if name != "glyphs"}
        before = self.before.decided_again(StoredArrays(stored, self.before.name))
        after = done.verdict.verdict == "misprint"
        return {
            "before": before.misprint,
            "after": after,
            "near": after and _near(done, page, printed),
            "named": after and done.verdict.kind in ("exchanged-glyph", "missing-glyph"),
            "s": float(done.stored_arrays["glyphs"]),
        }


@lru_cache(maxsize=1)
def _bench(path: Path) -> _Bench:
    press = Press.load(path)
    inspector = Inspector.of(press, "matched_filter").with_threads(1)
    detector = inspector.detector
    assert isinstance(detector, MatchedFilterDetector)
    return _Bench(
        press=press,
        inspector=inspector,
        detector=detector,
        before=replace(detector, calibrated=without_glyphs(model_of(press))),
    )


def without_glyphs(detector: CalibratedDetector) -> CalibratedDetector:
    """Return the same detector with the same false-alarm rate, but without the glyph test."""
    return CalibratedDetector.calibrated(
        detector.model,
        detector.own,
        references=detector.references,
        pages=replace(detector.pages, glyphs=np.zeros(0)),
        false_alarm_rate=detector.guarantee.requested_rate,
        misprint_rate=detector.misprint_rate,
        real=detector.real,
    )


def _near(done: Inspection, page: Page, printed: Page) -> bool:
    """Return whether the first region of a verdict is where the raster was changed."""
    if not done.verdict.regions:
        return False
    rows, columns = np.nonzero((page.cmyk != printed.cmyk).any(axis=-1))
    if not rows.size:
        return False
    first, px = done.verdict.regions[0], page.pixel_mm
    return bool(
        first.x_mm - NEAR_MM <= columns.max() * px
        and first.x_mm + first.width_mm + NEAR_MM >= columns.min() * px
        and first.y_mm - NEAR_MM <= rows.max() * px
        and first.y_mm + first.height_mm + NEAR_MM >= rows.min() * px
        and first.width_mm <= 10 * NEAR_MM
    )


def run_text_study(
    cache: Path,
    *,
    seed: int,
    sheets: int = SHEETS,
    pitches_mm: Sequence[float] = PITCHES_MM,
    quick: bool = False,
    processes: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> TextResults:
    """Train a press at each pitch, print sheets of numbers of each size, and count alarms."""
    sheets, designs = (QUICK, QUICK_DESIGNS) if quick else (sheets, DESIGNS)
    every: list[tuple[float, Rows]] = []
    for pitch_mm in pitches_mm[:1] if quick else pitches_mm:
        path = _trained_press(cache, pitch_mm, designs, processes=processes, progress=progress)
        pieces = [
            TextPiece(pitch_mm=pitch_mm, points=points, first=first, sheets=min(SHEETS_A_DAY, sheets - first))
            for points in POINTS
            for first in range(0, sheets, SHEETS_A_DAY)
        ]
        rows = run_pieces(
            TextWork(press=path, seed=seed),
            pieces,
            cache,
            digest=digest_of({"seed": seed, "press": Press.load(path).digest, "algorithms": ALGORITHMS}),
            processes=processes,
            progress=lambda done, total: progress(f"{pitch_mm} mm: {done} of {total} press days"),  # noqa: B023
        )
        every.append((pitch_mm, rows))
    return text_results(every, seed=seed, sheets=sheets)


def _trained_press(
    cache: Path,
    pitch_mm: float,
    designs: int,
    *,
    processes: int | None,
    progress: Callable[[str], None],
) -> Path:
    """Return the path of a press that is trained as by `press build` at a pitch; cached."""
    facts = {"pitch_mm": pitch_mm, "designs": designs, "algorithms": ALGORITHMS}
    path = cache / f"taught-{digest_of(facts)[:16]}.press"
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        progress(f"building a press with a pixel pitch of {pitch_mm} mm, on {designs} designs")
        press = build_press(at_pitch(PressFile.prototype(), pitch_mm), seed=SPECIMEN_SEED)
        corpus = Corpus(seed=TRAINING_SEED, dpi=press.dpi)
        trained(
            press,
            corpus,
            designs=designs,
            seed=SPECIMEN_SEED,
            false_alarm_rate=DEFAULT_RATE,
            processes=processes,
        ).save(path)
    return path


def text_results(every: list[tuple[float, Rows]], *, seed: int, sheets: int) -> TextResults:
    """Count rows by pitch."""
    return TextResults(
        seed=seed,
        sheets=sheets,
        pitches_mm=[pitch_mm for pitch_mm, _ in every],
        promise=DEFAULT_RATE,
        caught=[
            _of_wrong(pitch_mm, points, name, rows, (rows["points"] == points) & (rows["wrong"] == wrong))
            for pitch_mm, rows in every
            for points in POINTS
            for wrong, name in enumerate(WRONGS)
        ],
        good=[_of_good(pitch_mm, rows, rows["wrong"] < 0) for pitch_mm, rows in every],
        margins=[_margin(pitch_mm, rows) for pitch_mm, rows in every],
    )


def _of_wrong(
    pitch_mm: float, points: int, wrong: str, rows: Rows, which: NDArray[np.bool_]
) -> dict[str, float | int | str]:
    counts = {name: int(rows[name][which].sum()) for name in ("before", "after", "near", "named")}
    return {"pitch_mm": pitch_mm, "points": points, "wrong": wrong, "printed": int(which.sum()), **counts}


def _of_good(pitch_mm: float, rows: Rows, which: NDArray[np.bool_]) -> dict[str, float | int | str]:
    counts = {name: int(rows[name][which].sum()) for name in ("before", "after", "named")}
    return {"pitch_mm": pitch_mm, "printed": int(which.sum()), **counts}


def _margin(pitch_mm: float, rows: Rows) -> dict[str, float]:
    good, wrong = rows["s"][rows["wrong"] < 0], rows["s"][rows["wrong"] >= 0]
    return {
        "pitch_mm": pitch_mm,
        "greatest_good": float(good.max()),
        "one_in_100_wrong": float(np.quantile(wrong, 0.01)),
        "half_of_wrong": float(np.median(wrong)),
    }


# --- sheets of numbers like those of invoices, with one digit of one number wrong ---

POINTS: Final = (6, 8, 10)
FACES: Final = ("helv", "hebo", "tiro", "cour", "DejaVuSans", "STIXGeneral")
"""Faces: Helvetica, Helvetica Bold, Times, Courier as MuPDF draws PDF's base fonts; the others come with matplotlib."""
WRONGS: Final = ("swapped", "dropped", "replaced")
"""Kinds of errors: two neighbouring digits exchanged, a digit missing, a digit replaced by another."""
PAGE_MM: Final = (100.0, 70.0)
MARGIN_MM: Final = 6.0
LEADING: Final = 1.3
"""Distance from row to row. [sizes]"""
COLUMNS_MM: Final = (6.0, 42.0, 60.0, 94.0)
"""Left edge of the words, and right edges of the numbers."""
FINE: Final = 8
"""Steps of an outline per raster pixel: a pixel is inked if its centre is inside."""
POINT_MM: Final = MM_PER_INCH / 72
BLACK: Final = (0, 0, 0, 255)
COLOURS: Final = ((255, 180, 0, 0), (0, 255, 230, 0), (230, 0, 255, 60), (0, 0, 0, 180))
"""CMYK colours of text that is not black: blue, red, green, grey."""
TINTS: Final = ((0, 0, 0, 26), (0, 0, 51, 0), (38, 0, 0, 0), (0, 26, 38, 13))
"""CMYK tints behind every second row of sheets that have a tint."""
ITEMS: Final = ("Item", "Order", "Paper A4", "Carriage", "Discount", "Service", "Lot", "Unit", "Account")
LEAST_DIGITS: Final = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Number:
    """A number on a sheet."""

    text: str
    right_mm: float
    baseline_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TextSheet:
    """Content of a sheet, before rasterisation."""

    points: int
    face: str
    ink: tuple[int, int, int, int]
    tint: tuple[int, int, int, int] | None
    items: tuple[Number, ...]
    """Words, set from the left at ``right_mm``; otherwise like the numbers."""
    numbers: tuple[Number, ...]

    def raster(self, number: int, *, dpi: float) -> Page:
        """Rasterise the page."""
        pixel_mm = MM_PER_INCH / dpi
        cmyk = np.zeros((round(PAGE_MM[1] / pixel_mm), round(PAGE_MM[0] / pixel_mm), 4), np.uint8)
        leading_mm = self.points * LEADING * POINT_MM
        if self.tint is not None:
            for top_mm in np.arange(MARGIN_MM, PAGE_MM[1] - MARGIN_MM - leading_mm, 2 * leading_mm):
                rows = slice(*(round(y / pixel_mm) for y in (top_mm, top_mm + leading_mm)))
                across = slice(round((MARGIN_MM - 2) / pixel_mm), -round((MARGIN_MM - 2) / pixel_mm))
                cmyk[rows, across] = self.tint
        for of, left in ((self.items, True), (self.numbers, False)):
            for one in of:
                self._set(cmyk, one, pixel_mm, left=left)
        return Page(cmyk=cmyk, dpi=dpi, name=f"p{number:04d}", number=number)

    def _set(self, cmyk: NDArray[np.uint8], one: Number, pixel_mm: float, *, left: bool) -> None:
        size_px = self.points * POINT_MM / pixel_mm
        pen = one.right_mm / pixel_mm
        if not left:
            pen -= sum(advance(self.face, letter) for letter in one.text) * size_px
        for letter in one.text:
            if letter != " ":
                mask, x, y = inked(self.face, letter, size_px, pen, one.baseline_mm / pixel_mm)
                cmyk[y : y + mask.shape[0], x : x + mask.shape[1]][mask] = self.ink
            pen += advance(self.face, letter) * size_px


def text_sheet(points: int, *, rng: np.random.Generator) -> TextSheet:
    """Draw a sheet with rows of a word and three numbers."""
    leading_mm = points * LEADING * POINT_MM
    items, numbers = [], []
    for baseline_mm in np.arange(MARGIN_MM + 0.75 * leading_mm, PAGE_MM[1] - MARGIN_MM, leading_mm):
        baseline = float(baseline_mm)
        items.append(Number(text=str(rng.choice(ITEMS)), right_mm=COLUMNS_MM[0], baseline_mm=baseline))
        for column, right_mm in enumerate(COLUMNS_MM[1:]):
            if rng.random() < 0.85:
                numbers.append(Number(text=_number(column, rng), right_mm=right_mm, baseline_mm=baseline))
    return TextSheet(
        points=points,
        face=str(rng.choice(FACES)),
        ink=BLACK if rng.random() < 0.5 else COLOURS[int(rng.integers(len(COLOURS)))],
        tint=None if rng.random() < 0.5 else TINTS[int(rng.integers(len(TINTS)))],
        items=tuple(items),
        numbers=tuple(numbers),
    )


def with_wrong_digit(sheet: TextSheet, wrong: str, *, rng: np.random.Generator) -> TextSheet:
    """Return the sheet with one number of at least four digits wrong; wrong: one of ``WRONGS``."""
    able = [at for at, one in enumerate(sheet.numbers) if _places(one.text, wrong)]
    at = int(rng.choice(able))
    text = sheet.numbers[at].text
    place = int(rng.choice(_places(text, wrong)))
    if wrong == "swapped":
        changed = text[:place] + text[place + 1] + text[place] + text[place + 2 :]
    elif wrong == "dropped":
        changed = text[:place] + "\N{FIGURE SPACE}" + text[place + 1 :]
    else:
        others = [digit for digit in "0123456789" if digit != text[place]]
        changed = text[:place] + str(rng.choice(others)) + text[place + 1 :]
    numbers = list(sheet.numbers)
    numbers[at] = replace(numbers[at], text=changed)
    return replace(sheet, numbers=tuple(numbers))


def _places(text: str, wrong: str) -> list[int]:
    """Return the positions at which a number can have this error."""
    digits = [at for at, letter in enumerate(text) if letter.isdigit()]
    if len(digits) < LEAST_DIGITS:
        return []
    if wrong == "swapped":
        return [at for at in digits if at + 1 in digits and text[at] != text[at + 1]]
    return digits


def _number(column: int, rng: np.random.Generator) -> str:
    if column == 0:
        return "".join(str(digit) for digit in rng.integers(0, 10, int(rng.integers(5, 9))))
    if column == 1:
        return str(int(rng.integers(1, 1000)))
    return f"{float(rng.integers(100, 10**7)) / 100:,.2f}"


@lru_cache(maxsize=8)
def _file(face: str) -> bytes:
    if len(face) == len("helv"):
        import pymupdf  # imported late: an extra

        return bytes(pymupdf.Font(face).buffer)
    from pathlib import Path

    import matplotlib as mpl

    return (Path(mpl.get_data_path()) / "fonts" / "ttf" / f"{face}.ttf").read_bytes()


@lru_cache(maxsize=64)
def _font(face: str, size_px: float) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(io.BytesIO(_file(face)), size_px, layout_engine=ImageFont.Layout.BASIC)


@lru_cache(maxsize=4096)
def advance(face: str, letter: str) -> float:
    """Return the advance width of a letter. [em]"""
    letter = "0" if letter == "\N{FIGURE SPACE}" else letter
    return float(_font(face, 2048).getlength(letter)) / 2048


@lru_cache(maxsize=4096)
def _outline(face: str, letter: str, size_px: float) -> tuple[NDArray[np.bool_], int, int]:
    """Return a letter ``FINE`` times as large, and its corner relative to the pen."""
    font = _font(face, size_px * FINE)
    left, top, right, bottom = (round(edge) for edge in font.getbbox(letter, anchor="ls"))
    picture = Image.new("1", (max(right - left, 1) + 2, max(bottom - top, 1) + 2))
    ImageDraw.Draw(picture).text((1 - left, 1 - top), letter, fill=1, font=font, anchor="ls")
    return np.asarray(picture), left - 1, top - 1


def inked(
    face: str, letter: str, size_px: float, pen_px: float, baseline_px: float
) -> tuple[NDArray[np.bool_], int, int]:
    """Return the raster pixels of a letter and the column and row of its corner."""
    if letter == "\N{FIGURE SPACE}":
        return np.zeros((0, 0), np.bool_), 0, 0
    fine, left, top = _outline(face, letter, size_px)
    x, y = round(pen_px * FINE) + left, round(baseline_px * FINE) + top
    before = y % FINE, x % FINE
    after = [-(size + first) % FINE for size, first in zip(fine.shape, before, strict=True)]
    padded = np.pad(fine, tuple(zip(before, after, strict=True)))
    return padded[FINE // 2 :: FINE, FINE // 2 :: FINE], x // FINE, y // FINE
