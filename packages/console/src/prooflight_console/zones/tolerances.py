"""Tolerances of a job: proposed by its false alarms, granted as ignored zones with a price, withdrawn."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight_console.problems import Problem, not_found
from prooflight_line.run.granting import granted, is_tolerance, with_zone

if TYPE_CHECKING:
    from prooflight.pages.zones.zones_file import JobZones, ZoneEntry
    from prooflight_console.accounts.roles import Who
    from prooflight_console.reading.incidents import RunIncidents
    from prooflight_console.reading.runs import Reading
    from prooflight_console.zones.service import GivenJob, GivenPress, ZonesAsSaved, ZonesService
    from prooflight_line.run.tolerances import Proposal

ID_LENGTH: Final = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposed:
    """A tolerance that could be granted."""

    id: str
    """Digest of kind, place and pages: a grant by it applies to this zone and no other."""
    proposal: Proposal
    zone: ZoneEntry | None
    """Zone that a grant would add to the job's zones; None if it cannot be added."""
    trouble: str = ""


class Tolerances:
    """Tolerances of the console's jobs. The methods are thread-safe."""

    def __init__(self, zones_service: ZonesService, reading: Reading, incidents: RunIncidents) -> None:
        self._zones, self._reading, self._incidents = zones_service, reading, incidents

    def proposed(self, job: GivenJob, *, last: int) -> list[Proposed]:
        """Return proposals by the last runs that printed this job, most false alarms first.

        Raises JournalError if the journal cannot be read.
        """
        runs = self._reading.runs(before=None, limit=last, damaged=lambda _: None)
        own = [run for run in reversed(runs) if run.facts.job_digest == job.digest]
        return [_proposed(one, job) for one in self._incidents.proposals(own)]

    def granted(self, job: GivenJob) -> list[ZoneEntry]:
        """Return the tolerances among the job's zones, whether these are in force or not."""
        stored = self._zones.saved(job).zones
        return [] if stored is None else [one for one in stored.document.zones if is_tolerance(one)]

    def with_granted(self, job: GivenJob, wanted: str, *, last: int) -> tuple[JobZones, Proposal]:
        """Return the job's zones with one tolerance more, and the proposal of it.

        Raises ``Problem`` 404 if nothing of that id is proposed, and RequestError if it was granted already
        or does not fit this job.
        """
        proposed = next((one for one in self.proposed(job, last=last) if one.id == wanted), None)
        if proposed is None:
            raise not_found(f"no tolerance {wanted!r} is proposed, or no longer")
        stored = self._stored(job)
        entries = with_zone(stored, granted(proposed.proposal, job.sizes_mm))
        return self._drawn(job, stored, entries), proposed.proposal

    def without(self, job: GivenJob, name: str) -> JobZones | None:
        """Return the job's zones without one tolerance; None if it is the last zone.

        Raises ``Problem`` 404 if there is no tolerance of that name.
        """
        stored = self._stored(job)
        if stored is None or name not in {one.name for one in self.granted(job)}:
            raise not_found(f"no tolerance of this job is called {name[:80]!r}")
        left = stored.without(name)
        return self._drawn(job, stored, left) if left else None

    def grant(
        self, job: GivenJob, wanted: str, press: GivenPress, *, last: int, tag: str, who: Who
    ) -> ZonesAsSaved:
        """Grant a tolerance; the audit records the figures of its proposal.

        Raises as ``with_granted`` and ``ZonesService.save``.
        """
        zones, proposal = self.with_granted(job, wanted, last=last)
        about = {"tolerance": zones.document.zones[-1].name, "proposed": list(proposal.sentences)}
        return self._zones.save(job, zones, press, tag=tag, who=who, what="tolerances.grant", about=about)

    def drop(self, job: GivenJob, name: str, press: str | None, *, tag: str, who: Who) -> ZonesAsSaved:
        """Withdraw a tolerance, after which zones that are left need a price.

        Raises as ``without`` and ``ZonesService.save``.
        """
        left, what, about = self.without(job, name), "tolerances.drop", {"tolerance": name}
        if left is None:
            return self._zones.remove(job, tag=tag, who=who, what=what, about=about)
        return self._zones.save(job, left, self._zones.press(press), tag=tag, who=who, what=what, about=about)

    def _stored(self, job: GivenJob) -> JobZones | None:
        saved = self._zones.saved(job)
        if saved.trouble:
            raise Problem(409, "unusable", saved.trouble)
        return saved.zones

    def _drawn(self, job: GivenJob, stored: JobZones | None, entries: tuple[ZoneEntry, ...]) -> JobZones:
        share = {} if stored is None else {"careful_share": stored.document.careful_share}
        return self._zones.drawn(job, entries, **share)


def _proposed(proposal: Proposal, job: GivenJob) -> Proposed:
    named = json.dumps([proposal.kind, proposal.box_mm, proposal.pages])
    proposal_id = hashlib.sha256(named.encode()).hexdigest()[:ID_LENGTH]
    try:
        return Proposed(id=proposal_id, proposal=proposal, zone=granted(proposal, job.sizes_mm))
    except RequestError as error:
        return Proposed(id=proposal_id, proposal=proposal, zone=None, trouble=str(error))
