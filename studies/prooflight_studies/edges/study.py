"""How well a page is predicted where it matters and is hardest: at the edges of letters and thin lines.

The truth is the exact camera (``exact.exposure``) without noise, on a raster much finer than any that prediction
uses, and once more on the very raster that prediction is given; the prediction is the one that presses run.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Final

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from prooflight.errors import RequestError
from prooflight.files.given import GivenFiles
from prooflight.pages.pdf.rip import POINTS_PER_INCH, PdfJob
from prooflight.pages.raster import MM_PER_INCH
from prooflight.press.press_file import PressFile
from prooflight_studies.edges.page import EdgeStudy, ErrorRow, ErrorSum, write_edge_results
from prooflight_studies.edges.rig import (
    BAND_CENTRES,
    BAND_MM,
    EDGE_CONTRAST,
    Rig,
    Sheet,
    averaged,
    in_columns,
    made_round,
    predicted,
    sampled,
    truth,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

TRUTH: Final = 8
"""Raster pixels across a camera pixel in the truth."""
FINER_TRUTH: Final = 16
"""The same in what the truth itself is compared with, on a strip of one page."""
FINER_BAND_MM: Final = 10.0
SUPERSAMPLINGS: Final = (1, 2, 3, 4)
"""Of whole pages, ripped and predicted as a press does it."""
AVERAGED_TO: Final = (4, 2)
STRATA: Final = ("dense text", "line art/tables")
PAGES_A_STRATUM: Final = 5
MOST_PICTURE: Final = 0.01
"""Share of a chosen page that images may cover."""
FEWEST_LETTERS: Final = 100
WIDEST_MM: Final = 215.95
"""Of the prototype's field, letter paper (215.9 mm) just fits."""
MANIFEST_FILES: Final = GivenFiles(
    error=RequestError, remedy="give the manifest of the pages, a JSON list", largest_mb=8
)


class ManifestEntry(BaseModel):
    """What the choice of pages asks of one in the manifest; what else stands there is of no interest."""

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
    progress: Callable[[str], None] | None = None,
    rig: Rig | None = None,
    pdfs: Sequence[Path] | None = None,
) -> EdgeStudy:
    """Study pages of a folder with its manifest beside it, or the given PDFs; write ``edges.md`` into ``results``.

    quick: one page of each stratum. rig: the prototype's if absent. RequestError: a page cannot be used.
    """
    tell = progress or (lambda _: None)
    chosen = list(pdfs) if pdfs else choose_pages(pages, 1 if quick else PAGES_A_STRATUM)
    if rig is None:
        tell("building the press")
        rig = Rig.build(PressFile.prototype())
    sums: dict[str, ErrorSum] = {}
    for pdf in chosen:
        tell(f"{pdf.stem} ({chosen.index(pdf) + 1} of {len(chosen)})")
        _study_page(rig, Sheet.lay(rig, pdf), sums)
    tell("the truth itself")
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
    write_edge_results(results, study)
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
            rounded = made_round(rig, short)
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
            in_columns(rig, made_round(rig, short))[band], of_vector
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
    """The first pages of each stratum of the manifest beside ``folder`` that fit and have text and few pictures."""
    manifest = folder.resolve().parent / "pages_manifest.json"
    if not manifest.is_file():
        raise RequestError(manifest, "is not there", remedy="give the folder of pages that it lies beside")
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
    """All pages of a manifest; RequestError: it is no JSON, or an entry lacks what is asked of it."""
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
        f" {TRUTH} raster pixels a camera pixel, in {len(BAND_CENTRES)} bands {BAND_MM:g} mm high about {bands} of the"
        f" page's height, as wide as the field. Up to s = {SUPERSAMPLINGS[-1]} whole pages are ripped and predicted as"
        " a press does, with the truth's left edge laid where the predicted raster's is. A pixel is at an edge where"
        f" the truth spans more than {EDGE_CONTRAST:.0%} of white in its 3 x 3 neighbourhood."
    )
