"""Prints of presses that rip a PDF themselves, each judged under what the press file states of its RIP."""

from __future__ import annotations

import subprocess
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from prooflight.commissioning.rip_identification import identified_from_rasters
from prooflight.errors import InputError, JobError, RequestError
from prooflight.files.atomic import whole_file
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.job import for_learning
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.pdf.rip_model import UNSTATED, RipModel
from prooflight.pages.screen import Screen, screened
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source
from prooflight.rng import stream
from prooflight.simulation.halftone import averaged, dot_gain_factor
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import Amounts, amounts_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.base import Inspection
    from prooflight.inspection.inspector import Prepared
    from prooflight.pages.job import JobSource
    from prooflight.pages.raster import Page
    from prooflight_studies.harness.result_cache import Rows

COPIES_A_PIECE: Final = 4
"""Good prints of a page that are computed at once, with one misprint; more are further pieces."""
PAGES_A_DAY: Final = 4
"""Pages of a press day; each copy of a page is of another day."""
SECONDS_MAX: Final = 300.0
OTHER_PAGES: Final = ("wrong-page",)
"""Kinds that need another page; each job here has only one."""
STATEMENTS: Final = ("nothing", "stated", "identified")
"""What the press file says of the press's RIP.

``stated``: its engine, resolution and screen, so that the same engine draws the expected page. ``identified``: its
resolution and screen, and what ``press rip-model`` finds in rasters of other pages; MuPDF draws in its place.
"""
IDENTIFIED_FROM: Final = 3
"""Number of pages of development whose rasters identify a RIP."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnRip:
    """RIP of a press, which draws the PDF itself."""

    name: str
    title: str
    dpi: float
    engine: str = "ghostscript"
    screen: Screen | None = None
    """None: continuous tone."""


OUR_RASTER: Final = "own"
RIPS: Final = (
    OwnRip(name=OUR_RASTER, title="our own raster", dpi=0.0, engine=""),
    OwnRip(name="contone-1200", title="Ghostscript, 1200 dpi, continuous tone", dpi=1200.0),
    OwnRip(
        name="am-1200",
        title="Ghostscript, 1200 dpi, 1-bit AM screens, 175 lpi, C15 M75 Y0 K45",
        dpi=1200.0,
        screen=Screen(kind="am", dpi=1200.0, lpi=175.0),
    ),
    OwnRip(
        name="diffusion-1200",
        title="Ghostscript, 1200 dpi, 1-bit error diffusion",
        dpi=1200.0,
        screen=Screen(kind="error-diffusion", dpi=1200.0),
    ),
    OwnRip(name="contone-600", title="Ghostscript, 600 dpi, continuous tone", dpi=600.0),
)
"""Presses in such an order that those of one resolution share its raster."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintPiece:
    """Copies of one page by one RIP in one world."""

    page: str
    number: int
    """Number of the page, from which days, prints and kinds of misprints are drawn."""
    rip: str
    world: str
    good: tuple[int, ...]
    """Copies that are good, each of another day."""
    misprints: tuple[int, ...]
    """Copies that are misprints, on the days of the first good ones."""
    judged: bool
    """Whether its prints are judged; others are learned, on days of their own."""
    statements: tuple[str, ...] = STATEMENTS
    """What the press file states where the press rips (``STATEMENTS``), each judged on the same prints."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PrintWork:
    """Print and inspect the copies of a piece; a row for each print and statement.

    Columns: page, rip, world, judged, copy, statement, kind ("" where good), severity, alarm, uninspected, p_value, and
    what a press learns from: score, values, features, another, glyphs, floor_mm2.
    """

    press: Path
    pages: Path
    folder: Path
    """Where PDFs are kept after their colours have been converted."""
    seed: int

    def __call__(self, piece: PrintPiece, /) -> Rows:
        """Return the rows of a piece."""
        rip = rip_of(piece.rip)
        press = _press(self.press)
        pdf = device_cmyk(self.pages / f"{piece.page}.pdf", self.folder)
        identified = self._model(rip) if "identified" in piece.statements else UNSTATED
        printed = _printed(pdf, self.press, rip)
        ready = {
            name: _ready(pdf, self.press, rip, name, identified)
            for name in statements(press, rip, identified)
            if name in piece.statements or rip.name == OUR_RASTER
        }
        columns: dict[str, list[Any]] = defaultdict(list)
        for copy in sorted({*piece.good, *piece.misprints}):
            session = self._session(press, piece, rip, copy)
            for request in self._requests(piece, copy):
                kind = "" if request is None else request.kind
                # The same day, print and misprint in every row, so that rows compare. A print takes more draws in one
                # world than in the other, and so the misprint is drawn by itself.
                rng, misprint_rng = (
                    stream(self.seed, "rip-print", int(piece.judged), piece.number, copy, part)
                    for part in (int(bool(kind)), 2)
                )
                try:
                    scan = scan_page(
                        printed,
                        press=press,
                        request=request,
                        others=(),
                        fetch=_none,
                        rng=rng,
                        session=session,
                        misprint_rng=misprint_rng,
                    )
                except RequestError:
                    continue  # nothing of that kind can be seen on this page
                for name, (inspector, prepared) in ready.items():
                    row = _row(inspector.inspect(prepared, scan.dn))
                    severity = 0.0 if scan.misprint is None else scan.misprint.severity
                    facts = {
                        "page": piece.page,
                        "rip": piece.rip,
                        "world": piece.world,
                        "judged": piece.judged,
                    }
                    facts |= {"copy": copy, "statement": name, "kind": kind, "severity": severity}
                    for column, value in (facts | row).items():
                        columns[column].append(value)
        labels = {"page", "rip", "world", "statement", "kind"}
        return {
            name: np.array(values, "U32") if name in labels else np.array(values)
            for name, values in columns.items()
        }

    def _model(self, rip: OwnRip) -> RipModel:
        """Return what is identified of a RIP from the first pages of development that were converted."""
        if rip.name == OUR_RASTER:
            return UNSTATED
        names = sorted(path.name for path in self.folder.glob("*.pdf") if even(path.stem))
        return _identified(tuple(self.folder / name for name in names[:IDENTIFIED_FROM]), rip.engine, rip.dpi)

    def _session(self, press: Press, piece: PrintPiece, rip: OwnRip, copy: int) -> Session:
        day = piece.number // PAGES_A_DAY
        rng = stream(self.seed, "rip-day", int(piece.judged), day, copy)
        session = Session.draw(_amounts(press, piece.world), press, rng)
        # The row says how pages are screened, in every world.
        dots = 1.0 if rip.screen is None else dot_gain_factor(rip.screen, press.ink_light)
        return replace(session, screen=None, dots=dots)

    def _requests(self, piece: PrintPiece, copy: int) -> list[MisprintRequest | None]:
        requests: list[MisprintRequest | None] = [None] if copy in piece.good else []
        if copy in piece.misprints:
            kinds = [kind for kind in KINDS if kind not in OTHER_PAGES]
            requests.append(MisprintRequest(kind=kinds[(piece.number + copy * 5) % len(kinds)]))
        return requests


def rip_of(name: str) -> OwnRip:
    """Return the RIP of a name."""
    (rip,) = (one for one in RIPS if one.name == name)
    return rip


def statements(press: Press, rip: OwnRip, identified: RipModel) -> dict[str, Press]:
    """Return the press under each statement about its RIP (``STATEMENTS``); its training stays."""
    if rip.name == OUR_RASTER:
        return {"nothing": press}
    stated = replace(press, rip_dpi=rip.dpi, screen=rip.screen)
    engine = RipEngine(name=rip.engine)  # type: ignore[arg-type]
    return {
        "nothing": press,
        "stated": replace(stated, rip_engine=engine),
        "identified": replace(stated, rip_model=identified),
    }


def even(page: str) -> bool:
    """Return whether a page, named by its number, is of development."""
    return int("".join(letter for letter in page if letter.isdecimal()) or "1") % 2 == 0


@lru_cache(maxsize=4)
def _identified(pdfs: tuple[Path, ...], engine: str, dpi: float) -> RipModel:
    """Return the model that the engine's rasters of the first pages of these PDFs identify."""
    rasters = []
    for pdf in pdfs:
        with PdfJob(pdf, engine=RipEngine(name=engine)) as job:  # type: ignore[arg-type]
            rasters.append(job.page(1, dpi).cmyk)

    def drawn(model: RipModel) -> list[NDArray[np.uint8]]:
        pages = []
        for pdf in pdfs:
            with PdfJob(pdf) as job:
                pages.append(job.page(1, dpi, drawn_dpi=dpi, rip=model).cmyk)
        return pages

    return identified_from_rasters(rasters, drawn, dpi=dpi).model


def as_printed(pdf: Path, press: Press, rip: OwnRip) -> Page:
    """Return the first page of a PDF as a press prints it, in its place; errors as ``PdfJob`` and ``lay``."""
    if rip.name == OUR_RASTER:
        return _expected(pdf, press)
    light = press.ink_light
    page = _of_engine(pdf, rip.engine, rip.dpi)
    plates = page.cmyk
    if rip.screen is not None:
        plates = screened(plates, rip.screen, tone=light)
    cmyk, dpi = averaged(plates, rip.dpi, light)
    return press.geometry.lay(replace(page, cmyk=cmyk, dpi=dpi))


@lru_cache(maxsize=1)
def _of_engine(pdf: Path, engine: str, dpi: float) -> Page:
    """Return the first page in device pixels, which continuous tone and every screen share."""
    with PdfJob(pdf, engine=RipEngine(name=engine)) as job:  # type: ignore[arg-type]
        return job.page(1, dpi)


@lru_cache(maxsize=1)
def _printed(pdf: Path, press: Path, rip: OwnRip) -> Page:
    """Return ``as_printed``, which all worlds and copies share."""
    return as_printed(pdf, _press(press), rip)


@lru_cache(maxsize=len(STATEMENTS))
def _ready(
    pdf: Path, press: Path, rip: OwnRip, name: str, identified: RipModel
) -> tuple[Inspector, Prepared]:
    """Return the inspector of a press under a statement, and the page prepared by it, which all worlds share."""
    inspector = _inspector(press, rip, name, identified)
    return inspector, inspector.prepare(_expected(pdf, inspector.press))


def _expected(pdf: Path, press: Press) -> Page:
    return press.geometry.lay(_drawn(job_source(pdf, press)))


@lru_cache(maxsize=2)
def _drawn(source: JobSource) -> Page:
    """Return the first page of a job, which presses that differ by their screens share."""
    with source.open() as job:
        return job.page(1)


def device_cmyk(pdf: Path, folder: Path) -> Path:
    """Return a copy of a PDF whose colours are DeviceCMYK, so that no two engines convert them otherwise.

    JobError: Ghostscript fails on it.
    """
    path = folder / pdf.name
    if path.exists():
        return path
    with whole_file(path) as unfinished:
        command = [
            "gs",
            "-q",
            "-dSAFER",
            "-dBATCH",
            "-dNOPAUSE",
            "-sDEVICE=pdfwrite",
            "-dAutoRotatePages=/None",
        ]
        command += ["-sColorConversionStrategy=CMYK", "-dProcessColorModel=/DeviceCMYK"]
        command += ["-dFirstPage=1", "-dLastPage=1", f"-sOutputFile={unfinished}", str(pdf)]
        done = subprocess.run(command, capture_output=True, timeout=SECONDS_MAX, check=False)
        if done.returncode or not unfinished.stat().st_size:
            raise JobError(pdf, "Ghostscript cannot convert its colours", remedy="leave the page out")
    return path


def fits(pdf: Path, press: Press, folder: Path) -> str:
    """Return why a page cannot be a row of this press; empty: it can."""
    try:
        converted = device_cmyk(pdf, folder)
        for engine in ("mupdf", "ghostscript"):
            with PdfJob(converted, engine=RipEngine(name=engine)) as job:
                press.geometry.lay(job.page(1, 50.0))
    except InputError as error:
        return error.what
    return ""


def _row(inspection: Inspection) -> dict[str, Any]:
    verdict, kept = inspection.verdict, inspection.stored_arrays
    return {
        "alarm": verdict.verdict == "misprint",
        "uninspected": verdict.verdict == "not-inspected",
        "p_value": 1.0 if verdict.p_value is None else verdict.p_value,
        "score": verdict.score or 0.0,
        "values": kept["values"],
        "features": kept["page_features"],
        "another": bool(kept["wrong_page"]),
        "glyphs": float(kept["glyphs"]),
        "floor_mm2": float(kept["floor_mm2"]),
    }


def _none(number: int) -> Page:
    raise RequestError(
        f"page {number}", "is not printed here", remedy="choose a kind that needs no other page"
    )


def _amounts(press: Press, world: str) -> Amounts:
    """Return the variation of prints in a world, whichever of the two worlds the press file states."""
    if world == "measured":
        return amounts_of(press, "measured")
    return Amounts.stated({name: value for name, value in press.variation.items() if name != "world"})


@lru_cache(maxsize=1)
def _press(path: Path) -> Press:
    return Press.load(path)


@lru_cache(maxsize=len(STATEMENTS) * len(RIPS))
def _inspector(press: Path, rip: OwnRip, name: str, identified: RipModel) -> Inspector:
    stated = statements(_press(press), rip, identified)[name]
    return for_learning(Inspector(stated)).with_threads(1)
