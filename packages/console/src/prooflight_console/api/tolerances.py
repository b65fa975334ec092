"""Tolerances that recurring false alarms of a job propose, each as the zone that would grant it."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

from fastapi import APIRouter, Query, Request
from pydantic import Field

from prooflight.errors import RequestError
from prooflight_console.api.common import PREFIX, JobNumber, Viewer, console
from prooflight_console.api.schemas import Answer
from prooflight_console.api.zones import ZoneBody, zone_body
from prooflight_console.problems import responses
from prooflight_line.run.tolerances import granted

if TYPE_CHECKING:
    from prooflight_console.zones.service import GivenJob
    from prooflight_line.run.tolerances import Proposal

router = APIRouter(prefix=PREFIX, tags=["tolerances"])

LastRuns = Annotated[int, Query(ge=1, le=200, description="Number of last runs to analyse.")]


class ToleranceAnswer(Answer):
    """A tolerance proposed by false alarms of one kind at one place; see `prooflight run tolerances`."""

    kind: str
    box_mm: list[float]
    where: str
    pages: list[str]
    runs: list[int]
    sheets: int = Field(description="False alarms that it would have suppressed.")
    up_to_score: float
    misprints_lost: int = Field(description="Labelled misprints that would have passed there.")
    misprints_kept: int
    untold: int = Field(description="Unlabelled alarms there.")
    zone: ZoneBody | None = Field(
        description="Zone that grants it, to be priced and saved with the job's others."
    )
    granted: bool = Field(description="Whether the job's zones have it.")
    trouble: str = Field("", description="Reason why it cannot be granted; empty: it can.")


class TolerancesAnswer(Answer):
    """Proposed tolerances of a job, most false alarms first."""

    items: list[ToleranceAnswer]


@router.get("/jobs/{job}/tolerances", responses=responses(401, 403, 404, 409, 422, 503))
def tolerances(request: Request, _who: Viewer, job: JobNumber, runs: LastRuns = 20) -> TolerancesAnswer:
    """List the tolerances that the last runs of this job propose, which nothing applies."""
    state = console(request)
    given = state.zones.job(job)
    stored = state.zones.saved(given).zones
    names = set() if stored is None else {one.name for one in stored.document.zones}
    last = state.reading.runs(before=None, limit=runs, damaged=lambda _: None)
    own = [run for run in reversed(last) if run.facts.job_digest == given.digest]
    return TolerancesAnswer(items=[_answer(one, given, names) for one in state.incidents.proposals(own)])


def _answer(proposal: Proposal, job: GivenJob, names: set[str]) -> ToleranceAnswer:
    try:
        zone, trouble = zone_body(granted(proposal, job.sizes_mm)), ""
    except RequestError as error:
        zone, trouble = None, str(error)
    is_granted = zone is not None and zone.name in names
    return ToleranceAnswer(**asdict(proposal), zone=zone, granted=is_granted, trouble=trouble)
