"""One sheet: its verdict, what is kept of it, its verdict made again, its pictures."""

from __future__ import annotations

import io
from functools import partial
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Path, Request, Response

from prooflight.inspection.redeciding import replayed
from prooflight.journal.following import Written
from prooflight.journal.words import run_key
from prooflight.server.api.common import (
    PREFIX,
    Engineer,
    Operator,
    OperatorThemselves,
    RunId,
    SheetNumber,
    TileLevel,
    TilePlace,
    Viewer,
    console,
    etag,
    not_modified,
    unchanged,
)
from prooflight.server.api.schemas import (
    EvidenceAnswer,
    EvidenceArray,
    PictureAnswer,
    ReplayAnswer,
    VouchRequest,
    WholeSheetAnswer,
    WordAnswer,
    WordRequest,
)
from prooflight.server.problems import binary, responses
from prooflight.server.reading import facts
from prooflight.server.replaying import evidence_of, replayable

router = APIRouter(prefix=PREFIX, tags=["sheets"])

ONE = responses(401, 403, 404, 422, 503)
A_WHILE = "private, max-age=3600"


@router.get("/runs/{run}/sheets/{sheet}", responses=ONE)
def sheet(request: Request, _who: Viewer, run: RunId, sheet: SheetNumber) -> WholeSheetAnswer:
    """One sheet with its verdict, its incident, and what people said of it."""
    held = console(request)
    found = held.reading.run_named(run)
    page = held.reading.sheet(found.id, sheet)
    words = [
        WordAnswer(**facts.word_of(word)) for word in held.words.of_run(run_key(found)) if word.sheet == sheet
    ]
    return WholeSheetAnswer(
        **facts.sheet_of(Written(row=0, run_id=found.id, page=page)),
        incident=held.incidents.of_sheet(found, sheet),
        evidence=page.evidence is not None,
        words=words,
    )


@router.post(
    "/runs/{run}/sheets/{sheet}/words", status_code=201, responses=responses(400, 401, 403, 404, 422, 503)
)
def say(request: Request, who: Operator, run: RunId, sheet: SheetNumber, given: WordRequest) -> WordAnswer:
    """Say what a sheet was. Words are added, nothing is replaced; the last one counts."""
    held = console(request)
    found = held.reading.run_named(run)
    held.reading.sheet(found.id, sheet)
    word = held.say(who, given.word, found, sheet=sheet, note=given.note)
    return WordAnswer(**facts.word_of(word))


@router.post(
    "/runs/{run}/sheets/{sheet}/vouch",
    status_code=201,
    responses=responses(400, 401, 403, 404, 409, 422, 503),
)
def vouch(
    request: Request, who: OperatorThemselves, run: RunId, sheet: SheetNumber, given: VouchRequest
) -> WordAnswer:
    """Vouch for this one sheet: you have it in hand, it is good, and you put it where it belongs. No token may."""
    held = console(request)
    word = held.vouch(who, held.reading.run_named(run), sheet, reason=given.reason)
    return WordAnswer(**facts.word_of(word))


@router.get("/runs/{run}/sheets/{sheet}/evidence", responses=ONE)
def evidence(request: Request, _who: Viewer, run: RunId, sheet: SheetNumber) -> EvidenceAnswer:
    """What is kept of a sheet: names, types and shapes of its arrays, and where its cuts lie on the page [mm]."""
    kept = _kept(request, run, sheet)
    arrays = [
        EvidenceArray(name=name, dtype=str(array.dtype), shape=list(array.shape))
        for name, array in kept.items()
    ]
    cuts = [
        {"name": name, "box_mm": kept[f"{name}_mm"].astype(float).tolist()}
        for name in kept
        if f"{name}_mm" in kept
    ]
    return EvidenceAnswer(arrays=arrays, cuts=cuts)


@router.get(
    "/runs/{run}/sheets/{sheet}/evidence.npz",
    response_class=Response,
    responses=ONE | binary("application/octet-stream"),
)
def evidence_file(request: Request, _who: Engineer, run: RunId, sheet: SheetNumber) -> Response:
    """The arrays themselves, as `numpy.load` reads them."""
    file = io.BytesIO()
    np.savez_compressed(file, **_kept(request, run, sheet))
    name = f'attachment; filename="sheet-{sheet}.npz"'
    return Response(
        file.getvalue(), media_type="application/octet-stream", headers={"Content-Disposition": name}
    )


@router.get("/runs/{run}/sheets/{sheet}/replay", responses=responses(401, 403, 404, 409, 422, 503))
def replay(request: Request, _who: Viewer, run: RunId, sheet: SheetNumber) -> ReplayAnswer:
    """Make the verdict again from the evidence that was kept, with the press of the run."""
    found, page, press = replayable(console(request), run, sheet)
    figures = replayed(page.verdict, evidence_of(page, run=found.id), press)
    return ReplayAnswer(
        run=found.id,
        sheet=sheet,
        page=page.verdict.page,
        same=all(figure.same for figure in figures),
        promise_suspended=page.verdict.promise_suspended,
        figures={one.name: {"recorded": _plain(one.recorded), "again": _plain(one.again)} for one in figures},
    )


@router.get("/runs/{run}/sheets/{sheet}/pictures", responses=ONE)
def pictures(request: Request, _who: Viewer, run: RunId, sheet: SheetNumber) -> PictureAnswer:
    """Which pictures there are of a sheet, and how they are cut into tiles.

    Tile (column, row) of a level shows 256 x 256 pixels; the highest level has all pixels, each lower one half as many
    a side.
    """
    held = console(request)
    found = held.reading.run_named(run)
    return PictureAnswer(**held.pictures.told(found, held.reading.sheet(found.id, sheet)))


@router.get(
    "/runs/{run}/sheets/{sheet}/pictures/{layer}/{level}/{column}/{row}",
    response_class=Response,
    responses=ONE | binary("image/webp") | {304: {"description": "It has not changed."}},
)
def tile(
    request: Request,
    _who: Viewer,
    run: RunId,
    sheet: SheetNumber,
    layer: Annotated[str, Path(max_length=20, description="scan, expected or difference")],
    level: TileLevel,
    column: TilePlace,
    row: TilePlace,
) -> Response:
    """One tile, as WebP."""
    held = console(request)
    found = held.reading.run_named(run)
    tag = etag(run_key(found), sheet, layer, level, column, row, held.pictures.version)
    if unchanged(request, tag):
        return not_modified(tag, A_WHILE)
    read = partial(held.reading.sheet, found.id, sheet)
    picture = held.pictures.tile(found, sheet, read, layer=layer, level=level, column=column, row=row)
    return Response(picture, media_type="image/webp", headers={"ETag": tag, "Cache-Control": A_WHILE})


def _kept(request: Request, run: str, sheet: int) -> dict[str, Any]:
    held = console(request)
    return dict(evidence_of(held.reading.sheet(held.reading.run_id(run), sheet), run=run))


def _plain(value: float | str | None) -> float | str | None:
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value
