"""How far the RIP agrees with Ghostscript's ``tiffsep``, page by page.

    python benchmarks/rip_against_ghostscript.py [PAGE ...]      (all pages of ../shared/data/pages without arguments)

Both render without anti-aliasing at the same resolution, with the same CMYK profile for colours that are not CMYK
(relative colorimetric, black point compensation) and the same box. Agreement is the share of *interior* pixels on
which no ink differs by more than TOLERANCE. Interior: over the 5 x 5 pixels around it no ink varies by more than
TOLERANCE, in either rendering. There, where two renderers put an edge, or which image sample a pixel takes, cannot
matter, and what is left is colour, overprint, and things drawn or not drawn.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile
from scipy import ndimage

from prooflight.pages.pdf.rip import PdfJob

SHARED = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"
PROFILE = SHARED / "icc" / "GRACoL2013coated_320_mth.icc"
TOLERANCE = 3  # of 255
DPI = 100.0  # about: see whole_rows_dpi
PAGES = 20  # in the test
REMARKS = {
    "d009": "its image has fewer rows than it states: MuPDF pads with 0 (black), Ghostscript leaves paper",
    "d020": "Ghostscript 10.00 draws its inline images 3 to 8 wrongly or not; all eight should look alike, and here do",
    "d025": "the two JPEG decoders enlarge the subsampled colours of its 50 x 75 image differently",
    "d028": "fonts not embedded: each renderer has another Helvetica and Times, and the drawing is their overlap",
    "d033": "blended in RGB, as its page group asks: converted by MuPDF's coarse link",
}
NO_REFERENCE = frozenset({"d009", "d020", "d028"})
"""Pages on which the two may differ because the file is damaged or incomplete, or the referee fails."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """Of one page's two renderings; shares are of all its pixels or of the interior ones."""

    agree: float
    """Share of interior pixels within TOLERANCE."""
    agree_inked: float
    """The same for those with ink in either rendering; 1 where there are none."""
    interior: float
    inked: float
    worst: int
    """Largest difference of any ink on an interior pixel. [of 255]"""


def manifest() -> list[dict[str, object]]:
    """The pages with their flags and strata."""
    rows: list[dict[str, object]] = json.loads((SHARED / "pages_manifest.json").read_text())
    return rows


def chosen(rows: list[dict[str, object]], count: int = PAGES) -> list[str]:
    """Pages for the test: all with overprint, a spot colour or an output intent, then the strata by turns.

    Each stratum, in the order of the manifest, gives its first page not chosen yet. Pages without a reference
    (NO_REFERENCE) are left out.
    """
    usable = [row for row in rows if row["id"] not in NO_REFERENCE]
    special = {"OVP", "SEP", "OI"}
    picked = [str(row["id"]) for row in usable if special & set(row["flags"])]  # type: ignore[call-overload]
    strata = list(dict.fromkeys(stratum for row in usable for stratum in row["strata"]))  # type: ignore[attr-defined]
    while len(picked) < count:
        for stratum in strata:
            rest = [row["id"] for row in usable if stratum in row["strata"] and row["id"] not in picked]  # type: ignore[operator]
            picked += [str(page) for page in rest[: min(1, count - len(picked))]]
    return sorted(picked)


def whole_rows_dpi(height_mm: float, dpi: float = DPI) -> float:
    """The resolution nearest to ``dpi`` at which a page has whole rows.

    Ghostscript counts rows from the bottom of the page and this RIP from its top: only then do they meet.
    """
    inches = height_mm / 25.4
    return max(1, round(inches * dpi)) / inches


def ghostscript(path: Path, dpi: float, *, profile: Path | None, trim: bool, rgb: bytes = b"") -> np.ndarray:
    """Ghostscript's CMYK composite of the first page: (rows, columns, 4) uint8.

    rgb: the profile of DeviceRGB where an output intent says so; Ghostscript 10.00 does not look at the page's.
    """
    with tempfile.TemporaryDirectory() as folder:
        options = [
            *("gs", "-q", "-dNOPAUSE", "-dBATCH", "-dSAFER", "-sDEVICE=tiffsep", f"-r{dpi:.6f}"),
            *(
                "-dGraphicsAlphaBits=1",
                "-dTextAlphaBits=1",
                "-dRenderIntent=1",
                "-dBlackPtComp=1",
                "-dLastPage=1",
            ),
            "-dUseTrimBox" if trim else "-dUseCropBox",
        ]
        if profile is not None:  # also for DeviceCMYK, so that it is not converted
            options += [f"--permit-file-read={profile}", f"-sOutputICCProfile={profile}"]
            options += [f"-sDefaultCMYKProfile={profile}"]
        if rgb:
            (Path(folder) / "rgb.icc").write_bytes(rgb)
            options += [f"--permit-file-read={folder}/rgb.icc", f"-sDefaultRGBProfile={folder}/rgb.icc"]
        subprocess.run([*options, "-o", f"{folder}/page%d.tif", str(path)], check=True, capture_output=True)
        return np.asarray(tifffile.imread(f"{folder}/page1.tif"))


def local_range(cmyk: np.ndarray) -> np.ndarray:
    """The largest variation of an ink over 5 x 5 pixels, (rows, columns)."""
    size = (5, 5, 1)
    return (ndimage.maximum_filter(cmyk, size) - ndimage.minimum_filter(cmyk, size)).max(axis=2)


def agreement(ours: np.ndarray, theirs: np.ndarray) -> Agreement:
    """Compare two renderings (rows, columns, 4) of one page."""
    interior = (local_range(ours) <= TOLERANCE) & (local_range(theirs) <= TOLERANCE)
    apart = np.abs(ours.astype(np.int16) - theirs).max(axis=2)
    inked = interior & ((ours > 0) | (theirs > 0)).any(axis=2)
    return Agreement(
        agree=_share(apart[interior] <= TOLERANCE),
        agree_inked=_share(apart[inked] <= TOLERANCE),
        interior=float(interior.mean()),
        inked=float(inked.mean()),
        worst=int(apart[interior].max(initial=0)),
    )


def _share(within: np.ndarray) -> float:
    return float(within.mean()) if within.size else 1.0


def compare(path: Path, *, profile: Path | None = PROFILE, dpi: float = DPI) -> Agreement:
    """Render the first page of a PDF with both and compare; ValueError if the rasters differ in size."""
    import pymupdf

    from prooflight.pages.pdf.drawing import output_intent

    with pymupdf.open(path) as document:
        trim = document.xref_get_key(document[0].xref, "TrimBox")[0] != "null"
    with PdfJob(path, profile=profile) as job:
        exact_dpi = whole_rows_dpi(job.page_sizes_mm[0][1], dpi)
        ours = job.page(1, exact_dpi).cmyk
    with pymupdf.open(path) as document:
        loaded = pymupdf.mupdf.pdf_load_page(pymupdf.mupdf.pdf_document_from_fz_document(document.this), 0)
        intent = output_intent(loaded)
    rgb = intent if intent[16:20] == b"RGB " else b""
    theirs = ghostscript(path, exact_dpi, profile=profile, trim=trim, rgb=rgb)
    if ours.shape != theirs.shape:
        message = f"{ours.shape} here, {theirs.shape} in Ghostscript"
        raise ValueError(message)
    return agreement(ours, theirs)


def main(wanted: list[str]) -> None:
    """Print the table."""
    from rich.console import Console

    out = Console(width=160, highlight=False)
    if not (shutil.which("gs") and SHARED.is_dir()):
        out.print("needs Ghostscript (gs) and the pages in ../shared/data")
        raise SystemExit(2)
    rows = manifest()
    in_test = set(chosen(rows))
    out.print("page  agree %  inked: agree %  interior %  inked %  worst  remark      (* in the test)")
    for row in rows:
        page = str(row["id"])
        if wanted and page not in wanted:
            continue
        a = compare(SHARED / "pages" / f"{page}.pdf")
        out.print(
            f"{page}{'*' if page in in_test else ' '} {100 * a.agree:7.2f} {100 * a.agree_inked:15.2f}"
            f" {100 * a.interior:11.1f} {100 * a.inked:8.2f} {a.worst:6d}  {REMARKS.get(page, '')}"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
