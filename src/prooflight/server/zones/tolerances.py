"""Tolerances of a job: what its false alarms propose, granted as an ignored zone with its price, and taken back."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.errors import RequestError
from prooflight.line.granting import granted, is_tolerance, with_zone, without_zone
from prooflight.server.problems import Problem, not_found

if TYPE_CHECKING:
    from prooflight.line.tolerances import Proposal
    from prooflight.pages.zones.zones_file import JobZones, ZoneEntry
    from prooflight.server.accounts.roles import Who
    from prooflight.server.reading.incidents import RunIncidents
    from prooflight.server.reading.runs import Reading
    from prooflight.server.zones.desk import GivenJob, GivenPress, ZonesAsSaved, ZonesDesk

ID_LENGTH: Final = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposed:
    """A tolerance that could be granted."""

    id: str
    """Of its kind, place and pages: whoever grants it grants this zone and no other."""
    proposal: Proposal
    zone: ZoneEntry | None
    """As it would lie in the job's zones; None: it cannot."""
    trouble: str = ""


class Tolerances:
    """Of the jobs that the console was given. Its methods may be called from several threads."""

    def __init__(self, desk: ZonesDesk, reading: Reading, incidents: RunIncidents) -> None:
        self._desk, self._reading, self._incidents = desk, reading, incidents

    def proposed(self, job: GivenJob, *, last: int) -> list[Proposed]:
        """By those of the last runs that printed this job; most false alarms first. JournalError."""
        runs = self._reading.runs(before=None, limit=last, damaged=lambda _: None)
        own = [run for run in reversed(runs) if run.facts.job_digest == job.digest]
        return [_proposed(one, job) for one in self._incidents.proposals(own)]

    def granted(self, job: GivenJob) -> list[ZoneEntry]:
        """As they lie in the job's zones, whether these are in force or not."""
        known = self._desk.saved(job).zones
        return [] if known is None else [one for one in known.document.zones if is_tolerance(one)]

    def with_granted(self, job: GivenJob, wanted: str, *, last: int) -> tuple[JobZones, Proposal]:
        """The job's zones and one more, and what proposed it; ``Problem`` 404: nothing of that id is proposed.

        RequestError: it was granted already, or cannot lie in this job.
        """
        found = next((one for one in self.proposed(job, last=last) if one.id == wanted), None)
        if found is None:
            raise not_found(f"no tolerance {wanted!r} is proposed, or no longer")
        known = self._known(job)
        entries = with_zone(known, granted(found.proposal, job.sizes_mm))
        return self._drawn(job, known, entries), found.proposal

    def without(self, job: GivenJob, name: str) -> JobZones | None:
        """The job's zones but that one; None: it is the last. ``Problem`` 404: no tolerance is called so."""
        known = self._known(job)
        if known is None or name not in {one.name for one in self.granted(job)}:
            raise not_found(f"no tolerance of this job is called {name[:80]!r}")
        left = without_zone(known, name)
        return self._drawn(job, known, left) if left else None

    def grant(
        self, job: GivenJob, wanted: str, press: GivenPress, *, last: int, tag: str, who: Who
    ) -> ZonesAsSaved:
        """Put it in force; as ``with_granted`` and ``ZonesDesk.save``. The audit has what it was said to cost."""
        zones, proposal = self.with_granted(job, wanted, last=last)
        about = {"tolerance": zones.document.zones[-1].name, "proposed": list(proposal.told)}
        return self._desk.save(job, zones, press, tag=tag, who=who, what="tolerances.grant", about=about)

    def drop(self, job: GivenJob, name: str, press: str | None, *, tag: str, who: Who) -> ZonesAsSaved:
        """Take it back; as ``without`` and ``ZonesDesk.save``: what is left needs a price, unless nothing is."""
        left, what, about = self.without(job, name), "tolerances.drop", {"tolerance": name}
        if left is None:
            return self._desk.remove(job, tag=tag, who=who, what=what, about=about)
        return self._desk.save(job, left, self._desk.press(press), tag=tag, who=who, what=what, about=about)

    def _known(self, job: GivenJob) -> JobZones | None:
        saved = self._desk.saved(job)
        if saved.trouble:
            raise Problem(409, "unusable", saved.trouble)
        return saved.zones

    def _drawn(self, job: GivenJob, known: JobZones | None, entries: tuple[ZoneEntry, ...]) -> JobZones:
        share = {} if known is None else {"careful_share": known.document.careful_share}
        return self._desk.drawn(job, entries, **share)


def _proposed(proposal: Proposal, job: GivenJob) -> Proposed:
    named = json.dumps([proposal.kind, proposal.box_mm, proposal.pages])
    made = hashlib.sha256(named.encode()).hexdigest()[:ID_LENGTH]
    try:
        return Proposed(id=made, proposal=proposal, zone=granted(proposal, job.sizes_mm))
    except RequestError as error:
        return Proposed(id=made, proposal=proposal, zone=None, trouble=str(error))
