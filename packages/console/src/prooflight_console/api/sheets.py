"""One sheet: its verdict, its evidence, its verdict computed again, and its pictures."""

from __future__ import annotations

import io
from functools import partial
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Path, Request, Response

from prooflight.inspection.redeciding import replayed
from prooflight_console.api.common import (
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
    evidence_of,
    not_modified,
    replayable,
    unchanged,
)
from prooflight_console.api.schemas import (
    EvidenceAnswer,
    EvidenceArray,
    LabelAnswer,
    LabelRequest,
    PictureAnswer,
    ReleaseRequest,
    ReplayAnswer,
    WholeSheetAnswer,
)
from prooflight_console.problems import binary, responses
from prooflight_console.reading import facts
from prooflight_line.journal.following import Written
from prooflight_line.journal.labels import run_key

router = APIRouter(prefix=PREFIX, tags=["sheets"])

ONE = responses(401, 403, 404, 422, 503)
A_WHILE = "private, max-age=3600"


@router.get("/runs/{run}/sheets/{sheet}", responses=ONE)
def sheet(request: Request, _who: Viewer, run: RunId, sheet: SheetNumber) -> WholeSheetAnswer:
    """Return one sheet with its verdict, its incident, and the labels that people gave."""
    state = console(request)
    run_row = state.reading.run_named(run)
    page = state.reading.sheet(run_row.id, sheet)
    labels = [
        LabelAnswer(**facts.label_of(label))
        for label in state.label_store.of_run(run_key(run_row))
        if label.sheet == sheet
    ]
    return WholeSheetAnswer(
        **facts.sheet_of(Written(row=0, run_id=run_row.id, page=page)),
        incident=state.incidents.of_sheet(run_row, sheet),
        evidence=page.evidence is not None,
        labels=labels,
    )


@router.post(
    "/runs/{run}/sheets/{sheet}/labels", status_code=201, responses=responses(400, 401, 403, 404, 422, 503)
)
def say(request: Request, who: Operator, run: RunId, sheet: SheetNumber, given: LabelRequest) -> LabelAnswer:
    """Label a sheet. Labels are added, nothing is replaced; the last one counts."""
    state = console(request)
    run_row = state.reading.run_named(run)
    state.reading.sheet(run_row.id, sheet)
    label = state.say(who, given.label, run_row, sheet=sheet, note=given.note)
    return LabelAnswer(**facts.label_of(label))


@router.post(
    "/runs/{run}/sheets/{sheet}/release",
    status_code=201,
    responses=responses(400, 401, 403, 404, 409, 422, 503),
)
def release(
    request: Request, who: OperatorThemselves, run: RunId, sheet: SheetNumber, given: ReleaseRequest
) -> LabelAnswer:
    """Release this one sheet manually: you have it in hand, it is good, and you put it in its place. No token may."""
    state = console(request)
    label = state.vouch(who, state.reading.run_named(run), sheet, reason=given.reason)
    return LabelAnswer(**facts.label_of(label))


@router.get("/runs/{run}/sheets/{sheet}/evidence", responses=ONE)
def evidence(request: Request, _who: Viewer, run: RunId, sheet: SheetNumber) -> EvidenceAnswer:
    """Return names, types and shapes of a sheet's evidence, and where its cuts are on the page [mm]."""
    stored = _stored_evidence(request, run, sheet)
    arrays = [
        EvidenceArray(name=name, dtype=str(array.dtype), shape=list(array.shape))
        for name, array in stored.items()
    ]
    cuts = [
        {"name": name, "box_mm": stored[f"{name}_mm"].astype(float).tolist()}
        for name in stored
        if f"{name}_mm" in stored
    ]
    return EvidenceAnswer(arrays=arrays, cuts=cuts)


@router.get(
    "/runs/{run}/sheets/{sheet}/evidence.npz",
    response_class=Response,
    responses=ONE | binary("application/octet-stream"),
)
def evidence_file(request: Request, _who: Engineer, run: RunId, sheet: SheetNumber) -> Response:
    """Return the arrays of the evidence, as `numpy.load` reads them."""
    file = io.BytesIO()
    np.savez_compressed(file, **_stored_evidence(request, run, sheet))
    name = f'attachment; filename="sheet-{sheet}.npz"'
    return Response(
        file.getvalue(), media_type="application/octet-stream", headers={"Content-Disposition": name}
    )


@router.get("/runs/{run}/sheets/{sheet}/replay", responses=responses(401, 403, 404, 409, 422, 503))
def replay(request: Request, _who: Viewer, run: RunId, sheet: SheetNumber) -> ReplayAnswer:
    """Compute the verdict again from the stored evidence, with the press of the run."""
    run_row, page, press = replayable(console(request), run, sheet)
    figures = replayed(page.verdict, evidence_of(page, run=run_row.id), press)
    return ReplayAnswer(
        run=run_row.id,
        sheet=sheet,
        page=page.verdict.page,
        same=all(figure.same for figure in figures),
        guarantee_suspended=page.verdict.promise_suspended,
        figures={one.name: {"recorded": _plain(one.recorded), "again": _plain(one.again)} for one in figures},
    )


@router.get("/runs/{run}/sheets/{sheet}/pictures", responses=ONE)
def pictures(request: Request, _who: Viewer, run: RunId, sheet: SheetNumber) -> PictureAnswer:
    """Return the pictures of a sheet and the size of their tiles.

    Tile (column, row) of a level shows 256 x 256 pixels; the highest level has all pixels, each lower one
    half as many a side.
    """
    state = console(request)
    run_row = state.reading.run_named(run)
    return PictureAnswer(**state.pictures.describe(run_row, state.reading.sheet(run_row.id, sheet)))


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
    """Return one tile, as WebP."""
    state = console(request)
    run_row = state.reading.run_named(run)
    tag = etag(run_key(run_row), sheet, layer, level, column, row, state.pictures.version)
    if unchanged(request, tag):
        return not_modified(tag, A_WHILE)
    read = partial(state.reading.sheet, run_row.id, sheet)
    picture = state.pictures.tile(run_row, sheet, read, layer=layer, level=level, column=column, row=row)
    return Response(picture, media_type="image/webp", headers={"ETag": tag, "Cache-Control": A_WHILE})


def _stored_evidence(request: Request, run: str, sheet: int) -> dict[str, Any]:
    state = console(request)
    return dict(evidence_of(state.reading.sheet(state.reading.run_id(run), sheet), run=run))


def _plain(value: float | str | None) -> float | str | None:
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value
