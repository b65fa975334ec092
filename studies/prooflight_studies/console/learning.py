"""A small press with a job and recorded scans of its good pages, from which the console learns that press again."""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

from prooflight.commissioning.build import build_press
from prooflight.commissioning.training.real_pages import waiting_path
from prooflight.commissioning.training.train import trained
from prooflight.pages.files import write_tiff
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source
from prooflight.press.press_file import TWO_SENSORS, PressFile
from prooflight.simulation.corpus.corpus import Corpus
from prooflight.simulation.corpus.designs.sheet import Sheet
from prooflight.simulation.files import ScanToFile

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.pages.raster import Page

SIZE_MM: Final = (99.0, 210.0)
"""A third of A4, the smallest size of the corpus: a press and its pages are made in a minute or two."""
MARGIN_MM: Final = 4.0
DESIGNS: Final = 24
PAGES: Final = 24
"""Good pages that are learned; 20 are the fewest that suffice."""
FIRST_PAGE: Final = 1000
"""Number of the first design of the job: none that the press was trained on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NarrowDesigns:
    """The corpus on sheets of ``SIZE_MM``."""

    seed: int
    dpi: float

    def page(self, index: int) -> Page:
        """Return design ``index``, from 0."""
        return Corpus(seed=self.seed, dpi=self.dpi).page(index, sheet=_sheet)


def _sheet(*, width_mm: float, height_mm: float, dpi: float) -> Sheet:
    return Sheet(width_mm=SIZE_MM[0], height_mm=SIZE_MM[1], dpi=dpi)


@dataclass(frozen=True, slots=True, kw_only=True)
class Learnable:
    """A press that can be learned again, as often as ``begin_again`` is called."""

    press: Path
    job: Path
    scans: Path
    digest: str
    """Digest of the press before it learns."""

    @classmethod
    def create(cls, folder: Path, *, seed: int, progress: Callable[[str], None]) -> Self:
        """Build and train the press, draw a job, and print and scan its pages on a day of the press."""
        press_file = PressFile.preset(TWO_SENSORS)
        pitch_mm = press_file.geometry(press_file.camera()).pixel_pitch_mm
        pixels = math.ceil((SIZE_MM[0] + MARGIN_MM) / pitch_mm)
        progress(f"a press of {pixels} pixels that learns")
        built = build_press(press_file, seed=seed, pixels=pixels)
        designs = NarrowDesigns(seed=seed, dpi=built.dpi)
        press = trained(built, designs, designs=DESIGNS, seed=seed)
        created = cls(
            press=folder / "x.press", job=folder / "job", scans=folder / "scans", digest=press.digest
        )
        created.job.mkdir(parents=True)
        created.scans.mkdir()
        press.save(created.original)
        progress(f"{PAGES} good pages")
        for index in range(FIRST_PAGE, FIRST_PAGE + PAGES):
            page = designs.page(index)
            write_tiff(page, created.job / f"{page.name}.tif")
        work = ScanToFile(
            job=job_source(created.job, press),
            press=press,
            out=created.scans,
            request=None,
            seed=seed,
            job_pages=PAGES,
            world="press",
        )
        for number in range(1, PAGES + 1):
            work(number)
        created.begin_again()
        return created

    def begin_again(self) -> None:
        """Put the press back as it was before it learned."""
        again = self.press.with_name("again.press")
        shutil.copyfile(self.original, again)
        again.replace(self.press)  # the console maps the file: one that is written over would end it
        waiting_path(self.press).unlink(missing_ok=True)
        shutil.rmtree(self.press.with_name(f"{self.press.name}.versions"), ignore_errors=True)

    @property
    def learned(self) -> bool:
        """Whether the press in use is another one now."""
        return Press.load(self.press).digest != self.digest

    @property
    def original(self) -> Path:
        """The press as it was before it learned."""
        return self.press.with_name("before.press")
