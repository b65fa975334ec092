"""Zones of the jobs that the console was given: read, priced, and saved only with a price of exactly what is saved."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from prooflight.errors import JobError, ProoflightError
from prooflight.pages.job import JobSource
from prooflight.pages.zones.zones_file import CAREFUL_SHARE, JobZones
from prooflight.server.headers import etag
from prooflight.server.problems import Problem, not_found
from prooflight.server.reading.stations import content_stamp, digest_of, press_of
from prooflight.server.reading.zones import zones_beside
from prooflight.server.zones.pricing import PriceRequest

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from prooflight.pages.zones.zones_file import ZoneEntry
    from prooflight.server.accounts.book import Accounts
    from prooflight.server.accounts.roles import Who
    from prooflight.server.zones.prices import Prices, PriceTask

DPI: Final = 72.0
"""Where only the sizes of pages are asked."""
TOLD: Final = 200
"""Zones that a row of the audit names."""
NOTHING: Final[Mapping[str, Any]] = MappingProxyType({})


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenJob:
    """A job that the console was given."""

    number: int
    """From 1, in the order in which they were given."""
    path: Path
    sizes_mm: tuple[tuple[float, float], ...]
    digest: str
    """Of its content."""

    @property
    def zones(self) -> Path:
        """Where its zones lie, or will."""
        return zones_beside(self.path)


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenPress:
    """A press that the console was given, and that can price zones."""

    path: Path
    name: str
    digest: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ZonesAsSaved:
    """What the file says."""

    tag: str
    """Of the file as it stands, for If-Match."""
    zones: JobZones | None
    """None: there is no file, or it cannot be read."""
    trouble: str = ""


class ZonesDesk:
    """Of one console. Its methods may be called from several threads."""

    def __init__(
        self, *, jobs: Sequence[Path], presses: Sequence[Path], prices: Prices, accounts: Accounts
    ) -> None:
        self._jobs, self._presses = tuple(jobs), tuple(presses)
        self.prices, self._accounts = prices, accounts
        self._saving = threading.Lock()

    def jobs(self) -> list[tuple[int, Path]]:
        """Numbers and files of all jobs."""
        return list(enumerate(self._jobs, start=1))

    def job(self, number: int) -> GivenJob:
        """``Problem`` 404: there is none of that number; 409: it cannot be read."""
        if not 1 <= number <= len(self._jobs):
            raise not_found(f"the console was given no job {number}")
        path = self._jobs[number - 1]
        try:
            stamp = content_stamp(path)
            return GivenJob(
                number=number, path=path, sizes_mm=_sizes(path, stamp), digest=digest_of(path, stamp)
            )
        except OSError as error:
            raise Problem(409, "unusable", f"{path.name} cannot be read ({error.strerror})") from error

    def presses(self) -> list[GivenPress]:
        """Those that were taught our detector, without which nothing can be priced."""
        found = []
        for path in self._presses:
            try:
                known = _press(path, content_stamp(path))
            except (OSError, ProoflightError):
                continue
            if known is not None:
                found.append(known)
        return found

    def press(self, digest: str | None) -> GivenPress:
        """By its digest; None: the first. ``Problem`` 409: there is none."""
        for known in self.presses():
            if digest in (None, known.digest):
                return known
        which = "of that digest" if digest else "that was taught our detector"
        raise Problem(409, "no-press", f"the console was given no press {which}; start it with --press")

    def saved(self, job: GivenJob) -> ZonesAsSaved:
        """As the file stands."""
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
        """Zones as somebody drew them; ``Problem`` 422: they cannot be."""
        try:
            return JobZones.made(entries, job.sizes_mm, careful_share=careful_share)
        except JobError as error:
            raise Problem(422, "zones", str(error)) from error

    def price(
        self, job: GivenJob, zones: JobZones, press: GivenPress, *, prints: int, trials: int, by: str
    ) -> PriceTask:
        """Begin a price; ``Problem`` 409: another is being made."""
        asked = PriceRequest(
            job=job.path, press=press.path, zones=zones.unpriced(), prints=prints, trials=trials
        )
        return self.prices.begin(
            asked, job=job.number, job_digest=job.digest, press_digest=press.digest, by=by
        )

    def save(
        self,
        job: GivenJob,
        zones: JobZones,
        press: GivenPress,
        *,
        tag: str,
        who: Who,
        what: str = "zones.save",
        about: Mapping[str, Any] = NOTHING,
    ) -> ZonesAsSaved:
        """Put zones in force, with the price that was made of exactly these. what, about: for the audit.

        ``Problem`` 409: there is none; 412: the file is not what it was; 503: it cannot be written.
        """
        made = self.prices.made(
            job_digest=job.digest, zones_digest=zones.zones_digest, press_digest=press.digest
        )
        if made is None or made.priced is None:
            raise Problem(409, "unpriced", "these zones have no price on this press: ask for it first")
        priced = zones.priced(made.priced.entry)
        return self._written(job, priced, tag=tag, who=who, what=what, about=about)

    def remove(
        self,
        job: GivenJob,
        *,
        tag: str,
        who: Who,
        what: str = "zones.remove",
        about: Mapping[str, Any] = NOTHING,
    ) -> ZonesAsSaved:
        """Take all zones away: the press's promise needs no price. ``Problem`` as ``save``."""
        return self._written(job, None, tag=tag, who=who, what=what, about=about)

    def _written(
        self,
        job: GivenJob,
        zones: JobZones | None,
        *,
        tag: str,
        who: Who,
        what: str,
        about: Mapping[str, Any],
    ) -> ZonesAsSaved:
        with self._saving:
            before = self.saved(job)
            if tag != before.tag:
                raise Problem(
                    412, "changed", "somebody has saved zones of this job meanwhile: read them first"
                )
            # In the audit first: nothing is ever in force of which it does not know.
            after = {**about, **_told(zones)}
            self._accounts.note(who.name, what, job.zones.name, before=_told(before.zones), after=after)
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


def _told(zones: JobZones | None) -> dict[str, Any]:
    """For the audit."""
    if zones is None:
        return {"zones": [], "digest": ""}
    named = [
        f"{one.name}: {one.kind}, {one.pages}, {' '.join(f'{part:g}' for part in one.rectangle_mm)} mm"
        if one.rectangle_mm is not None
        else f"{one.name}: {one.kind}, {one.pages}, {len(one.polygon_mm or ())} corners"
        for one in zones.document.zones
    ]
    rest = [] if len(named) <= TOLD else [f"and {len(named) - TOLD} more"]
    return {"zones": [*named[:TOLD], *rest], "digest": zones.digest[:16]}


@lru_cache(maxsize=64)
def _sizes(path: Path, _stamp: tuple[int, ...]) -> tuple[tuple[float, float], ...]:
    with JobSource(path=path, dpi=DPI).open() as opened:
        return opened.page_sizes_mm


@lru_cache(maxsize=16)
def _press(path: Path, stamp: tuple[int, ...]) -> GivenPress | None:
    loaded, digest = press_of(path, stamp)
    return None if loaded.ours is None else GivenPress(path=path, name=loaded.name, digest=digest)
