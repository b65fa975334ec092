"""The sheets of a run: a job, printed once or over and over, and its thumbnails as they become known."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING, Final

from prooflight.pages.job import opened

if TYPE_CHECKING:
    from collections.abc import Hashable

    from prooflight.line.notices import PageWarnings
    from prooflight.line.prefetch import PageBook
    from prooflight.line.sheets.thumbnails import Thumbnail
    from prooflight.pages.job import JobSource
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press

MOST_THUMBNAILS: Final = 1200
"""Kept, of 100 kB each: more than the widest search for a page looks at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobBook:
    """A job's pages in order, and again from the first until so many sheets have passed."""

    job: JobSource
    press: Press
    pages: int
    sheets: int
    plan: SheetPlan | None = None
    """Where sides pass in another order than they are numbered; its pages are the job's sides then."""
    warnings: PageWarnings | None = None
    """Told of each page's; None: nobody is."""

    def __len__(self) -> int:
        return self.sheets

    def design(self, sheet: int) -> int:
        """See ``PageBook``: the page's number in the job."""
        return sheet % self.pages + 1 if self.plan is None else self.plan.number_at(sheet)

    def name(self, sheet: int) -> str:
        """Of a sheet's page, for people."""
        return self.job.page_name(self.design(sheet))

    def page(self, sheet: int) -> Page:
        """See ``PageBook``; JobError, RequestError: as ``Job.page``, or it is wider than the press's field."""
        page = opened(self.job).page(self.design(sheet))
        if self.warnings is not None:
            self.warnings.add(page.warnings)
        return self.press.geometry.lay(page)


class KnownThumbnails:
    """Thumbnails of a book's sheets, one a design; None where a design is not ready yet, or was long ago."""

    def __init__(self, book: PageBook) -> None:
        self._book = book
        self._known: OrderedDict[Hashable, Thumbnail] = OrderedDict()
        self._guard = Lock()

    def __len__(self) -> int:
        return len(self._book)

    def __getitem__(self, sheet: int) -> Thumbnail | None:
        if not 0 <= sheet < len(self._book):
            raise IndexError(sheet)
        with self._guard:
            return self._known.get(self._book.design(sheet))

    def know(self, design: Hashable, thumbnail: Thumbnail) -> None:
        """A design is ready; one that was known stays the same object."""
        with self._guard:
            self._known.setdefault(design, thumbnail)
            self._known.move_to_end(design)
            while len(self._known) > MOST_THUMBNAILS:
                self._known.popitem(last=False)
