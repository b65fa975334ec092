"""The pages Set up, zones: zones of the console's jobs with their price, and the page to draw them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import Response

from prooflight_console.accounts.roles import Role
from prooflight_console.api.common import JobNumber, console
from prooflight_console.api.zones import price_answer, zones_answer
from prooflight_console.pages.shell import EngineerPage, ViewerPage, language_of, page
from prooflight_console.reading.zones import SORTS, zones_drawing, zones_facts

if TYPE_CHECKING:
    from prooflight_console.reading.zones import ZonesFacts

router = APIRouter(include_in_schema=False)


@router.get("/setup/zones")
def zones_page(request: Request, who: ViewerPage) -> Response:
    """Return the zones of every job."""
    rows: list[tuple[int, str, ZonesFacts | None]] = [
        (number, path.name, zones_facts(path)) for number, path in console(request).zones.jobs()
    ]
    return page(request, who, "setup/zones", found=rows, sorts=SORTS, may_draw=who.role.may(Role.ENGINEER))


@router.get("/setup/zones/{job}")
def drawing_page(request: Request, who: EngineerPage, job: JobNumber) -> Response:
    """Return the page on which the zones of one job are drawn, priced and saved."""
    service = console(request).zones
    given = service.job(job)
    saved = service.saved(given)
    t = language_of(request, who)
    values = {
        "job": given.number,
        "name": given.path.name,
        "file": given.zones.name,
        "sizes_mm": given.sizes_mm,
        "tag": saved.tag,
        "saved": zones_answer(given, saved).model_dump(mode="json"),
        "prices": [
            price_answer(task).model_dump(mode="json", exclude={"price"})
            for task in service.prices.of_job(job)
        ],
        "words": t.group("drawing."),
        "sorts": [{"name": name, "unit": unit, "what": t.named("zones", name)} for name, unit in SORTS],
    }
    return page(
        request, who, "setup/drawing", told=values, given=given, saved=saved, presses=service.presses()
    )


@router.get("/setup/zones/{job}/picture")
def zones_picture(request: Request, _who: ViewerPage, job: JobNumber) -> Response:
    """Return a picture of the first page that has zones."""
    jobs = console(request).settings.jobs
    drawn = zones_drawing(jobs[job - 1]) if job <= len(jobs) else None
    if drawn is None:
        raise HTTPException(404)
    return Response(drawn, media_type="image/png", headers={"Cache-Control": "private, no-cache"})
