"""A job: the pages of a PDF, of a CMYK TIFF or JPEG, or of a folder of them, with one interface."""

from __future__ import annotations

import re
from collections.abc import Iterator
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
from prooflight.pages.pdf.rip_model import UNSTATED, RipModel
from prooflight.pages.raster import Page
from prooflight.pages.warnings import WHOLE_FILE, PageWarning

if TYPE_CHECKING:
    from prooflight.pages.layout.layout import Layout
    from prooflight.pages.pdf.area_averages import InkLight
    from prooflight.pages.pdf.engine import RipEngine
    from prooflight.pages.pdf.facts import DocumentFacts, PageFacts
    from prooflight.pages.spots.spot_ink import SpotPrint


FINER: Final = 2
"""Oversampling of a PDF whose press prints at an unknown resolution, relative to its raster (decision 34). A
factor of three did not lower the number of good prints that were called misprints."""
COARSE_DPI: Final = 18.0
"""Resolution at which a page is drawn only for its warnings: all of it is read, and almost nothing is
painted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobSource:
    """Definition of a job; small and picklable, so that every worker process can open its own."""

    path: Path
    dpi: float
    """Resolution at which PDF pages are ripped; images keep their own. [pixels/inch]"""
    drawn_dpi: float | None = None
    """Resolution at which the press rips PDFs, at which they are drawn; None: unknown, and they are drawn
    ``FINER``."""
    light: InkLight | None = None
    """How a press's inks absorb its camera's light, used to combine the pixels of finely drawn PDFs; None:
    not specific to a press, and inks are averaged."""
    profile: Path | None = None
    """CMYK ICC profile for the PDF colours that are not CMYK; None: the PDF's output intent."""
    engine: RipEngine | None = None
    """Engine that draws the pages of PDFs; None: MuPDF."""
    rip: RipModel = UNSTATED
    """Parameters of the press's RIP, by which PDFs are drawn."""
    spots: tuple[SpotPrint, ...] = ()
    """Spot inks that the press prints by units of their own."""
    layout: Layout | None = None
    """Imposition of pages on sheets: the job's pages then are the sides that are printed
    (``pages.layout``). None: pages are printed as they are."""

    def page_name(self, number: int) -> str:
        """Return the name of page ``number``, from 1, without opening the job."""
        return files.page_name(number) if self.layout is None else self.layout.side_name(number)

    @property
    def files(self) -> tuple[Path, ...]:
        """File or folder of the job, and its profile."""
        return (self.path,) if self.profile is None else (self.path, self.profile)

    def open(self) -> Job:
        """Open the job; errors as ``open_job``."""
        return Job(self)


class Job:
    """An open job. Pages are numbered from 1; files in a folder follow one another in the order of their names."""

    def __init__(self, source: JobSource) -> None:
        """Open the files; errors as ``open_job``."""
        files.check_dpi(source.path, source.dpi)
        self._pdfs: dict[Path, PdfJob] = {}
        self._places: list[tuple[Path, int]] = []  # file and number in it, of every page of the job
        for path in _files_of(source.path):
            if _is_pdf(path):
                self._pdfs[path] = PdfJob(
                    path, profile=source.profile, engine=source.engine, spots=source.spots
                )
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
        """Close all files."""
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
        """Return the pages that are cheaply known to be unusable, and why; others may turn out to be unusable too."""
        of_files = {path: files.flaws(path) for path, _ in self._places if path not in self._pdfs}
        flawed = {
            number: of_files[path][place]
            for number, (path, place) in enumerate(self._places, start=1)
            if place in of_files.get(path, {})
        }
        layout = self.source.layout
        if layout is None:
            return flawed
        return {
            number: flawed[page]
            for number in range(1, len(self) + 1)
            for page in (_sizing_page(layout, number), *layout.pages_on(number))
            if page in flawed
        }

    def page_size_mm(self, number: int) -> tuple[float, float]:
        """Return the size of one page; errors as ``page``. [mm]"""
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
        of_spots = tuple(warning for spot in self.source.spots for warning in spot.page_warnings)
        return of_spots + tuple(
            replace(warning, page=places.get((path, warning.page + 1), WHOLE_FILE))
            for path, pdf in self._pdfs.items()
            for warning in pdf.warnings
        )

    def marks(self, number: int) -> PageMarks | None:
        """Return the marked places of page ``number``; None if it is of no PDF. Errors as ``page``.

        RequestError: the job is imposed on sheets, whose sides are no pages of the file.
        """
        if self.source.layout is not None:
            what = "a side of a sheet has no marked places"
            raise RequestError(self.source.path, what, remedy="open the job without a layout")
        path, place = self._places[number - 1]
        pdf = self._pdfs.get(path)
        return None if pdf is None else pdf.marks(place)

    @property
    def own_pages(self) -> int:
        """Number of pages in the job's files, independent of the layout."""
        return len(self._places)

    def facts(self, number: int) -> tuple[PageFacts, dict[str, tuple[int, ...]]] | None:
        """Return facts of page ``number`` of its files, and the printed values of its spot colours
        (``PdfJob.facts``).

        None: it is of no PDF. Errors as ``page``.
        """
        path, place = self._places[number - 1]
        pdf = self._pdfs.get(path)
        return None if pdf is None else pdf.facts(place)

    def document_facts(self) -> DocumentFacts | None:
        """Return facts of the file of a job that is one PDF; None: it is none. JobError: it is damaged."""
        if self.source.path.is_dir() or len(self._pdfs) != 1:
            return None
        return next(iter(self._pdfs.values())).document_facts()

    def coarse_warnings(self, number: int) -> tuple[PageWarning, ...]:
        """Draw page ``number`` of its files coarsely, and return its warnings; errors as ``page``."""
        path, place = self._places[number - 1]
        pdf = self._pdfs.get(path)
        if pdf is None:
            return ()
        warnings = pdf.page(place, COARSE_DPI).warnings
        return tuple(replace(warning, page=number - 1) for warning in warnings)

    def page(self, number: int) -> Page:
        """Return page ``number`` of the job, from 1.

        RequestError: there is no such page. JobError: it cannot be used.
        """
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
        """Return a page as it is in its file."""
        path, place = self._places[number - 1]
        pdf, source = self._pdfs.get(path), self.source
        if pdf is None:
            page = files.read_page(path, place)
        else:
            drawn_dpi = source.drawn_dpi or FINER * source.dpi
            page = pdf.page(place, source.dpi, drawn_dpi=drawn_dpi, light=source.light, rip=source.rip)
            page = replace(page, edge_sd_mm=source.rip.edge_sd_mm(source.drawn_dpi))
        warnings = tuple(replace(warning, page=number - 1) for warning in page.warnings)
        return replace(page, name=files.page_name(number), number=number, warnings=warnings)


def open_job(path: Path, *, dpi: float, profile: Path | None = None) -> Job:
    """Open a PDF, a CMYK TIFF or JPEG, or a folder of them; for ``dpi`` and ``profile`` see ``JobSource``.

    JobError: a file cannot be used, or a folder holds none. ProfileError: the profile cannot be used.
    """
    return JobSource(path=Path(path), dpi=dpi, profile=None if profile is None else Path(profile)).open()


def _sizing_page(layout: Layout, number: int) -> int:
    """Return the page, from 1, that determines the size of a side.

    It is the first page on the side or, if the side stays blank, the first on its sheet.
    """
    return next((page for page in layout.pages_on(number) if page is not None), layout.first_page(number))


def opened(source: JobSource) -> Job:
    """Return the job, opened once a process and again when its file or folder has changed."""
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
            raise JobError(file, "is a broken link", remedy="put the page there, or remove the link")
    if not inside:
        what = "the folder holds no job"
        raise JobError(path, what, remedy="put PDF, CMYK TIFF or CMYK JPEG files into it")
    return inside


def files_in(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Return the files of a folder with one of the suffixes, in natural order of names, without hidden files."""
    inside = [
        path for path in folder.iterdir() if path.suffix.lower() in suffixes and not path.name.startswith(".")
    ]
    return sorted(inside, key=lambda path: natural_order(path.name))


def natural_order(name: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sort key by which digits in file names count as numbers.

    >>> sorted(["p10.tif", "p9.tif", "P1.tif"], key=natural_order)
    ['P1.tif', 'p9.tif', 'p10.tif']
    """
    parts = re.findall(r"[0-9]+|[^0-9]+", name)
    key = [(0, int(part), "") if part.isdecimal() else (1, 0, part.casefold()) for part in parts]
    return (*key, (2, 0, name))


def _is_pdf(path: Path) -> bool:
    return b"%PDF-" in file_head(path, JobError, PDF_HEAD_BYTES) or path.suffix.lower() == ".pdf"


def parse_pages(text: str, count: int) -> tuple[int, ...]:
    """Return the page numbers of a list like ``1,4-6``, in its order, each once.

    RequestError: the text is no such list, or not all numbers are in 1..``count``.

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
