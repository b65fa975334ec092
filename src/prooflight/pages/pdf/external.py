"""Drawing of a page by a program other than MuPDF: Ghostscript, or a command of the press's own.

Used only in the process that rips (``worker``). The program is a child of that process and ends with it. It
may take as much memory as the request allows, may write no file larger than its page, and its output is read
as messages.
"""

from __future__ import annotations

import os
import re
import resource
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from prooflight.errors import JobError
from prooflight.pages.memory import MEGAPIXELS_MAX
from prooflight.pages.pdf.engine import GHOSTSCRIPT, RipEngine
from prooflight.pages.raster import POINTS_PER_INCH
from prooflight.pages.warnings import PageWarning

TIFF: Final = "page.tif"
MESSAGES: Final = "messages.txt"
PROFILE: Final = "inks.icc"
MESSAGE_BYTES_MAX: Final = 1 << 16
MESSAGES_MAX: Final = 20
"""Most lines of a command that are passed on; these are the last ones."""
FILE_BYTES_PER_PIXEL: Final = 8
"""Bytes of a pixel of CMYK with 16 bits."""
FILE_SLACK_BYTES: Final = 64 * 2**20
PIXELS_OFF_MAX: Final = 2
"""Tolerance of a page's width and height: engines round them up, down, or to the nearest pixel."""
DPI_OFF_MAX: Final = 0.01
"""Relative tolerance of the stated resolution: TIFF has it in whole numbers if a program rounds it."""
_NO_MEMORY: Final = re.compile(
    r"(?i)VMerror|out of memory|cannot allocate memory|insufficient memory|MemoryError|bad_alloc"
)
_GS_DAMAGE: Final = re.compile(r"(?i)image error|\*\*\*\* error|^error:|page drawing error|unrecoverable")
_GS_FONT: Final = re.compile(r"^Loading font (\S+) \(or substitute\) from (.+)")
_GS_NOISE: Final = re.compile(
    r"^(GPL Ghostscript|Copyright|This software|see the file|Processing pages|Page \d+$|Loading |Querying operating "
    r"|Scanning |\s*\*\*\*\* (This file|Please|file that|specification)|The following )"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PageToDraw:
    """Page that a program is to draw, and its size."""

    pdf: Path
    shown: str
    """Name of the PDF in errors."""
    number: int
    """Number of the page, from 1."""
    left_points: float
    """Distance from the left edge of its MediaBox, as the page is turned, to that of the printed part."""
    below_points: float
    """Distance from the lower edge of its MediaBox, as the page is turned, to the upper edge of the
    printed part."""
    dpi: float
    columns: int
    rows: int
    profile: bytes
    """CMYK profile by which other colours become ink; empty: the program's own."""

    def error(self, what: str, remedy: str) -> JobError:
        """Return the error that the page could not be drawn, and why."""
        return JobError(self.shown, f"page {self.number}: {what}", remedy=remedy)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """A page that a program drew."""

    cmyk: NDArray[np.uint8]
    """Ink amounts (rows, columns, 4) of the page's size, at the requested resolution."""
    warnings: tuple[PageWarning, ...] = ()
    """Warnings from the output of the program."""


def draw(page: PageToDraw, engine: RipEngine, folder: Path, *, room_bytes: float) -> Drawn:
    """Draw a page with ``engine``; ``folder`` is empty, and left so.

    JobError: the program cannot be run, fails, reports that something is omitted, or writes something else
    than this page. MemoryError: not within ``room_bytes`` beyond the raster's own.
    """
    pixels = page.rows * page.columns
    if pixels > MEGAPIXELS_MAX * 1e6:
        what = f"at {page.dpi:g} dpi it has {pixels / 1e6:.0f} megapixels, which {engine.name} draws at once"
        raise page.error(what, f'at most {MEGAPIXELS_MAX}: state a lower [rip] dpi, or engine = "mupdf"')
    if engine.missing:
        raise page.error(engine.missing, engine.remedy)
    try:
        messages = _run(_arguments(page, engine, folder), page, engine, folder, room_bytes=room_bytes)
        cmyk = _read(page, engine, folder / TIFF)
    finally:
        for name in (TIFF, MESSAGES, PROFILE):
            (folder / name).unlink(missing_ok=True)
    return Drawn(cmyk=cmyk, warnings=tuple(_warnings(page, engine, messages)))


def _warnings(page: PageToDraw, engine: RipEngine, messages: list[str]) -> Iterator[PageWarning]:
    """Yield each line that a program printed as a warning; JobError if Ghostscript reports an omission."""
    place = page.number - 1
    if engine.name != "ghostscript":
        for line in dict.fromkeys(messages[-MESSAGES_MAX:]):
            yield PageWarning(page=place, kind="rip-message", message=f"{engine.program}: {line}")
        return
    for line in dict.fromkeys(messages):
        if _GS_DAMAGE.search(line):
            what = f"Ghostscript leaves something out of it ({line})"
            raise page.error(what, "correct what it reports, and export the PDF again")
        if font := _GS_FONT.match(line):
            message = f"the font {font[1]} is not embedded, and {Path(font[2]).name} is drawn in its place: embed it"
            yield PageWarning(page=place, kind="font-substituted", message=message, object_name=font[1])
        elif not _GS_NOISE.match(line):
            yield PageWarning(page=place, kind="rip-message", message=f"Ghostscript: {line}")


def _arguments(page: PageToDraw, engine: RipEngine, folder: Path) -> list[str]:
    if engine.name == "ghostscript":
        return _ghostscript(page, folder)
    values = {
        "pdf": str(page.pdf),
        "page": str(page.number),
        "dpi": f"{page.dpi:.10g}",
        "out": str(folder / TIFF),
    }
    return engine.filled(values)


def _ghostscript(page: PageToDraw, folder: Path) -> list[str]:
    """Return the command that draws one page into one TIFF whose first pixel is the top left corner of the
    printed box.

    ``tiff32nc`` with overprint simulated draws spot colours on plates of their own and sends them through
    their tint transforms at the end, which ``tiffsep`` does not. Native CMYK stays as it is, because the
    device and DeviceCMYK have one profile.
    """
    # Without a box of its own choice Ghostscript puts the lower left corner of the MediaBox at that of the raster.
    down = page.below_points - page.rows * POINTS_PER_INCH / page.dpi
    offset = f"{-page.left_points:.8f} {down:.8f}"
    profile = []
    if page.profile:
        (folder / PROFILE).write_bytes(page.profile)
        path = folder / PROFILE
        profile = [f"-sOutputICCProfile={path}", f"-sDefaultCMYKProfile={path}", f"--permit-file-read={path}"]
    return [
        GHOSTSCRIPT,
        *("-dSAFER", "-dBATCH", "-dNOPAUSE", "-dNOPROMPT", "-sDEVICE=tiff32nc", "-dOverprint=/simulate"),
        *("-dTextAlphaBits=1", "-dGraphicsAlphaBits=1", "-dPrinted=true", "-sCompression=none"),
        *(f"-r{page.dpi:.10g}", f"-g{page.columns}x{page.rows}"),
        *(f"-dFirstPage={page.number}", f"-dLastPage={page.number}"),
        *profile,
        f"-sOutputFile={TIFF}",
        *("-c", f"<</PageOffset [{offset}]>> setpagedevice", "-f", str(page.pdf)),
    ]


def _run(
    arguments: list[str], page: PageToDraw, engine: RipEngine, folder: Path, *, room_bytes: float
) -> list[str]:
    """Run a program to its end, and return the lines that it printed; JobError if it fails, or MemoryError."""
    pixels = page.rows * page.columns
    room = int(room_bytes + FILE_BYTES_PER_PIXEL * pixels)
    largest = FILE_BYTES_PER_PIXEL * pixels + FILE_SLACK_BYTES

    def limit() -> None:
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (room, most))
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))

    with (folder / MESSAGES).open("w+b") as said:
        try:
            done = subprocess.run(
                arguments,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
                preexec_fn=limit,  # no other thread runs here, so that it cannot lock
                check=False,
                env=os.environ | {"TMPDIR": str(folder)},
            )
        except OSError as error:
            what = f"{engine.program} cannot be run ({error.strerror})"
            raise page.error(what, engine.remedy) from None
        said.seek(max(0, said.seek(0, 2) - MESSAGE_BYTES_MAX))
        text = said.read().decode("utf-8", "replace")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if done.returncode:
        if _NO_MEMORY.search(text):
            raise MemoryError
        last = f": {lines[-1]}" if lines else ""
        what = f"{engine.program} {_ended(done.returncode)}{last}"
        raise page.error(what, "run it on this page by hand to see why")
    return lines


def _ended(code: int) -> str:
    return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ends with exit code {code}"


def _read(page: PageToDraw, engine: RipEngine, path: Path) -> NDArray[np.uint8]:
    """Read the page from the TIFF that a program wrote; JobError if it wrote none, or none of this page."""
    from prooflight.pages.files import read_page

    remedy = "have it write one CMYK TIFF of the page's printed box, at the resolution that it is given"
    if not path.is_file():
        raise page.error(f"{engine.program} writes no file {{out}}", remedy)
    try:
        read = read_page(path)
    except JobError as error:
        raise page.error(f"what {engine.program} writes cannot be used: {error.what}", remedy) from None
    if abs(read.dpi / page.dpi - 1) > DPI_OFF_MAX:
        what = f"{engine.program} writes {read.dpi:g} dpi where {page.dpi:g} was requested"
        raise page.error(what, remedy)
    rows, columns = read.cmyk.shape[:2]
    if max(abs(rows - page.rows), abs(columns - page.columns)) > PIXELS_OFF_MAX:
        size = f"{page.columns} x {page.rows}"
        what = (
            f"{engine.program} writes {columns} x {rows} pixels where what is printed of the page has {size}"
        )
        raise page.error(what, remedy)
    return fitted(read.cmyk, page.rows, page.columns)


def fitted(cmyk: NDArray[np.uint8], rows: int, columns: int) -> NDArray[np.uint8]:
    """Return ``cmyk`` (n, m, 4) cut to ``rows`` and ``columns``, with its last ones repeated if it has fewer."""
    cut = cmyk[:rows, :columns]
    lacking = ((0, rows - cut.shape[0]), (0, columns - cut.shape[1]), (0, 0))
    if any(after for _, after in lacking):
        return np.pad(cut, lacking, "edge")
    return cut


def pixels_of(size_points: tuple[float, float], dpi: float) -> tuple[int, int]:
    """Return rows and columns of a page's raster (``rip``)."""
    width, height = (max(1, round(side * dpi / POINTS_PER_INCH)) for side in size_points)
    return height, width
