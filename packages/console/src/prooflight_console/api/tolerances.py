"""Tolerances of jobs: proposed by recurring false alarms, granted with a price, and withdrawn."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Self

from fastapi import APIRouter, Path, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field, model_validator

from prooflight_console.api.common import PREFIX, JobNumber, Viewer, ZonesEngineer, console
from prooflight_console.api.schemas import Answer
from prooflight_console.api.zones import (
    IfMatch,
    PriceAnswer,
    PriceSize,
    ZoneBody,
    ZonesAnswer,
    meant,
    price_answer,
    zone_body,
    zones_answer,
)
from prooflight_console.problems import Problem, responses

router = APIRouter(prefix=PREFIX, tags=["tolerances"])

MOST_RUNS = 200
CHANGES = responses(400, 401, 403, 404, 409, 412, 422, 428, 503)
LastRuns = Annotated[int, Query(ge=1, le=MOST_RUNS, description="Look at the last so many runs.")]
ProposalId = Annotated[str, Field(min_length=1, max_length=40, description="`id` of what is proposed.")]
PressDigest = Annotated[str | None, Field(max_length=64, description="Null: the first that can.")]
ZoneName = Annotated[str, Path(alias="name", max_length=255)]


class ToleranceAnswer(Answer):
    """A tolerance proposed by false alarms of one kind at one place; see `prooflight run tolerances`."""

    id: str
    kind: str
    box_mm: list[float]
    where: str
    pages: list[str]
    runs: list[int]
    sheets: int = Field(description="False alarms that it would have kept silent.")
    up_to_score: float
    misprints_lost: int = Field(description="Told misprints that would have passed there.")
    misprints_kept: int
    untold: int = Field(description="Alarms there about which nobody has said anything.")
    zone: ZoneBody | None = Field(description="What it would be; all that is printed there passes.")
    granted: bool
    trouble: str = Field("", description="Why it cannot be granted; empty: it can.")


class TolerancesAnswer(Answer):
    """Tolerances of a job. `ETag` names the state of its zones, which a change must send."""

    granted: list[ZoneBody]
    in_force: bool = Field(description="Whether the job's zones have a price.")
    proposed: list[ToleranceAnswer]


class GrantBody(BaseModel):
    """A tolerance to grant."""

    model_config = ConfigDict(extra="forbid")
    proposal: ProposalId
    press: PressDigest = None
    runs: int = Field(20, ge=1, le=MOST_RUNS, description="As the proposals were asked for.")


class TolerancePriceBody(PriceSize):
    """A change to price: a tolerance that is granted, or one that is withdrawn."""

    model_config = ConfigDict(extra="forbid")
    grant: ProposalId | None = None
    drop: Annotated[str, Field(max_length=255)] | None = Field(None, description="Name of a tolerance.")
    press: PressDigest = None
    runs: int = Field(20, ge=1, le=MOST_RUNS, description="As the proposals were asked for.")

    @model_validator(mode="after")
    def one_of_them(self) -> Self:
        """Check that exactly one of ``grant`` and ``drop`` is given."""
        if (self.grant is None) == (self.drop is None):
            raise ValueError("give grant or drop, and not both")
        return self


@router.get("/jobs/{job}/tolerances", responses=responses(401, 403, 404, 409, 422, 503))
def tolerances(
    request: Request, response: Response, _who: Viewer, job: JobNumber, runs: LastRuns = 20
) -> TolerancesAnswer:
    """List granted tolerances, and those proposed by the last runs of this job, which nothing applies."""
    state = console(request)
    given = state.zones.job(job)
    saved = state.zones.saved(given)
    names = {one.name for one in state.tolerances.granted(given)}
    response.headers["ETag"] = saved.tag
    return TolerancesAnswer(
        granted=[zone_body(one) for one in state.tolerances.granted(given)],
        in_force=zones_answer(given, saved).in_force,
        proposed=[
            ToleranceAnswer(
                id=one.id,
                **asdict(one.proposal),
                zone=None if one.zone is None else zone_body(one.zone),
                granted=one.zone is not None and one.zone.name in names,
                trouble=one.trouble,
            )
            for one in state.tolerances.proposed(given, last=runs)
        ],
    )


@router.post(
    "/jobs/{job}/tolerances/prices", status_code=202, responses=responses(400, 401, 403, 404, 409, 422, 503)
)
def ask_price(request: Request, who: ZonesEngineer, job: JobNumber, given: TolerancePriceBody) -> PriceAnswer:
    """Begin a price of the job's zones as they would be with a tolerance granted or withdrawn."""
    state = console(request)
    given_job = state.zones.job(job)
    if given.grant is not None:
        zones, _ = state.tolerances.with_granted(given_job, given.grant, last=given.runs)
    else:
        left = state.tolerances.without(given_job, given.drop or "")
        if left is None:
            raise Problem(409, "no-price", "it is the job's last zone: taking it back needs no price")
        zones = left
    press = state.zones.press(given.press)
    return price_answer(
        state.zones.price(given_job, zones, press, prints=given.prints, trials=given.trials, by=who.name)
    )


@router.post("/jobs/{job}/tolerances", status_code=201, responses=CHANGES)
def grant(
    request: Request,
    response: Response,
    who: ZonesEngineer,
    job: JobNumber,
    given: GrantBody,
    if_match: IfMatch = None,
) -> ZonesAnswer:
    """Put a proposed tolerance in force. A price of it must exist already."""
    state = console(request)
    given_job = state.zones.job(job)
    press = state.zones.press(given.press)
    saved = state.tolerances.grant(
        given_job, given.proposal, press, last=given.runs, tag=meant(if_match), who=who
    )
    response.headers["ETag"] = saved.tag
    return zones_answer(given_job, saved)


@router.delete("/jobs/{job}/tolerances/{name}", responses=CHANGES)
def drop(
    request: Request,
    response: Response,
    who: ZonesEngineer,
    job: JobNumber,
    name: ZoneName,
    press: Annotated[str | None, Query(max_length=64, description="Null: the first that can.")] = None,
    if_match: IfMatch = None,
) -> ZonesAnswer:
    """Withdraw a tolerance. The zones that are left must have a price, unless none is left."""
    state = console(request)
    given_job = state.zones.job(job)
    saved = state.tolerances.drop(given_job, name, press, tag=meant(if_match), who=who)
    response.headers["ETag"] = saved.tag
    return zones_answer(given_job, saved)
