"""The sheets of a run: a job, printed once or repeatedly, and the thumbnails of its designs."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING, Final

from prooflight.pages.job import opened

if TYPE_CHECKING:
    from collections.abc import Hashable

    from prooflight.pages.job import JobSource
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight_line.run.notices import PageWarnings
    from prooflight_line.run.prefetch import PageStore
    from prooflight_line.run.sheets.thumbnails import Thumbnail

MOST_THUMBNAILS: Final = 1200
"""Greatest number of thumbnails kept, of 100 kB each: more than the widest search for a page compares."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobPageStore:
    """A job's pages in order, repeated from the first until ``sheets`` sheets have passed."""

    job: JobSource
    press: Press
    pages: int
    sheets: int
    plan: SheetPlan | None = None
    """Order of the sides, if they pass in another order than they are numbered; the pages of ``job`` are then
    its sides."""
    warnings: PageWarnings | None = None
    """Receives the warnings of each page; None: they are dropped."""

    def __len__(self) -> int:
        return self.sheets

    def design(self, sheet: int) -> int:
        """Return the number of the sheet's page in the job; see ``PageStore``."""
        return sheet % self.pages + 1 if self.plan is None else self.plan.number_at(sheet)

    def name(self, sheet: int) -> str:
        """Return the display name of a sheet's page."""
        return self.job.page_name(self.design(sheet))

    def page(self, sheet: int) -> Page:
        """Return the page printed on a sheet; see ``PageStore``.

        Raises JobError and RequestError as ``Job.page`` does, and RequestError if the page is wider than the
        press's field.
        """
        page = opened(self.job).page(self.design(sheet))
        if self.warnings is not None:
            self.warnings.add(page.warnings)
        return self.press.geometry.lay(page)


class ThumbnailCache:
    """Thumbnails of a job's sheets, one for each design; None if a design is not ready, or was evicted."""

    def __init__(self, page_store: PageStore) -> None:
        self._page_store = page_store
        self._cached: OrderedDict[Hashable, Thumbnail] = OrderedDict()
        self._guard = Lock()

    def __len__(self) -> int:
        return len(self._page_store)

    def __getitem__(self, sheet: int) -> Thumbnail | None:
        if not 0 <= sheet < len(self._page_store):
            raise IndexError(sheet)
        with self._guard:
            return self._cached.get(self._page_store.design(sheet))

    def add(self, design: Hashable, thumbnail: Thumbnail) -> None:
        """Add the thumbnail of a design that is ready; a design that is already there keeps its object."""
        with self._guard:
            self._cached.setdefault(design, thumbnail)
            self._cached.move_to_end(design)
            while len(self._cached) > MOST_THUMBNAILS:
                self._cached.popitem(last=False)
