"""Check whether an engine draws a PDF by the PDF specification, with a test page whose values are all known.

The page has a TrimBox that is offset from its MediaBox and from whole points, a square whose edges are
measured, and patches of process inks, tints, spot colours and overprint (ISO 32000-2, 8.6.6.4, 8.6.7 and
14.11.2).
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import JobError
from prooflight.pages.pdf.rip import PdfJob
from prooflight.pages.raster import POINTS_PER_INCH

if TYPE_CHECKING:
    from prooflight.pages.pdf.engine import RipEngine

MEDIA: Final = (0.0, 0.0, 260.0, 210.0)
TRIM: Final = (20.25, 15.5, 236.25, 195.5)
"""The TrimBox, 3 x 2.5 inches. [points]"""
SQUARE: Final = (18.0, 18.0, 54.0, 54.0)
"""Left, top, right and bottom of the black square, from the top left corner of the TrimBox. [points]"""
PATCH_POINTS: Final = 24.0
STEP_POINTS: Final = 28.0
COLUMNS: Final = 7
FIRST: Final = (10.0, 66.0)
"""Left and top of the first patch, as of the square. [points]"""
EDGE_PIXELS: Final = 1
"""Tolerance of an edge: engines ink pixels that a shape touches, or those whose centres it covers."""
INK_OFF_MAX: Final = 3
"""Tolerance of ink amounts, of 255; engines round and truncate tints."""

_SPOT: Final = (
    "[/Separation/ProoflightTest/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 0.2 0.8 0.1]/N 1>>]"
)
_BLACK: Final = "[/Separation/Black/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[0 0 0 1]/N 1>>]"
_ALL: Final = "[/Separation/All/DeviceCMYK<</FunctionType 2/Domain[0 1]/C0[0 0 0 0]/C1[1 1 1 1]/N 1>>]"
_RESOURCES: Final = (
    f"/ColorSpace<</Spot{_SPOT}/Black{_BLACK}/All{_ALL}>>"
    "/ExtGState<</Over0<</Type/ExtGState/op true/OP true/OPM 0>>/Over1<</Type/ExtGState/op true/OP true/OPM 1>>>>"
)
_UNDER: Final = "0.4 0 0 0 k {box} re f "


@dataclass(frozen=True, slots=True, kw_only=True)
class Patch:
    """A square of one colour."""

    name: str
    """Description of the test, in words."""
    operators: str
    """Operators that paint it; ``{box}`` stands for its rectangle."""
    cmyk: tuple[int, int, int, int]
    """Expected ink amounts, 0 to 255."""


PATCHES: Final = (
    Patch(name="cyan", operators="1 0 0 0 k {box} re f", cmyk=(255, 0, 0, 0)),
    Patch(name="magenta", operators="0 1 0 0 k {box} re f", cmyk=(0, 255, 0, 0)),
    Patch(name="yellow", operators="0 0 1 0 k {box} re f", cmyk=(0, 0, 255, 0)),
    Patch(name="black", operators="0 0 0 1 k {box} re f", cmyk=(0, 0, 0, 255)),
    Patch(name="a tint of cyan and yellow", operators="0.5 0 0.25 0 k {box} re f", cmyk=(128, 0, 64, 0)),
    Patch(name="grey", operators="0.4 g {box} re f", cmyk=(0, 0, 0, 153)),
    Patch(name="Separation All", operators="/All cs 0.6 scn {box} re f", cmyk=(153, 153, 153, 153)),
    Patch(name="a spot colour", operators="/Spot cs 1 scn {box} re f", cmyk=(0, 51, 204, 26)),
    Patch(name="a tint of a spot colour", operators="/Spot cs 0.5 scn {box} re f", cmyk=(0, 26, 102, 13)),
    Patch(name="Separation Black", operators="/Black cs 0.6 scn {box} re f", cmyk=(0, 0, 0, 153)),
    Patch(
        name="black over cyan without overprint",
        operators=_UNDER + "0 0 0 1 k {box} re f",
        cmyk=(0, 0, 0, 255),
    ),
    Patch(
        name="black over cyan in overprint mode 0",
        operators=_UNDER + "/Over0 gs 0 0 0 1 k {box} re f",
        cmyk=(0, 0, 0, 255),
    ),
    Patch(
        name="black over cyan in overprint mode 1",
        operators=_UNDER + "/Over1 gs 0 0 0 1 k {box} re f",
        cmyk=(102, 0, 0, 255),
    ),
    Patch(
        name="a spot colour that overprints cyan",
        operators=_UNDER + "/Over1 gs /Spot cs 1 scn {box} re f",
        cmyk=(102, 51, 204, 26),
    ),
    Patch(
        name="Separation Black that overprints cyan",
        operators=_UNDER + "/Over1 gs /Black cs 0.6 scn {box} re f",
        cmyk=(102, 0, 0, 153),
    ),
)


def differences(engine: RipEngine, dpi: float) -> tuple[str, ...]:
    """Draw the test page with ``engine`` at ``dpi``, and return a phrase for each difference from the specification."""
    with tempfile.TemporaryDirectory(prefix="prooflight-") as folder:
        path = Path(folder) / "test-page.pdf"
        path.write_bytes(check_page())
        try:
            with PdfJob(path, engine=engine) as job:
                cmyk = job.page(1, dpi).cmyk
        except JobError as error:
            return (error.what.removeprefix("page 1: "),)
    return (*_edges(cmyk, dpi), *_patches(cmyk, dpi))


def sentence(engine: RipEngine, dpi: float, differing: tuple[str, ...]) -> str:
    """Describe in one line how an engine drew the test page."""
    about = f"RIP {engine.name} at {dpi:.6g} dpi"
    if not differing:
        return f"{about}: draws the test page as the PDF specification requires"
    more = f"; and {len(differing) - 2} more" if len(differing) > 2 else ""
    return f"{about}: differs on the test page: {'; '.join(differing[:2])}{more}"


def check_page() -> bytes:
    """Return the test page, a PDF."""
    x0, y0, x1, y1 = TRIM
    paints = [f"0 1 0 0 k 0 0 {MEDIA[2]} {MEDIA[3]} re {x0} {y0} {x1 - x0} {y1 - y0} re f*"]
    paints.append(f"0 0 0 1 k {_rectangle(SQUARE)} re f")
    paints += [
        f"q {patch.operators.format(box=_rectangle(_place(number)))} Q"
        for number, patch in enumerate(PATCHES)
    ]
    content = "\n".join(paints).encode()
    boxes = "".join(
        f"/{name}[{' '.join(f'{side:g}' for side in box)}]"
        for name, box in (("MediaBox", MEDIA), ("TrimBox", TRIM))
    )
    return pdf_of(
        [
            b"<</Type/Catalog/Pages 2 0 R>>",
            b"<</Type/Pages/Kids[3 0 R]/Count 1>>",
            f"<</Type/Page/Parent 2 0 R/Contents 4 0 R/Resources<<{_RESOURCES}>>{boxes}>>".encode(),
            b"<</Length %d>>stream\n%s\nendstream" % (len(content), content),
        ]
    )


def pdf_of(objects: list[bytes]) -> bytes:
    """Return a PDF of these objects, numbered from 1, of which the first is the catalogue."""
    out, places = bytearray(b"%PDF-1.6\n%\xe2\xe3\xcf\xd3\n"), list[int]()
    for number, body in enumerate(objects, 1):
        places.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    start, count = len(out), len(objects) + 1
    out += b"xref\n0 %d\n0000000000 65535 f \n%s" % (count, table)
    return bytes(out) + b"trailer<</Size %d/Root 1 0 R>>\nstartxref\n%d\n%%%%EOF\n" % (count, start)


def _place(number: int) -> tuple[float, float, float, float]:
    """Return left, top, right and bottom of a patch, as of the square. [points]"""
    left = FIRST[0] + STEP_POINTS * (number % COLUMNS)
    top = FIRST[1] + STEP_POINTS * (number // COLUMNS)
    return left, top, left + PATCH_POINTS, top + PATCH_POINTS


def _rectangle(box: tuple[float, float, float, float]) -> str:
    """Return the operands of ``re`` for a rectangle that is given from the top left corner of the TrimBox."""
    left, top, right, bottom = box
    return f"{TRIM[0] + left:g} {TRIM[3] - bottom:g} {right - left:g} {bottom - top:g}"


def _edges(cmyk: NDArray[np.uint8], dpi: float) -> list[str]:
    """Return the errors of the square of solid black."""
    scale = dpi / POINTS_PER_INCH
    left, top, right, bottom = (side * scale for side in SQUARE)
    margin = 6 * scale  # of the paper around it
    window = tuple(
        slice(int(low - margin), int(high + margin)) for low, high in ((top, bottom), (left, right))
    )
    black = cmyk[window][..., 3]
    rows, columns = np.nonzero((black > 127).any(1))[0], np.nonzero((black > 127).any(0))[0]
    if not rows.size:
        return ["its black square is not where the TrimBox puts it"]
    offsets = {
        "left": columns[0] + window[1].start - left,
        "top": rows[0] + window[0].start - top,
        "right": columns[-1] + 1 + window[1].start - right,
        "bottom": rows[-1] + 1 + window[0].start - bottom,
    }
    wrong = [
        f"the {side} edge of its square is {off:+.1f} pixels off"
        for side, off in offsets.items()
        if abs(off) > EDGE_PIXELS + 0.01
    ]
    if ((black > 0) & (black < 255)).any():
        wrong.append("edges are anti-aliased, which no press prints")
    return wrong


def _patches(cmyk: NDArray[np.uint8], dpi: float) -> list[str]:
    """Return the patches that differ from their expected amounts."""
    wrong = []
    for number, patch in enumerate(PATCHES):
        left, top, right, bottom = (side * dpi / POINTS_PER_INCH for side in _place(number))
        inner = (right - left) / 4
        middle = cmyk[int(top + inner) : int(bottom - inner), int(left + inner) : int(right - inner)]
        printed = np.median(middle.reshape(-1, 4), axis=0).astype(int).tolist()
        if max(abs(one - other) for one, other in zip(printed, patch.cmyk, strict=True)) > INK_OFF_MAX:
            wrong.append(
                f"{patch.name} prints as {_shown(printed)}, and should print as {_shown(patch.cmyk)}"
            )
    return wrong


def _shown(cmyk: tuple[int, ...] | list[int]) -> str:
    return " ".join(str(ink) for ink in cmyk)
