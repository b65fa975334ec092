"""Zones of jobs: pages to draw on, proposals, prices, and saving, which requires a price."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal

import anyio
from fastapi import APIRouter, Header, Path, Query, Request, Response
from pydantic import BaseModel, Field

from prooflight.pages.zones.zone import Kind
from prooflight.pages.zones.zones_file import CAREFUL_SHARE, ZoneEntry
from prooflight_console.api.common import (
    PREFIX,
    JobNumber,
    PageNumber,
    TileLevel,
    TilePlace,
    Viewer,
    ZonesEngineer,
    console,
    etag,
    not_modified,
    unchanged,
)
from prooflight_console.api.schemas import Answer
from prooflight_console.problems import Problem, binary, not_found, responses
from prooflight_console.zones.prices import PriceTask
from prooflight_console.zones.service import GivenJob, ZonesAsSaved

router = APIRouter(prefix=PREFIX, tags=["zones"])

A_WHILE = "private, max-age=3600"
ONE = responses(401, 403, 404, 409, 422)
MOST_ZONES = 2000
LONGEST_WAIT_S = 20.0
POLL_S = 0.2
PriceId = Annotated[str, Path(alias="price", max_length=40)]
IfMatch = Annotated[
    str | None, Header(alias="If-Match", max_length=200, description="`ETag` of the zones that were loaded.")
]
Share = Annotated[float, Field(gt=0, le=0.5, allow_inf_nan=False)]
Millimetres = Annotated[float, Field(ge=-10_000, le=10_000, allow_inf_nan=False)]


class ZoneBody(BaseModel):
    """One zone; either a rectangle or a polygon."""

    name: str = Field(min_length=1, max_length=255)
    kind: Kind
    pages: str = Field("all", max_length=1000, description="Pages of the job, such as 1,4-6; all.")
    rectangle_mm: list[Millimetres] | None = Field(
        None, min_length=4, max_length=4, description="x, y, width and height on the page as printed."
    )
    polygon_mm: list[Annotated[list[Millimetres], Field(min_length=2, max_length=2)]] | None = Field(
        None, min_length=3, max_length=200, description="Corners, x and y."
    )

    def entry(self) -> ZoneEntry:
        """Return the zone as an entry of the file; raises ``Problem`` 422."""
        corners, rectangle = self.polygon_mm, self.rectangle_mm
        try:
            return ZoneEntry(
                name=self.name,
                kind=self.kind,
                pages=self.pages,
                rectangle_mm=None
                if rectangle is None
                else (rectangle[0], rectangle[1], rectangle[2], rectangle[3]),
                polygon_mm=None if corners is None else tuple((x, y) for x, y in corners),
            )
        except ValueError as error:
            what = "a rectangle's width and height must be more than 0"
            raise Problem(422, "zones", f"zone {self.name[:80]!r} cannot be: {what}") from error


class ZonesBody(BaseModel):
    """Zones of a job as a person drew them."""

    zones: list[ZoneBody] = Field(min_length=1, max_length=MOST_ZONES)
    careful_share: Share = Field(
        CAREFUL_SHARE, description="Share of the guaranteed false-alarm rate that careful areas may use."
    )
    press: str | None = Field(
        None, max_length=64, description="Digest of the press; null: the first suitable press."
    )


class PriceBody(ZonesBody):
    """Zones to price, and the numbers of prints from which their price is computed."""

    prints: int = Field(90, ge=12, le=2000, description="Number of good prints for calibration.")
    trials: int = Field(
        24, ge=0, le=500, description="Number of prints with a defect, for each kind in each zone."
    )


class JobAnswer(Answer):
    """A job of the console."""

    job: int
    name: str
    pages: int | None
    zones: bool = Field(description="Whether a file of zones is next to it.")
    trouble: str = ""


class JobsAnswer(Answer):
    """All jobs of the console."""

    items: list[JobAnswer]


class ZonesAnswer(Answer):
    """Saved zones of a job."""

    job: int
    file: str
    zones: list[ZoneBody]
    careful_share: float
    digest: str = Field(description="As a run's journal names it; empty: there are none.")
    zones_digest: str = Field(description="Of the zones without their price.")
    in_force: bool = Field(description="Whether they have a price.")
    press_digest: str | None = Field(description="Press for which the price was calculated.")
    prints: int | None
    price: list[dict[str, Any]]
    contested: list[str]
    trouble: str = Field("", description="Reason why the file cannot be read; empty: it can.")


class PagePictureAnswer(Answer):
    """Size of a page's picture and of its tiles."""

    width: int
    height: int
    tile: int
    levels: int
    width_mm: float
    height_mm: float


class ProposalAnswer(Answer):
    """A zone that the page itself proposes."""

    source: Literal["box", "layer", "annotation", "code"]
    zone: ZoneBody


class ProposalsAnswer(Answer):
    """All zones that a page proposes."""

    items: list[ProposalAnswer]


class PriceAnswer(Answer):
    """A price that is complete or being computed."""

    id: str
    job: int
    state: Literal["running", "done", "failed", "cancelled"]
    by: str
    zones_digest: str = Field(description="Of exactly the zones that are priced.")
    press_digest: str
    prints: int
    trials: int
    stage: Literal["starting", "prints", "defects"]
    done: int
    total: int
    why: str
    price: dict[str, Any] | None = Field(
        description="`zones`: rows of `name, kind, pages, before, after`, the least that is detected at 99 % with "
        "its 90 % interval; null: not even the strongest. Then `promised`, the guaranteed false-alarm rate, "
        "and how many of `good_prints` alarmed."
    )


class PricesAnswer(Answer):
    """Prices of a job, the latest first."""

    items: list[PriceAnswer]


@router.get("/jobs", responses=responses(401, 403))
def jobs(request: Request, _who: Viewer) -> JobsAnswer:
    """List the jobs of the console."""
    service = console(request).zones
    items = []
    for number, path in service.jobs():
        try:
            job = service.job(number)
            items.append(
                JobAnswer(job=number, name=path.name, pages=len(job.sizes_mm), zones=job.zones.is_file())
            )
        except Exception as error:
            items.append(JobAnswer(job=number, name=path.name, pages=None, zones=False, trouble=str(error)))
    return JobsAnswer(items=items)


@router.get("/jobs/{job}/zones", responses=ONE)
def zones(request: Request, response: Response, _who: Viewer, job: JobNumber) -> ZonesAnswer:
    """Return the saved zones. `ETag` names this state, which saving must send."""
    service = console(request).zones
    given = service.job(job)
    saved = service.saved(given)
    response.headers["ETag"] = saved.tag
    return zones_answer(given, saved)


@router.put("/jobs/{job}/zones", responses=responses(400, 401, 403, 404, 409, 412, 422, 428, 503))
def save(
    request: Request,
    response: Response,
    who: ZonesEngineer,
    job: JobNumber,
    given: ZonesBody,
    if_match: IfMatch = None,
) -> ZonesAnswer:
    """Put zones in force. A price of exactly these zones on this press must exist already."""
    service = console(request).zones
    given_job = service.job(job)
    drawn = service.drawn(given_job, [one.entry() for one in given.zones], given.careful_share)
    saved = service.save(given_job, drawn, service.press(given.press), tag=meant(if_match), who=who)
    response.headers["ETag"] = saved.tag
    return zones_answer(given_job, saved)


@router.delete(
    "/jobs/{job}/zones", status_code=204, responses=responses(401, 403, 404, 409, 412, 422, 428, 503)
)
def remove(request: Request, who: ZonesEngineer, job: JobNumber, if_match: IfMatch = None) -> Response:
    """Remove all zones of a job; the press's own false-alarm rate needs no price."""
    service = console(request).zones
    service.remove(service.job(job), tag=meant(if_match), who=who)
    return Response(status_code=204)


@router.get("/jobs/{job}/pages/{page}/picture", responses=ONE)
def page_picture(request: Request, _who: Viewer, job: JobNumber, page: PageNumber) -> PagePictureAnswer:
    """Return the size of the page's picture in the colours of a screen; it is drawn now if it was not."""
    state = console(request)
    given = state.zones.job(job)
    raster = state.rasters.raster(given.path, page, _size(given, page), given.digest)
    return PagePictureAnswer(**asdict(raster), tile=state.rasters.tile_size)


@router.get(
    "/jobs/{job}/pages/{page}/picture/{level}/{column}/{row}",
    response_class=Response,
    responses=ONE | binary("image/webp") | {304: {"description": "It has not changed."}},
)
def page_tile(
    request: Request,
    _who: Viewer,
    job: JobNumber,
    page: PageNumber,
    level: TileLevel,
    column: TilePlace,
    row: TilePlace,
) -> Response:
    """Return one tile, as WebP."""
    state = console(request)
    given = state.zones.job(job)
    tag = etag(given.digest, page, level, column, row, state.rasters.version)
    if unchanged(request, tag):
        return not_modified(tag, A_WHILE)
    drawn = state.rasters.tile(given.digest, page, level, column, row)
    return Response(drawn, media_type="image/webp", headers={"ETag": tag, "Cache-Control": A_WHILE})


@router.get("/jobs/{job}/pages/{page}/proposals", responses=ONE)
def proposals(request: Request, _who: Viewer, job: JobNumber, page: PageNumber) -> ProposalsAnswer:
    """List zones that a page proposes: outside its BleedBox, layers, annotations, and camera-readable codes."""
    state = console(request)
    given = state.zones.job(job)
    _size(given, page)
    press = next(iter(state.zones.presses()), None)
    stamp = given.digest, "" if press is None else press.digest
    proposed = state.rasters.proposals(given.path, page, None if press is None else press.path, stamp)
    return ProposalsAnswer(
        items=[ProposalAnswer(source=one.source, zone=zone_body(one.zone)) for one in proposed]
    )


@router.get("/jobs/{job}/zones/prices", responses=ONE)
def prices(request: Request, _who: Viewer, job: JobNumber) -> PricesAnswer:
    """List prices of zones of a job that were computed, or are being computed, since the console began."""
    service = console(request).zones
    given = service.job(job)
    return PricesAnswer(items=[price_answer(task) for task in service.prices.of_job(given.number)])


@router.post("/jobs/{job}/zones/prices", status_code=202, responses=responses(400, 401, 403, 404, 409, 422))
def ask_price(request: Request, who: ZonesEngineer, job: JobNumber, given: PriceBody) -> PriceAnswer:
    """Begin a price in a process of the lowest priority. One price is computed at a time."""
    service = console(request).zones
    given_job = service.job(job)
    drawn = service.drawn(given_job, [one.entry() for one in given.zones], given.careful_share)
    press = service.press(given.press)
    return price_answer(
        service.price(given_job, drawn, press, prints=given.prints, trials=given.trials, by=who.name)
    )


@router.get("/zones/prices/{price}", responses=responses(401, 403, 404, 422))
async def price(
    request: Request,
    _who: Viewer,
    price: PriceId,
    seen: Annotated[
        str | None,
        Query(
            max_length=60,
            description="STAGE:DONE of the last answer: the next answer waits for progress beyond it.",
        ),
    ] = None,
) -> PriceAnswer:
    """Return the progress of a price, and its result."""
    state = console(request)
    waited_s = 0.0
    while True:
        task = state.zones.prices.one(price)
        same = seen == f"{task.progress.stage}:{task.progress.done}"
        if not same or task.state != "running" or waited_s >= LONGEST_WAIT_S or state.live.closing:
            return price_answer(task)
        await anyio.sleep(POLL_S)  # occupies no thread: pages need the few there are
        waited_s += POLL_S


@router.delete("/zones/prices/{price}", responses=responses(401, 403, 404, 422))
def cancel_price(request: Request, _who: ZonesEngineer, price: PriceId) -> PriceAnswer:
    """Cancel a price that is being computed."""
    return price_answer(console(request).zones.prices.cancel(price))


def zones_answer(job: GivenJob, saved: ZonesAsSaved) -> ZonesAnswer:
    """Return saved zones as programs and the page on which zones are drawn get them."""
    stored = saved.zones
    price = None if stored is None else stored.document.price
    in_force = stored is not None and price is not None and price.zones == stored.zones_digest
    return ZonesAnswer(
        job=job.number,
        file=job.zones.name,
        zones=[] if stored is None else [zone_body(one) for one in stored.document.zones],
        careful_share=CAREFUL_SHARE if stored is None else stored.document.careful_share,
        digest="" if stored is None else stored.digest,
        zones_digest="" if stored is None else stored.zones_digest,
        in_force=in_force,
        press_digest=price.press if price is not None and in_force else None,
        prints=price.prints if price is not None and in_force else None,
        price=list(price.told) if price is not None and in_force else [],
        contested=[] if stored is None else stored.contested(),
        trouble=saved.trouble,
    )


def price_answer(task: PriceTask) -> PriceAnswer:
    """Return a price as programs and the page on which zones are drawn get it."""
    return PriceAnswer(
        id=task.id,
        job=task.job,
        state=task.state,
        by=task.by,
        zones_digest=task.zones_digest,
        press_digest=task.press_digest,
        prints=task.prints,
        trials=task.trials,
        stage=task.progress.stage,
        done=task.progress.done,
        total=task.progress.total,
        why=task.why,
        price=None if task.priced is None else task.priced.plain(),
    )


def zone_body(entry: ZoneEntry) -> ZoneBody:
    """Return a zone of the file as a body of the interface."""
    corners, rectangle = entry.polygon_mm, entry.rectangle_mm
    return ZoneBody(
        name=entry.name,
        kind=entry.kind,
        pages=entry.pages,
        rectangle_mm=None if rectangle is None else list(rectangle),
        polygon_mm=None if corners is None else [list(corner) for corner in corners],
    )


def meant(if_match: str | None) -> str:
    """Return the state that the requester has read; raises ``Problem`` 428 if they do not say which."""
    if if_match is None:
        raise Problem(428, "if-match", "send If-Match with the ETag of the zones that were read")
    return if_match.strip().removeprefix("W/")


def _size(job: GivenJob, page: int) -> tuple[float, float]:
    if page > len(job.sizes_mm):
        raise not_found(f"{job.path.name} has no page {page}")
    return job.sizes_mm[page - 1]
