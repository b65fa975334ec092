"""Page designs for studies that are read from the user's own files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from prooflight.errors import RequestError
from prooflight.pages.job import JobSource, opened
from prooflight.simulation.corpus.corpus import design_name

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.pages.raster import Page


@dataclass(frozen=True, slots=True, kw_only=True)
class Folder:
    """The pages of a folder of PDF, CMYK TIFF or JPEG files, or of one such file, each page a design."""

    path: Path
    dpi: float
    """Resolution at which PDF pages are ripped; images keep their own. [pixels/inch]"""

    def __len__(self) -> int:
        return len(opened(self._source))

    def page(self, index: int) -> Page:
        """Return design ``index``, from 0; RequestError: there is none; JobError: it cannot be used."""
        job = opened(self._source)
        if not 0 <= index < len(job):
            raise RequestError(self.path, f"there is no design {index}", remedy=f"give 0 to {len(job) - 1}")
        return replace(job.page(index + 1), name=design_name(index))

    @property
    def sizes_mm(self) -> tuple[tuple[float, float], ...]:
        """Width and height of every design. [mm]"""
        return opened(self._source).page_sizes_mm

    @property
    def _source(self) -> JobSource:
        return JobSource(path=self.path, dpi=self.dpi)
