"""A job: the pages of a PDF, of a CMYK TIFF or JPEG, or of a folder of them, behind one door."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from prooflight.errors import JobError, RequestError
from prooflight.files.given import shortly
from prooflight.pages import files
from prooflight.pages.layout.imposing import imposed, side_size
from prooflight.pages.memory import file_head
from prooflight.pages.pdf.rip import PDF_HEAD_BYTES, PageMarks, PdfJob
from prooflight.pages.raster import MM_PER_INCH, Page
from prooflight.pages.warnings import WHOLE_FILE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prooflight.pages.layout.layout import Layout
    from prooflight.pages.pdf.taking_together import InkLight
    from prooflight.pages.warnings import PageWarning


FINER: Final = 2
"""A PDF of which nobody says at what resolution its press prints it is drawn at so many times that of its raster
(`prooflight study resolution`). Three times as finely called no fewer good prints misprints."""
UNKNOWN_DPI: Final = 600.0
"""Resolution at which such a press is taken to print. (assumed: no press of letters prints more coarsely)"""


def edge_sd_mm(rip_dpi: float | None) -> float:
    """``Page.edge_sd_mm`` of a PDF by a press that rips it itself, at a known resolution or not.

    Every RIP rounds edges to pixels by a rule of its own: to anywhere within one (variance of a uniform distribution).
    """
    return MM_PER_INCH / (rip_dpi or UNKNOWN_DPI) / math.sqrt(12)


@dataclass(frozen=True, slots=True, kw_only=True)
class JobSource:
    """What a job is made of; small and picklable, so that every worker process can open its own."""

    path: Path
    dpi: float
    """Resolution at which PDF pages are ripped; images keep their own. [pixels/inch]"""
    drawn_dpi: float | None = None
    """Resolution at which the press rips PDFs, at which they are drawn; None: unknown, and they are drawn ``FINER``."""
    light: InkLight | None = None
    """How a press's inks take its camera's light, by which pixels of finely drawn PDFs are taken together; None: any
    press's, and inks are averaged."""
    profile: Path | None = None
    """CMYK ICC profile for the PDF colours that are not CMYK; None: the PDF's output intent."""
    layout: Layout | None = None
    """How pages lie on sheets: the job's pages then are the sides that are printed (``pages.layout``). None: as they
    are."""

    def page_name(self, number: int) -> str:
        """What page ``number``, from 1, is called, without a look at the job."""
        return files.page_name(number) if self.layout is None else self.layout.side_name(number)

    def open(self) -> Job:
        """Open the job; errors as ``open_job``."""
        return Job(self)


class Job:
    """An open job. Pages are numbered from 1; files in a folder follow one another in the order of their names."""

    def __init__(self, source: JobSource) -> None:
        """Errors as ``open_job``."""
        files.check_dpi(source.path, source.dpi)
        self._pdfs: dict[Path, PdfJob] = {}
        self._places: list[tuple[Path, int]] = []  # file and number in it, of every page of the job
        for path in _files_of(source.path):
            if _is_pdf(path):
                self._pdfs[path] = PdfJob(path, profile=source.profile)
                count = len(self._pdfs[path])
            else:
                count = files.page_count(path)
            self._places += [(path, number) for number in range(1, count + 1)]
        count, layout = len(self._places), source.layout
        self._sides = None if layout is None else layout.sides_of(count)
        self.source = source if layout is None else replace(source, layout=layout.of(count))

    def __reduce__(self) -> tuple[Any, ...]:
        return Job, (self.source,)  # opened again on the other side: MuPDF's handles do not travel

    def __len__(self) -> int:
        return len(self._places) if self._sides is None else self._sides

    def __iter__(self) -> Iterator[Page]:
        return (self.page(number) for number in range(1, len(self) + 1))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of all files."""
        for pdf in self._pdfs.values():
            pdf.close()

    @property
    def name(self) -> str:
        """The job's name for people: that of its file without the suffix, or of its folder."""
        path = self.source.path.resolve()
        return path.name if path.is_dir() else path.stem

    @property
    def page_sizes_mm(self) -> tuple[tuple[float, float], ...]:
        """Width and height of every page as printed. [mm]"""
        of_pdfs = {path: pdf.page_sizes_mm for path, pdf in self._pdfs.items()}
        sizes = []
        for path, place in self._places:
            if path in of_pdfs:
                sizes.append(of_pdfs[path][place - 1])
            else:
                sizes.append(files.page_size_mm(path, place))
        layout = self.source.layout
        if layout is None:
            return tuple(sizes)
        return tuple(
            side_size(sizes[_sizing_page(layout, number) - 1], layout) for number in range(1, len(self) + 1)
        )

    def flaws(self) -> dict[int, JobError]:
        """Pages of which it is cheap to tell that they cannot be used, and why; others may turn out so."""
        of_files = {path: files.flaws(path) for path, _ in self._places if path not in self._pdfs}
        found = {
            number: of_files[path][place]
            for number, (path, place) in enumerate(self._places, start=1)
            if place in of_files.get(path, {})
        }
        layout = self.source.layout
        if layout is None:
            return found
        return {
            number: found[page]
            for number in range(1, len(self) + 1)
            for page in (_sizing_page(layout, number), *layout.pages_on(number))
            if page in found
        }

    def page_size_mm(self, number: int) -> tuple[float, float]:
        """Of one page; errors as ``page``. [mm]"""
        layout = self.source.layout
        if layout is not None:
            return side_size(self._own_size_mm(_sizing_page(layout, number)), layout)
        return self._own_size_mm(number)

    def _own_size_mm(self, number: int) -> tuple[float, float]:
        path, place = self._places[number - 1]
        if path in self._pdfs:
            return self._pdfs[path].page_sizes_mm[place - 1]
        return files.page_size_mm(path, place)

    @property
    def warnings(self) -> tuple[PageWarning, ...]:
        """Warnings of the job's files and of the pages drawn so far, which are numbered as without a layout."""
        places = {place: number for number, place in enumerate(self._places)}
        return tuple(
            replace(warning, page=places.get((path, warning.page + 1), WHOLE_FILE))
            for path, pdf in self._pdfs.items()
            for warning in pdf.warnings
        )

    def marks(self, number: int) -> PageMarks | None:
        """What page ``number`` says of its own places; None: it is of no PDF. Errors as ``page``.

        RequestError: the job is laid on sheets, whose sides are no pages of the file.
        """
        if self.source.layout is not None:
            what = "a side of a sheet says nothing of places"
            raise RequestError(
                self.source.path, what, remedy="open the job without a layout for what its pages say"
            )
        path, place = self._places[number - 1]
        pdf = self._pdfs.get(path)
        return None if pdf is None else pdf.marks(place)

    def page(self, number: int) -> Page:
        """Page ``number`` of the job, from 1; RequestError: there is none; JobError: it cannot be used."""
        if not 1 <= number <= len(self):
            remedy = f"the job has {len(self)} page" + ("s" if len(self) > 1 else "")
            raise RequestError(self.source.path, f"there is no page {number}", remedy=remedy)
        layout = self.source.layout
        if layout is None:
            return self._own_page(number)
        shown = layout.pages_on(number)
        own = {page: self._own_page(page) for page in dict.fromkeys(shown) if page is not None}
        if None in shown:
            like = _sizing_page(layout, number)
            sized = own[like] if like in own else self._own_page(like)
            blank = replace(sized, cmyk=np.zeros_like(sized.cmyk), warnings=())
            return imposed([blank if page is None else own[page] for page in shown], layout, number)
        return imposed([own[page] for page in shown if page is not None], layout, number)

    def _own_page(self, number: int) -> Page:
        """As it stands in its file."""
        path, place = self._places[number - 1]
        pdf, source = self._pdfs.get(path), self.source
        if pdf is None:
            page = files.read_page(path, place)
        else:
            drawn_dpi = source.drawn_dpi or FINER * source.dpi
            page = pdf.page(place, source.dpi, drawn_dpi=drawn_dpi, light=source.light)
            page = replace(page, edge_sd_mm=edge_sd_mm(source.drawn_dpi))
        warnings = tuple(replace(warning, page=number - 1) for warning in page.warnings)
        return replace(page, name=files.page_name(number), number=number, warnings=warnings)


def open_job(path: Path, *, dpi: float, profile: Path | None = None) -> Job:
    """Open a PDF, a CMYK TIFF or JPEG, or a folder of them. dpi, profile: see ``JobSource``.

    JobError: a file cannot be used, or a folder holds none. ProfileError: the profile cannot be used.
    """
    return JobSource(path=Path(path), dpi=dpi, profile=None if profile is None else Path(profile)).open()


def _sizing_page(layout: Layout, number: int) -> int:
    """The page, from 1, that a side is sized by: the first on it, or of one that stays blank the first on its sheet."""
    return next((page for page in layout.pages_on(number) if page is not None), layout.first_page(number))


def opened(source: JobSource) -> Job:
    """The job, opened once a process and again when its file or folder has changed."""
    return _opened(source, source.path.stat().st_mtime_ns)


@lru_cache(maxsize=4)
def _opened(source: JobSource, _changed_ns: int) -> Job:
    return source.open()


def _files_of(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    inside = [file for file in files_in(path, (".pdf", *files.SUFFIXES)) if not file.is_dir()]
    for file in inside:  # one that is passed over would give all that follow other numbers
        if not file.exists():
            raise JobError(file, "is a link to nothing", remedy="put the page there, or take the link away")
    if not inside:
        what = "the folder holds no job"
        raise JobError(path, what, remedy="put PDF, CMYK TIFF or CMYK JPEG files into it")
    return inside


def files_in(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """What of a folder has one of the suffixes, in natural order of names; hidden files are none of it."""
    inside = [
        path for path in folder.iterdir() if path.suffix.lower() in suffixes and not path.name.startswith(".")
    ]
    return sorted(inside, key=lambda path: natural_order(path.name))


def natural_order(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key by which numbers in file names count as numbers.

    >>> sorted(["p10.tif", "p9.tif", "P1.tif"], key=natural_order)
    ['P1.tif', 'p9.tif', 'p10.tif']
    """
    parts = re.findall(r"[0-9]+|[^0-9]+", name)
    key = [(0, int(part), "") if part.isdecimal() else (1, 0, part.casefold()) for part in parts]
    return (*key, (2, 0, name))


def _is_pdf(path: Path) -> bool:
    return b"%PDF-" in file_head(path, JobError, PDF_HEAD_BYTES) or path.suffix.lower() == ".pdf"


def parse_pages(text: str, count: int) -> tuple[int, ...]:
    """Page numbers of a list like ``1,4-6``, in its order, each once; RequestError: not all are in 1..``count``.

    >>> parse_pages("4-6, 1", 24)
    (4, 5, 6, 1)
    """
    where, numbers = f"pages {text[:40]!r}", dict[int, None]()
    for part in text.split(","):
        match = re.fullmatch(r"\s*([0-9]{1,9})\s*(?:-\s*([0-9]{1,9})\s*)?", part)
        if not match:
            what = f"{shortly(part.strip())!r} is not a page or a range"
            raise RequestError(where, what, remedy="write 1,4-6")
        first, last = int(match[1]), int(match[2] or match[1])
        if first > last:
            what = f"{shortly(part.strip())!r} runs backwards"
            raise RequestError(where, what, remedy=f"write {last}-{first}")
        if first < 1 or last > count:
            what = f"there is no page {first if first < 1 or first > count else last}"
            raise RequestError(where, what, remedy=f"the job has pages 1 to {count}")
        numbers.update(dict.fromkeys(range(first, last + 1)))
    return tuple(numbers)
