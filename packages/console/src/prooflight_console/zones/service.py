"""Service for the zones of the console's jobs; it saves zones only with a price of exactly these."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from prooflight.detectors.optional import PricesZones
from prooflight.detectors.registry import detector
from prooflight.errors import JobError, ProoflightError
from prooflight.pages.job import JobSource
from prooflight.pages.zones.zones_file import CAREFUL_SHARE, JobZones
from prooflight_console.middleware import etag
from prooflight_console.problems import Problem, not_found
from prooflight_console.reading.stations import content_stamp, digest_of, press_of
from prooflight_console.reading.zones import zones_path
from prooflight_console.zones.pricing import PriceRequest

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from prooflight.pages.zones.zones_file import ZoneEntry
    from prooflight_console.accounts.account_store import Accounts
    from prooflight_console.accounts.roles import Who
    from prooflight_console.zones.prices import Prices, PriceTask

DPI: Final = 72.0
"""Resolution at which a job is opened for the sizes of its pages alone."""
MOST_NAMED: Final = 200
"""Largest number of zones that a row of the audit names."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenJob:
    """A job of the console."""

    number: int
    """Number from 1, in the order in which the jobs were given."""
    path: Path
    sizes_mm: tuple[tuple[float, float], ...]
    digest: str
    """Digest of the job's content."""

    @property
    def zones(self) -> Path:
        """Path of the job's zones, which may not exist yet."""
        return zones_path(self.path)


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenPress:
    """A press of the console that can price zones."""

    path: Path
    name: str
    digest: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ZonesAsSaved:
    """Zones in the job's file."""

    tag: str
    """Entity tag of the file's state, for If-Match."""
    zones: JobZones | None
    """Zones; None if there is no file, or it cannot be read."""
    trouble: str = ""


class ZonesService:
    """Zones of one console's jobs. The methods are thread-safe."""

    def __init__(
        self, *, jobs: Sequence[Path], presses: Sequence[Path], prices: Prices, accounts: Accounts
    ) -> None:
        self._jobs, self._presses = tuple(jobs), tuple(presses)
        self.prices, self._accounts = prices, accounts
        self._saving = threading.Lock()

    def jobs(self) -> list[tuple[int, Path]]:
        """Return the numbers and files of all jobs."""
        return list(enumerate(self._jobs, start=1))

    def job(self, number: int) -> GivenJob:
        """Return a job; raises ``Problem`` 404 if there is none of that number, 409 if it cannot be read."""
        if not 1 <= number <= len(self._jobs):
            raise not_found(f"the console was started without a job {number}")
        path = self._jobs[number - 1]
        try:
            stamp = content_stamp(path)
            return GivenJob(
                number=number, path=path, sizes_mm=_sizes(path, stamp), digest=digest_of(path, stamp)
            )
        except OSError as error:
            raise Problem(409, "unusable", f"{path.name} cannot be read ({error.strerror})") from error

    def presses(self) -> list[GivenPress]:
        """Return the presses with a trained detector of our own, without which nothing can be priced."""
        presses = []
        for path in self._presses:
            try:
                press = _press(path, content_stamp(path))
            except (OSError, ProoflightError):
                continue
            if press is not None:
                presses.append(press)
        return presses

    def press(self, digest: str | None) -> GivenPress:
        """Return a press by its digest, or the first for None; raises ``Problem`` 409 if there is none."""
        for press in self.presses():
            if digest in (None, press.digest):
                return press
        which = "of that digest" if digest else "that was trained for the matched filter"
        raise Problem(
            409, "no-press", f"the console was started without a press {which}; start it with --press"
        )

    def saved(self, job: GivenJob) -> ZonesAsSaved:
        """Return the zones in the job's file."""
        try:
            content = job.zones.read_bytes()
        except FileNotFoundError:
            return ZonesAsSaved(tag=etag("no zones", job.digest), zones=None)
        except OSError as error:
            return ZonesAsSaved(tag=etag("unread", job.digest), zones=None, trouble=str(error))
        tag = etag(content, job.digest)
        try:
            return ZonesAsSaved(tag=tag, zones=JobZones.read(job.zones, job.sizes_mm))
        except ProoflightError as error:
            return ZonesAsSaved(tag=tag, zones=None, trouble=str(error))

    def drawn(
        self, job: GivenJob, entries: Sequence[ZoneEntry], careful_share: float = CAREFUL_SHARE
    ) -> JobZones:
        """Return zones as a person drew them; raises ``Problem`` 422 if they are not valid."""
        try:
            return JobZones.create(entries, job.sizes_mm, careful_share=careful_share)
        except JobError as error:
            raise Problem(422, "zones", str(error)) from error

    def price(
        self, job: GivenJob, zones: JobZones, press: GivenPress, *, prints: int, trials: int, by: str
    ) -> PriceTask:
        """Begin to compute a price; raises ``Problem`` 409 if another is being computed."""
        request = PriceRequest(
            job=job.path, press=press.path, zones=zones.unpriced(), prints=prints, trials=trials
        )
        return self.prices.begin(
            request, job=job.number, job_digest=job.digest, press_digest=press.digest, by=by
        )

    def save(
        self,
        job: GivenJob,
        zones: JobZones,
        press: GivenPress,
        *,
        tag: str,
        who: Who,
    ) -> ZonesAsSaved:
        """Put zones in force, with the price that was computed of exactly these.

        Raises ``Problem`` 409 if there is no price, 412 if the file has changed, and 503 if it cannot be
        written.
        """
        task = self.prices.completed(
            job_digest=job.digest, zones_digest=zones.zones_digest, press_digest=press.digest
        )
        if task is None or task.priced is None:
            raise Problem(409, "unpriced", "these zones have no price on this press: request it first")
        return self._written(job, zones.priced(task.priced.entry), tag=tag, who=who)

    def remove(self, job: GivenJob, *, tag: str, who: Who) -> ZonesAsSaved:
        """Remove all zones, for which no price is needed; raises ``Problem`` as ``save``."""
        return self._written(job, None, tag=tag, who=who)

    def _written(self, job: GivenJob, zones: JobZones | None, *, tag: str, who: Who) -> ZonesAsSaved:
        with self._saving:
            before = self.saved(job)
            if tag != before.tag:
                raise Problem(
                    412, "changed", "zones of this job were saved by someone else meanwhile: load them first"
                )
            # Record in the audit first, so that nothing is ever in force without a record.
            self._accounts.note(
                who.name,
                "zones.remove" if zones is None else "zones.save",
                job.zones.name,
                before=_summary(before.zones),
                after=_summary(zones),
            )
            try:
                if zones is None:
                    job.zones.unlink(missing_ok=True)
                else:
                    zones.save(job.zones)
            except OSError as error:
                self._accounts.note(who.name, "zones.unsaved", job.zones.name, after={"why": str(error)})
                raise Problem(
                    503, "unsaved", f"{job.zones.name} cannot be written ({error.strerror})"
                ) from error
            return self.saved(job)


def _summary(zones: JobZones | None) -> dict[str, Any]:
    """Return a summary of zones for the audit."""
    if zones is None:
        return {"zones": [], "digest": ""}
    named = [
        f"{one.name}: {one.kind}, {one.pages}, {' '.join(f'{part:g}' for part in one.rectangle_mm)} mm"
        if one.rectangle_mm is not None
        else f"{one.name}: {one.kind}, {one.pages}, {len(one.polygon_mm or ())} corners"
        for one in zones.document.zones
    ]
    rest = [] if len(named) <= MOST_NAMED else [f"and {len(named) - MOST_NAMED} more"]
    return {"zones": [*named[:MOST_NAMED], *rest], "digest": zones.digest[:16]}


@lru_cache(maxsize=64)
def _sizes(path: Path, _stamp: tuple[int, ...]) -> tuple[tuple[float, float], ...]:
    with JobSource(path=path, dpi=DPI).open() as opened:
        return opened.page_sizes_mm


@lru_cache(maxsize=16)
def _press(path: Path, stamp: tuple[int, ...]) -> GivenPress | None:
    loaded, digest = press_of(path, stamp)
    if not isinstance(detector(None, loaded), PricesZones):
        return None
    return GivenPress(path=path, name=loaded.name, digest=digest)
