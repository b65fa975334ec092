"""Pages of a job to draw zones on: their raster in the colours of a screen, as tiles, and their proposals."""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import math
import os
import threading
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Literal, TypeVar

import cv2
import numpy as np

from prooflight.errors import ProoflightError
from prooflight.files.atomic import whole_file
from prooflight.inspection.codes.finding import code_zones
from prooflight.pages.job import JobSource
from prooflight.pages.raster import MM_PER_INCH
from prooflight.pages.zones.rules import Rules, entry_of
from prooflight.press.artefact import Press
from prooflight.press.pages import job_source
from prooflight_console.pictures.expected import TILE, levels_of
from prooflight_console.pictures.pictures import MAKING, tidy
from prooflight_console.pictures.tiles import encoded
from prooflight_console.problems import Problem, not_found

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from prooflight.pages.pdf.rip import PageMarks
    from prooflight.pages.zones.zone import Box
    from prooflight.pages.zones.zones_file import ZoneEntry
    from prooflight_console.pictures.pictures import Pictures

_log = logging.getLogger(__name__)

Result = TypeVar("Result")

DPI: Final = 150.0
"""Resolution of a PDF to draw zones on: a tenth of a millimetre is half a pixel."""
MOST_PIXELS: Final = 6000
"""Pixels along the longer side at most: larger pages are drawn more coarsely."""
FACTS: Final = "raster.json"
VERSION: Final = "1"
MOST_CACHED: Final = 256
"""Number of pages with cached proposals."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Raster:
    """Size of a page that is cut into tiles."""

    width: int
    height: int
    width_mm: float
    height_mm: float
    levels: int


def make_tiles(job: Path, number: int, folder: Path, dpi: float) -> None:
    """Draw page ``number``, from 1, and write its tiles LEVEL-COLUMN-ROW.webp.

    It is called in a process of its own. Raises the errors of ``Job.page``.
    """
    with JobSource(path=job, dpi=dpi).open() as opened:
        page = opened.page(number)
    left = 255 - page.cmyk
    folder.mkdir(parents=True, exist_ok=True)
    rows, columns = left.shape[:2]
    scale = min(MOST_PIXELS / max(rows, columns), 1.0)
    size = max(round(columns * scale), 1), max(round(rows * scale), 1)
    inks = left if scale == 1 else cv2.resize(left, size, interpolation=cv2.INTER_AREA)
    picture = cv2.multiply(inks[..., :3], cv2.merge([inks[..., 3]] * 3), scale=1 / 255)
    levels = levels_of(*size)
    for level in range(levels - 1, -1, -1):
        _cut(picture, folder, level)
        half = max(-(-picture.shape[1] // 2), 1), max(-(-picture.shape[0] // 2), 1)
        picture = cv2.resize(picture, half, interpolation=cv2.INTER_AREA)
    raster = Raster(
        width=size[0], height=size[1], width_mm=page.width_mm, height_mm=page.height_mm, levels=levels
    )
    with whole_file(folder / FACTS) as unfinished:
        unfinished.write_text(json.dumps(asdict(raster)))


def _cut(picture: NDArray[np.uint8], folder: Path, level: int) -> None:
    for row in range(math.ceil(picture.shape[0] / TILE)):
        for column in range(math.ceil(picture.shape[1] / TILE)):
            part = picture[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE]
            with whole_file(folder / f"{level}-{column}-{row}.webp") as unfinished:
                unfinished.write_bytes(encoded(np.ascontiguousarray(part)))


class Rasters:
    """Rasters of all jobs, stored with the other pictures and within their bound."""

    version = VERSION
    tile_size = TILE

    def __init__(self, pictures: Pictures, folder: Path, *, bound_bytes: int) -> None:
        self._pictures, self._folder, self._bound_bytes = pictures, folder, bound_bytes
        self._making = threading.Lock()
        self._proposals = lru_cache(maxsize=MOST_CACHED)(self._proposed)

    def raster(self, job: Path, number: int, size_mm: tuple[float, float], job_digest: str) -> Raster:
        """Return the raster of a page, made now if needed; raises ``Problem`` 409 if it cannot be drawn."""
        folder = self._of(job_digest, number)
        with self._making:  # one at a time, since browsers may request the same page
            raster = _read(folder)
            if raster is None:
                dpi = min(DPI, MOST_PIXELS / (max(size_mm) / MM_PER_INCH))
                self._run(make_tiles, job, number, folder, dpi)
                tidy(self._folder, self._bound_bytes, keep=folder)
                raster = _read(folder)
            else:
                os.utime(folder)
        if raster is None:
            raise Problem(409, "unusable", f"page {number} of {job.name} could not be drawn")
        return raster

    def tile(self, job_digest: str, number: int, level: int, column: int, row: int) -> bytes:
        """Return a tile as WebP; raises ``Problem`` 404 if there is none, or the page was not drawn yet."""
        try:
            return (self._of(job_digest, number) / f"{level}-{column}-{row}.webp").read_bytes()
        except OSError as error:
            raise not_found(f"page {number} has no tile {level}/{column}/{row}") from error

    def proposals(self, job: Path, number: int, press: Path | None, stamp: tuple[Any, ...]) -> list[Proposal]:
        """Return ``proposals_of`` a page; raises ``Problem`` 409.

        stamp: state of job and press, a part of the cache's key.
        """
        return self._proposals(job, number, press, stamp)

    def _proposed(
        self, job: Path, number: int, press: Path | None, _stamp: tuple[Any, ...]
    ) -> list[Proposal]:
        return self._run(proposals_of, job, number, press, DPI)

    def _of(self, job_digest: str, number: int) -> Path:
        named = f"raster {job_digest} {number} {VERSION}"
        return self._folder / hashlib.sha256(named.encode()).hexdigest()[:32]

    def _run(self, work: Callable[..., Result], *given: Any) -> Result:
        """Run ``work`` in the process that makes pictures; its first arguments are job and page."""
        job, number = given[:2]
        try:
            return self._pictures.aside(work, *given)
        except Problem:
            raise
        except ProoflightError as error:
            raise Problem(409, "unusable", str(error)) from error
        except MAKING as error:
            _log.warning("page %d of %s cannot be drawn (%r)", number, job.name, error)
            what = f"page {number} of {job.name} could not be drawn; the console's log contains the reason"
            raise Problem(409, "unusable", f"{what}; check that the job opens in a viewer") from error


def _read(folder: Path) -> Raster | None:
    try:
        return Raster(**json.loads((folder / FACTS).read_text()))
    except (OSError, ValueError, TypeError):
        return None


# --- zones that a page proposes, which a person may accept or leave ---

Source = Literal["box", "layer", "annotation", "code"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """One zone that a page proposes."""

    source: Source
    zone: ZoneEntry


def proposals_of(job: Path, number: int, press: Path | None, dpi: float) -> list[Proposal]:
    """Return the proposals of page ``number``, from 1; called in a process of its own.

    The area outside the BleedBox and under annotations is proposed to be ignored; layers and bar codes to be
    careful. press: whose camera must read the codes; None for no codes. dpi: resolution of a page without a
    press. Raises the errors of ``Job.page`` and ``Press.load``.
    """
    loaded = None if press is None else Press.load(press)
    source = JobSource(path=job, dpi=dpi) if loaded is None else job_source(job, loaded)
    with source.open() as opened:
        size, marks = opened.page_size_mm(number), opened.marks(number)
        proposals = [] if marks is None else _of_marks(marks, number, size)
        if loaded is None:
            return proposals
        with contextlib.suppress(ProoflightError):  # this press cannot print the page: no codes
            proposals += [Proposal(source="code", zone=zone) for zone in code_zones(opened, number, loaded)]
    return proposals


def _of_marks(marks: PageMarks, number: int, size_mm: tuple[float, float]) -> list[Proposal]:
    outside = Rules(outside_bleed="ignore").entries(marks, number, size_mm)
    proposals = [Proposal(source="box", zone=zone) for zone in outside]
    named: list[tuple[Source, str, Box]] = [("layer", name, box) for name, box in marks.layers]
    named += [
        ("annotation", next(filter(None, reversed(names)), "annotation"), box)
        for names, box in marks.annotations
    ]
    for source, name, box in named:
        zone = entry_of(name, "careful" if source == "layer" else "ignore", box, number, size_mm)
        proposals += [] if zone is None else [Proposal(source=source, zone=zone)]
    return proposals
