"""Pages on one press: a job opened at its resolution, its pages as they enter the press and as its camera sees them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from prooflight.pages.job import FINER, Job, JobSource
from prooflight.press.job_spectra import JobSpectra

if TYPE_CHECKING:
    from prooflight.pages.layout.layout import Layout
    from prooflight.pages.raster import Page
    from prooflight.prediction.predict import Prediction
    from prooflight.press.artefact import Press


class PressJob(Job):
    """Open job whose pages are given as they enter one press (``ScanGeometry.lay``)."""

    def __init__(self, source: JobSource, press: Press) -> None:
        """Open the job; errors as ``open_job``."""
        super().__init__(source)
        self.press = press

    def __reduce__(self) -> tuple[Any, ...]:
        return PressJob, (self.source, self.press)

    def page(self, number: int) -> Page:
        """Return page ``number``, from 1; errors as ``Job.page``; JobError: it does not fit this press."""
        return self.press.geometry.lay(super().page(number))


def job_source(
    path: Path, press: Press, *, profile: Path | None = None, layout: Layout | None = None
) -> JobSource:
    """Return a job prepared for this press: PDFs are drawn at its RIP's resolution, and pixels pooled by its inks.

    If a unit of the press takes the spectrum of its ink from jobs, the job is opened; errors as ``open_job``.
    """
    source = JobSource(
        path=path,
        dpi=press.dpi,
        drawn_dpi=press.rip_dpi,
        light=press.ink_light,
        profile=profile,
        engine=press.rip_engine,
        rip=press.rip_model,
        layout=layout,
    )
    units = press.spot_units
    if units is None:
        return source
    stated = JobSpectra()
    if units.take_from_jobs:
        with source.open() as job:
            stated = JobSpectra.of(job.source.path, job.document_facts())
    return replace(source, spots=units.prints(press.sensors, stated))


def drawn_dpi(press: Press) -> float:
    """Return the resolution at which PDF pages are drawn for a press before their pixels are pooled. [pixels/inch]"""
    return press.rip_dpi or FINER * press.dpi


def open_job(path: str | Path, press: Press, *, profile: str | Path | None = None) -> PressJob:
    """Open a PDF, a CMYK TIFF or JPEG, or a folder of them, to be printed on a press.

    PDF pages are ripped at the press's resolution, images keep their own. profile: CMYK ICC profile for the PDF colours
    that are not CMYK; None: the PDF's output intent. JobError: a file cannot be used, or a folder holds none.
    ProfileError: the profile cannot be used.
    """
    source = job_source(Path(path), press, profile=None if profile is None else Path(profile))
    return PressJob(source, press)


def predict(page: Page, press: Press) -> Prediction:
    """Predict the lines that the camera of a press sees of a page in its place, and their variance.

    page: as it enters the press (``ScanGeometry.lay``); pages of ``open_job`` do.
    """
    return press.press_context().predict(page)
