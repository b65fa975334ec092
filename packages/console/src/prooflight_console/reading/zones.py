"""Zones of the console's jobs, in a file next to each job: ``JOB.zones.json``."""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import ProoflightError
from prooflight.pages.job import JobSource
from prooflight.pages.memory import file_stamp
from prooflight.pages.zones.zones_file import JobZones
from prooflight.reporting.zones_picture import zones_picture

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.pages.zones.zones_file import ZoneEntry

SUFFIX: Final = ".zones.json"
DPI: Final = 100.0
"""Resolution of the page in the picture."""
SORTS: Final = (("spot", "mm"), ("streak", "%"), ("density", "%"))
"""Sorts of defects in a price, with their units."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ZonesFacts:
    """Zones of one job; with ``trouble``, why they cannot be read, the other fields are empty."""

    job: str
    file: str
    trouble: str = ""
    zones: tuple[ZoneEntry, ...] = ()
    contested: tuple[str, ...] = ()
    prints: int | None = None
    """Number of good prints from which they were priced; None if they are not in force."""
    told: tuple[dict[str, Any], ...] = ()
    """Rows of the price, as ``PriceEntry.told``."""
    digest: str = ""


def zones_path(job: Path) -> Path:
    """Return the path of the zones of a job."""
    return job.with_name((job.name if job.is_dir() else job.stem) + SUFFIX)


def zones_facts(job: Path) -> ZonesFacts | None:
    """Return the zones of one job; None if no file of zones is next to it."""
    path = zones_path(job)
    if not path.is_file():
        return None
    try:
        zones = _zones(job, path, _stamps(job, path))
    except (OSError, ProoflightError) as error:
        return ZonesFacts(job=job.name, file=path.name, trouble=str(error))
    price = zones.document.price
    return ZonesFacts(
        job=job.name,
        file=path.name,
        zones=zones.document.zones,
        contested=tuple(zones.contested()),
        prints=None if price is None or price.zones != zones.zones_digest else price.prints,
        told=() if price is None else price.told,
        digest=zones.digest,
    )


def zones_drawing(job: Path) -> bytes | None:
    """Return a PNG of the first page that has zones; None if there are none, or they cannot be drawn."""
    path = zones_path(job)
    try:
        return _drawn(job, path, _stamps(job, path))
    except (OSError, ProoflightError):
        return None


def _stamps(job: Path, path: Path) -> tuple[Any, ...]:
    stamp = (job.stat().st_mtime_ns,) if job.is_dir() else tuple(file_stamp(job))
    return (*stamp, *file_stamp(path))


@lru_cache(maxsize=16)
def _zones(job: Path, path: Path, _stamps: tuple[Any, ...]) -> JobZones:
    with JobSource(path=job, dpi=DPI).open() as opened:
        return JobZones.read(path, opened.page_sizes_mm)


@lru_cache(maxsize=4)
def _drawn(job: Path, path: Path, stamps: tuple[Any, ...]) -> bytes:
    zones = _zones(job, path, stamps)
    number = next(iter(zones.of_pages))
    with JobSource(path=job, dpi=DPI).open() as opened:
        picture = zones_picture(opened.page(number), zones.of_pages[number])
    file = io.BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()
