"""Set up, zones: those of the jobs that the console was given, with their price; and where they are drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import Response

from prooflight.server.accounts.roles import Role
from prooflight.server.api.common import JobNumber, console
from prooflight.server.api.zones import price_answer, zones_answer
from prooflight.server.pages.shell import EngineerPage, ViewerPage, language_of, page
from prooflight.server.reading.zones import SORTS, zones_drawing, zones_facts

if TYPE_CHECKING:
    from prooflight.server.reading.zones import ZonesFacts

router = APIRouter(include_in_schema=False)


@router.get("/setup/zones")
def zones_page(request: Request, who: ViewerPage) -> Response:
    """Zones of every job."""
    found: list[tuple[int, str, ZonesFacts | None]] = [
        (number, path.name, zones_facts(path)) for number, path in console(request).zones.jobs()
    ]
    return page(request, who, "setup/zones", found=found, sorts=SORTS, may_draw=who.role.may(Role.ENGINEER))


@router.get("/setup/zones/{job}")
def drawing_page(request: Request, who: EngineerPage, job: JobNumber) -> Response:
    """Where the zones of one job are drawn, priced and saved."""
    desk = console(request).zones
    given = desk.job(job)
    saved = desk.saved(given)
    t = language_of(request, who)
    told = {
        "job": given.number,
        "name": given.path.name,
        "file": given.zones.name,
        "sizes_mm": given.sizes_mm,
        "tag": saved.tag,
        "saved": zones_answer(given, saved).model_dump(mode="json"),
        "prices": [
            price_answer(task).model_dump(mode="json", exclude={"price"}) for task in desk.prices.of_job(job)
        ],
        "words": t.group("drawing."),
        "sorts": [{"name": name, "unit": unit, "what": t.named("zones", name)} for name, unit in SORTS],
    }
    return page(request, who, "setup/drawing", told=told, given=given, saved=saved, presses=desk.presses())


@router.get("/setup/zones/{job}/picture")
def zones_picture(request: Request, _who: ViewerPage, job: JobNumber) -> Response:
    """The first page that has zones."""
    jobs = console(request).settings.jobs
    drawn = zones_drawing(jobs[job - 1]) if job <= len(jobs) else None
    if drawn is None:
        raise HTTPException(404)
    return Response(drawn, media_type="image/png", headers={"Cache-Control": "private, no-cache"})
