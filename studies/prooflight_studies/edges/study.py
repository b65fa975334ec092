"""Accuracy of the prediction where it matters most and is hardest: at the edges of letters and thin lines.

The truth is the exact camera (``exact.exposure``) without noise, on a raster much finer than any that prediction uses,
and once more on the same raster as the prediction; the prediction is the one that presses use.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Final

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from prooflight.commissioning.build import SUPERSAMPLING
from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.raster import MM_PER_INCH, POINTS_PER_INCH
from prooflight.press.press_file import PressFile
from prooflight_studies.edges.rig import (
    BAND_CENTRES,
    BAND_MM,
    EDGE_CONTRAST,
    Rig,
    Sheet,
    averaged,
    in_columns,
    predicted,
    sampled,
    truth,
    with_round_footprint,
)
from prooflight_studies.harness.page import write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight_studies.edges.rig import Band

TRUTH: Final = 8
"""Raster pixels across a camera pixel in the truth."""
FINER_TRUTH: Final = 16
"""Raster pixels in the reference of the truth itself, on a strip of one page."""
FINER_BAND_MM: Final = 10.0
SUPERSAMPLINGS: Final = (1, 2, 3, 4)
"""Supersampling factors of whole pages, ripped and predicted as by a press."""
AVERAGED_TO: Final = (4, 2)
STRATA: Final = ("dense text", "line art/tables")
PAGES_A_STRATUM: Final = 5
MOST_PICTURE: Final = 0.01
"""Greatest share of a chosen page that images may cover."""
FEWEST_LETTERS: Final = 100
WIDEST_MM: Final = 215.95
"""Greatest page width that fits the prototype's field; letter paper (215.9 mm) just does."""
MANIFEST_FILES: Final = GivenFiles(
    error=RequestError, remedy="give the manifest of the pages, a JSON list", largest_mb=8
)


GOAL_SIGMA: Final = 0.5
_LOG_BINS: Final = np.linspace(
    -4.0, 4.0, 1601
)  # of |z|: half a per cent a bin is finer than any figure shown


@dataclass(slots=True, kw_only=True)
class ErrorSum:
    """Errors of one method of prediction, accumulated over pages."""

    name: str
    edge_pixels: int = 0
    pixels: int = 0
    _edge_squares: float = 0.0
    _squares: float = 0.0
    _histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(_LOG_BINS.size - 1, np.int64))
    _normal: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, 2)))
    _right: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    rip_cpu_s: list[float] = field(default_factory=list)
    predict_cpu_s: list[float] = field(default_factory=list)

    def add(self, predicted_dn: NDArray[np.floating], true: Band) -> None:
        """Add the lines of a band, (lines, pixels) [DN]."""
        edges, sigma_dn = true.edges, true.sigma_dn
        z = (predicted_dn - true.mean_dn) / sigma_dn
        at_edges = z[edges]
        self.edge_pixels += at_edges.size
        self.pixels += z.size
        self._edge_squares += float((at_edges**2).sum())
        self._squares += float((z**2).sum())
        magnitude = np.log10(np.abs(at_edges).clip(1.01e-4, 0.99e4))
        self._histogram += np.histogram(magnitude, _LOG_BINS)[0]
        along, across = np.gradient(true.mean_dn, axis=0), np.gradient(true.mean_dn, axis=1)
        slope = np.stack([across[edges], along[edges]]) / sigma_dn[edges]
        self._normal += slope @ slope.T
        self._right += slope @ at_edges

    def row(self) -> ErrorRow:
        """Return the figures; needs edge pixels."""
        # A pattern that lies too far right by m is too dark or too light by -m times the slope.
        fitted = np.linalg.lstsq(self._normal, self._right, rcond=None)[0]
        left = max(self._edge_squares - float(fitted @ self._right), 0.0)
        middle = int(np.searchsorted(self._histogram.cumsum(), self.edge_pixels / 2))
        return ErrorRow(
            name=self.name,
            edge_rms_sigma=float(np.sqrt(self._edge_squares / self.edge_pixels)),
            edge_median_sigma=float(10 ** _LOG_BINS[middle]),
            shifted_edge_rms_sigma=float(np.sqrt(left / self.edge_pixels)),
            all_rms_sigma=float(np.sqrt(self._squares / self.pixels)),
            right_pixels=float(-fitted[0]),
            down_pixels=float(-fitted[1]),
            edge_pixels=self.edge_pixels,
            rip_cpu_s=float(np.median(self.rip_cpu_s)) if self.rip_cpu_s else None,
            predict_cpu_s=float(np.median(self.predict_cpu_s)) if self.predict_cpu_s else None,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorRow:
    """Errors of one method of prediction, over all pages, in units of the temporal sigma."""

    name: str
    edge_rms_sigma: float
    edge_median_sigma: float
    """Median magnitude of the error at edge pixels."""
    shifted_edge_rms_sigma: float
    """Rms after the best constant shift, the same on every page."""
    all_rms_sigma: float
    right_pixels: float
    down_pixels: float
    """Displacement of the prediction to the right and down relative to the truth. [camera pixels]"""
    edge_pixels: int
    rip_cpu_s: float | None
    predict_cpu_s: float | None
    """CPU time of a page, the median over pages; None: not timed. [s]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeStudy:
    """All results that the page shows."""

    pages: tuple[str, ...]
    criterion: str
    method: str
    from_vector: tuple[ErrorRow, ...]
    truth_itself: ErrorRow
    same_raster: tuple[ErrorRow, ...]
    goal_sigma: float = GOAL_SIGMA
    supersampling: int = SUPERSAMPLING
    """Default supersampling, at which the goal is to be met."""


class ManifestEntry(BaseModel):
    """Properties of a page in the manifest that its choice needs; others are ignored."""

    id: Annotated[str, Field(pattern=r"^[\w-]{1,100}$")]
    strata: list[str]
    chars: int
    img_frac: Annotated[float, Field(ge=0, le=1e6)]
    w_pt: Annotated[float, Field(gt=0, le=1e6)]


def run_edge_study(
    pages: Path,
    results: Path,
    *,
    quick: bool = False,
    progress: Callable[[str], None] = lambda _step: None,
    rig: Rig | None = None,
    pdfs: Sequence[Path] | None = None,
) -> EdgeStudy:
    """Study pages of a folder with a manifest next to it, or the given PDFs; write ``edges.md`` into ``results``.

    quick: one page of each stratum. rig: the prototype's if absent. RequestError: a page cannot be used.
    """
    chosen = list(pdfs) if pdfs else choose_pages(pages, 1 if quick else PAGES_A_STRATUM)
    if rig is None:
        progress("building the press")
        rig = Rig.build(PressFile.prototype())
    sums: dict[str, ErrorSum] = {}
    for pdf in chosen:
        progress(f"{pdf.stem} ({chosen.index(pdf) + 1} of {len(chosen)})")
        _study_page(rig, Sheet.lay(rig, pdf), sums)
    progress("the truth itself")
    itself = _truth_itself(rig, Sheet.lay(rig, chosen[0], band_mm=FINER_BAND_MM))
    rows = {name: gathered.row() for name, gathered in sums.items()}
    study = EdgeStudy(
        pages=tuple(pdf.stem for pdf in chosen),
        criterion=_criterion() if not pdfs else "",
        method=_method(),
        from_vector=tuple(row for name, row in rows.items() if name.startswith("v")),
        truth_itself=itself,
        same_raster=tuple(row for name, row in rows.items() if name.startswith("r")),
    )
    write_page(results / "edges.md", "edges", study)
    return study


def _study_page(rig: Rig, sheet: Sheet, sums: dict[str, ErrorSum]) -> None:
    def gather(key: str, name: str) -> ErrorSum:
        return sums.setdefault(key, ErrorSum(name=name))

    fine = [(band, *sheet.part(rig, band, TRUTH)) for band in sheet.bands]
    true = [truth(rig, sheet, page, band, top_mm=top_mm) for band, page, top_mm in fine]
    with PdfJob(sheet.pdf) as job:
        for s in SUPERSAMPLINGS:
            started = time.process_time()
            page = job.page(1, rig.press.geometry.raster_dpi(s))
            ripped = time.process_time()
            signal = predicted(rig, sheet, page)
            done = time.process_time()
            short = predicted(rig, sheet, page, corrected=False)
            short_done = time.process_time()
            rounded = with_round_footprint(rig, short)
            round_done = time.process_time()
            vector = gather(f"v{s}", f"s = {s}")
            vector.rip_cpu_s.append(ripped - started)
            vector.predict_cpu_s.append(done - ripped)
            ours, short_, round_ = (
                gather(f"r{s}{way}", f"s = {s}{way}") for way in ("", ", short footprint alone", ", FFT")
            )
            ours.predict_cpu_s.append(done - ripped)
            short_.predict_cpu_s.append(short_done - done)
            round_.predict_cpu_s.append(round_done - done)
            for band, of_vector in zip(sheet.bands, true, strict=True):
                vector.add(in_columns(rig, signal)[band], of_vector)
                own = truth(rig, sheet, page, band)
                ours.add(in_columns(rig, signal)[band], own)
                short_.add(in_columns(rig, short)[band], own)
                round_.add(in_columns(rig, rounded)[band], own)
    for (band, page, top_mm), of_vector in zip(fine, true, strict=True):
        signal = predicted(rig, sheet, page, top_mm=top_mm)
        gather(f"v{TRUTH}", f"s = {TRUTH}, the truth's own raster").add(
            in_columns(rig, signal)[band], of_vector
        )
        gather(f"r{TRUTH}", f"s = {TRUTH}").add(in_columns(rig, signal)[band], of_vector)
        short = predicted(rig, sheet, page, top_mm=top_mm, corrected=False)
        gather(f"r{TRUTH}, FFT", f"s = {TRUTH}, FFT").add(
            in_columns(rig, with_round_footprint(rig, short))[band], of_vector
        )
        for s in AVERAGED_TO:
            blocks = TRUTH // s
            small = averaged(rig, page, blocks)
            seen = sampled(rig, sheet, small, raster_pixel_mm=blocks * page.pixel_mm, top_mm=top_mm)
            gather(f"v{TRUTH}-{s}", f"s = {TRUTH}, signals averaged to {s}").add(
                in_columns(rig, seen)[band], of_vector
            )


def _truth_itself(rig: Rig, sheet: Sheet) -> ErrorRow:
    gathered = ErrorSum(name=f"truth at {TRUTH}, a strip of {sheet.pdf.stem}")
    band = sheet.bands[len(sheet.bands) // 2]
    seen = []
    for s in (TRUTH, FINER_TRUTH):
        page, top_mm = sheet.part(rig, band, s)
        seen.append(truth(rig, sheet, page, band, top_mm=top_mm))
    gathered.add(seen[0].mean_dn, seen[1])
    return gathered.row()


def choose_pages(folder: Path, a_stratum: int = PAGES_A_STRATUM) -> list[Path]:
    """Return the first pages of each stratum of the manifest that fit and have text and few pictures.

    The manifest is next to ``folder``.
    """
    manifest = folder.resolve().parent / "pages_manifest.json"
    if not manifest.is_file():
        raise RequestError(manifest, "is not there", remedy="give the folder of pages next to it")
    entries = read_manifest(manifest)
    chosen = []
    for stratum in STRATA:
        fitting = [
            folder / f"{entry.id}.pdf"
            for entry in entries
            if entry.strata == [stratum]
            and entry.chars >= FEWEST_LETTERS
            and entry.img_frac <= MOST_PICTURE
            and entry.w_pt * MM_PER_INCH / POINTS_PER_INCH <= WIDEST_MM
        ]
        chosen += fitting[:a_stratum]
    return chosen


def read_manifest(path: Path) -> list[ManifestEntry]:
    """Read all pages of a manifest; RequestError: it is no JSON, or an entry lacks a property."""
    text = MANIFEST_FILES.read_text(path)
    try:
        return TypeAdapter(list[ManifestEntry]).validate_json(text)
    except ValidationError as error:
        fault = error.errors(include_input=False, include_url=False)[0]
        place = ".".join(str(part + 1) if isinstance(part, int) else part for part in fault["loc"])
        what = f"{place}: {fault['msg']}" if place else fault["msg"]
        raise RequestError(path, what, remedy=MANIFEST_FILES.remedy) from None


def _criterion() -> str:
    strata = " and ".join(f"*{stratum}*" for stratum in STRATA)
    return (
        f"The first {PAGES_A_STRATUM} (quick: 1) of the strata {strata} in the manifest's order, with at least"
        f" {FEWEST_LETTERS} letters, at most {MOST_PICTURE:.0%} images, and narrow enough for the field."
    )


def _method() -> str:
    bands = ", ".join(f"{centre:.0%}" for centre in BAND_CENTRES)
    return (
        f"The truth is `page_electrons` (36 bands, each its own round diffraction) on the page ripped from vector at"
        f" {TRUTH} raster pixels per camera pixel, in {len(BAND_CENTRES)} bands {BAND_MM:g} mm high about {bands} of"
        f" the page's height, as wide as the field. Up to s = {SUPERSAMPLINGS[-1]} whole pages are ripped and predicted"
        " as by a press, with the left edges of truth and predicted raster aligned. A pixel is at an edge where"
        f" the truth varies by more than {EDGE_CONTRAST:.0%} of white in its 3 x 3 neighbourhood."
    )
