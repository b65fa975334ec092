"""Who prints what ISO 32000 says: our RIP and Ghostscript on pages whose ink the specification fixes."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import tifffile
from scipy import ndimage

from prooflight.cmyk import INKS
from prooflight.errors import InputError, RequestError
from prooflight.pages.pdf.engine import RipEngine
from prooflight.pages.pdf.rip import PdfJob
from prooflight_studies.harness.page import write_page
from prooflight_studies.rip.cases import CASES, case_pdf
from prooflight_studies.rip.handed import HandedRow, handed_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

TOLERANCE: Final = 2
"""Steps of 255 by which inks may differ from the specification's: opacity has eight bits in both."""
DPI: Final = 72
MIDDLE: Final = 50
SECONDS_MAX: Final = 60.0
PROFILE: Final = "share/color/icc/ghostscript/default_cmyk.icc"
"""Beside the program: by this, colours that are no ink become ink in handed cases and public pages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One case: inks C, M, Y, K of 255 by the specification and by each RIP; empty: the page was refused."""

    name: str
    clause: str
    right: tuple[int, ...]
    ours: tuple[int, ...]
    ghostscript: tuple[int, ...]
    ours_right: bool
    ghostscript_right: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RipStudy:
    """Figures of the page."""

    ghostscript_version: str
    tolerance: int
    rows: tuple[Row, ...]
    ours_right: int
    ghostscript_right: int
    handed: tuple[HandedRow, ...]
    """Rows of a folder of PDFs that were once printed wrong; empty: none was given."""
    pages: tuple[PageRow, ...]
    """Rows of a folder of public pages; empty: none was given."""
    pages_dpi: float
    beyond: int
    even: int


def run_rip_study(
    out: Path,
    *,
    cases: Path | None = None,
    pages: Path | None = None,
    most: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> RipStudy:
    """Draw every case by both, or the first ``most``, and write ``rip.md``.

    cases: a folder of handed cases. pages: a folder of PDFs whose first pages both draw. RequestError: there is no
    Ghostscript, or nothing in such a folder.
    """
    program = shutil.which("gs")
    if program is None:
        raise RequestError(
            "gs", "Ghostscript is not installed", remedy="install it, as by apt-get install ghostscript"
        )
    version = subprocess.run(
        [program, "--version"], capture_output=True, text=True, check=True
    ).stdout.strip()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES[:most]:
            progress(case.name)
            pdf = Path(folder) / "case.pdf"
            pdf.write_bytes(case_pdf(case))
            ours, theirs = middle_of_prooflight(pdf), middle_of_ghostscript(program, pdf)
            rows.append(
                Row(
                    name=case.name,
                    clause=case.clause,
                    right=case.inks,
                    ours=ours,
                    ghostscript=theirs,
                    ours_right=is_right(ours, case.inks),
                    ghostscript_right=is_right(theirs, case.inks),
                )
            )
    profile = Path(program).resolve().parents[1] / PROFILE
    usable_profile = profile if profile.is_file() else None
    handed = () if cases is None else handed_rows(cases, usable_profile, progress)
    public = [] if pages is None else sorted(pages.glob("*.pdf"))[:most]
    if pages is not None and not public:
        raise RequestError(pages, "there is no PDF", remedy="give a folder of PDFs")
    drawn = []
    for path in public:
        progress(path.stem)
        drawn.append(page_row(path, usable_profile))
    results = RipStudy(
        ghostscript_version=version,
        tolerance=TOLERANCE,
        rows=tuple(rows),
        ours_right=sum(row.ours_right for row in rows),
        ghostscript_right=sum(row.ghostscript_right for row in rows),
        handed=handed,
        pages=tuple(drawn),
        pages_dpi=PAGES_DPI,
        beyond=BEYOND,
        even=EVEN,
    )
    write_page(out / "rip.md", "rip", results)
    return results


def is_right(inks: tuple[int, ...], right: tuple[int, ...]) -> bool:
    """Return whether inks are the specification's, within ``TOLERANCE``."""
    return len(inks) == len(right) and all(abs(a - b) <= TOLERANCE for a, b in zip(inks, right, strict=True))


def middle_of_prooflight(pdf: Path) -> tuple[int, ...]:
    """Return the ink in the middle of the first page; empty if it is refused."""
    try:
        with PdfJob(pdf) as job:
            return tuple(job.page(1, DPI).cmyk[MIDDLE, MIDDLE].tolist())
    except InputError:
        return ()


def middle_of_ghostscript(program: str, pdf: Path) -> tuple[int, ...]:
    """Return the same by Ghostscript's ``tiff32nc``, overprint simulated."""
    picture = pdf.with_suffix(".tif")
    picture.unlink(missing_ok=True)
    options = (
        "-q",
        "-dBATCH",
        "-dNOPAUSE",
        "-dSAFER",
        f"-r{DPI}",
        "-sDEVICE=tiff32nc",
        "-dOverprint=/simulate",
    )
    command = [program, *options, "-dUseTrimBox", "-dPrinted=true", f"-sOutputFile={picture}", str(pdf)]
    done = subprocess.run(command, capture_output=True, timeout=SECONDS_MAX, check=False)
    if done.returncode or not picture.is_file():
        return ()
    raster = np.asarray(tifffile.imread(picture))
    if raster.ndim != 3 or min(raster.shape[:2]) <= MIDDLE:
        return ()
    return tuple(raster[MIDDLE, MIDDLE].tolist())


# --- public pages by both engines: how much ink differs, where no edge is near ---

PAGES_DPI: Final = 100.0
BEYOND: Final = 8
"""Steps of 255 beyond which a pixel differs: 3 % of ink, what profiles and two decoders leave."""
EVEN: Final = 3
"""Where no ink of either drawing varies by more over 5 x 5 pixels, no edge is near. [of 255]"""
REMARKS: Final = {
    "d000": "DeviceRGB stands for the RGB profile of the page's own output intent, which Ghostscript does not read",
    "d009": "its image has fewer rows than it states: ours prints them as 0, which is black, and says so",
    "d020": "of eight like inline images Ghostscript draws two wrong and four not at all",
    "d025": "the colours of a small JPEG are enlarged otherwise by the two decoders, as both may",
}
"""Why pages differ, by their files and by pictures of both drawings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageRow:
    """One page by both engines; empty tuples: one of them refuses it."""

    page: str
    differ_percent: tuple[float, ...]
    """Share of pixels that differ by more than ``BEYOND``, in C, M, Y and K."""
    even_differ_percent: float
    """The same in any ink, of the pixels with no edge near."""
    largest_even: tuple[int, ...]
    """The largest difference with no edge near, in C, M, Y and K. [of 255]"""
    refused: str
    """The engines that refuse it, and why; empty: none does."""
    warnings: int
    """How many our engine gives."""
    remark: str


def page_row(path: Path, profile: Path | None) -> PageRow:
    """Draw the first page of a PDF by both engines, colours that are no ink by one profile, and compare."""
    drawn: list[NDArray[np.uint8]] = []
    refused, warnings = [], 0
    for name in ("mupdf", "ghostscript"):
        try:
            with PdfJob(path, profile=profile, engine=RipEngine(name=name)) as job:
                page = job.page(1, PAGES_DPI)
        except InputError as error:
            refused.append(f"{name}: {error.what}")
            continue
        drawn.append(page.cmyk)
        warnings += len(page.warnings) if name == "mupdf" else 0
    if refused:
        differ: tuple[tuple[float, ...], float, tuple[int, ...]] = ((), 0.0, ())
    else:
        differ = difference(*drawn)
    return PageRow(
        page=path.stem,
        differ_percent=differ[0],
        even_differ_percent=differ[1],
        largest_even=differ[2],
        refused="; ".join(refused),
        warnings=warnings,
        remark=REMARKS.get(path.stem, ""),
    )


def difference(
    own: NDArray[np.uint8], theirs: NDArray[np.uint8]
) -> tuple[tuple[float, ...], float, tuple[int, ...]]:
    """Compare two drawings (rows, columns, 4): ``differ_percent``, ``even_differ_percent`` and ``largest_even``."""
    difference = np.maximum(own, theirs) - np.minimum(own, theirs)
    even = np.maximum(_variation(own), _variation(theirs)) <= EVEN
    inside = difference[even]
    return (
        tuple(float(100 * (difference[..., ink] > BEYOND).mean()) for ink in range(INKS)),
        float(100 * (inside > BEYOND).any(axis=1).mean()) if inside.size else 0.0,
        tuple(int(inside[:, ink].max(initial=0)) for ink in range(INKS)),
    )


def _variation(cmyk: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The largest variation of an ink over 5 x 5 pixels, (rows, columns)."""
    size = (5, 5, 1)
    spread: NDArray[np.uint8] = ndimage.maximum_filter(cmyk, size) - ndimage.minimum_filter(cmyk, size)
    return spread.max(axis=2)
