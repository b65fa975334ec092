"""The gate of a run: the account of every sheet, and the lines of the gate's log."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request
from pydantic import Field

from prooflight_console.api.common import PREFIX, Limit, RunId, Viewer, console
from prooflight_console.api.schemas import Answer, Cursor
from prooflight_console.problems import responses
from prooflight_console.reading.gate import gate_facts, sheet_facts
from prooflight_line.plant.gate.reconciling import Account

router = APIRouter(prefix=PREFIX, tags=["gate"])

ONE = responses(401, 403, 404, 409, 422, 503)


class GatedSheet(Answer):
    """A sheet and its account: verdict, decision and tray."""

    sheet: int
    account: Account
    job_page: int | None
    page: str
    set: int | None = Field(description="From 0; null: nothing was decided of it.")
    verdict: str = Field(description="Of all its sides; empty: there is no verdict.")
    in_journal: bool
    decision: str = Field(description="accept, divert, stop; empty: none.")
    tray: str = Field(description="good, reject; empty: the controller reported no tray.")
    why: str
    contested: bool = Field(description="Whether log and wire name different trays.")
    tag: int | None = Field(
        description="Tag at the controller; null: the controller did not receive the sheet."
    )
    position: int | None = Field(description="Count of the encoder at which it was expected at the gate.")
    written: bool = Field(description="Whether the controller acknowledged the decision.")


class GateAnswer(Answer):
    """Accounts of the sheets of a run, by the controller's log of its trays and its messages over the wire."""

    run: int
    sessions: list[int]
    settings: dict[str, Any] = Field(description="[gate] of the press file at the start of the run.")
    trays_from: Literal["file", "wire"] = Field(
        description="Source of the trays: `serve --trays`, or the wire."
    )
    disagreements: list[dict[str, Any]] = Field(
        description="Sheets for which the two differ; `file` is empty where the log has no row."
    )
    counts: dict[str, int] = Field(description="Of all sheets of the run, by `account`.")
    lost_by: dict[str, int] = Field(description="Good sheets that were rejected, by reason.")
    not_in_the_journal: int
    items: list[GatedSheet]
    next: Cursor


class GateLine(Answer):
    """A line of the gate's log, with the further fields of its kind."""

    line: int
    kind: str


class GateLogAnswer(Answer):
    """Lines of the gate's log, in the order in which they were written."""

    items: list[GateLine]
    next: Cursor


@router.get("/runs/{run}/gate", responses=ONE)
def gate(
    request: Request,
    _who: Viewer,
    run: RunId,
    after: Annotated[int, Query(ge=-1, lt=2**63, description="`next` of the answer before.")] = -1,
    limit: Limit = 100,
    account: Account | None = None,
) -> GateAnswer:
    """List the account of every sheet of a run, as `prooflight run reconcile` does.

    A `wrong` sheet is in the good tray against its decision. There is no account for a run without a gate.
    """
    state = console(request)
    run_row = state.reading.run_named(run)
    gated = state.gates.of(run_row)
    sheets = gated.sheets(after=after, limit=limit + 1, account=account)
    items = [GatedSheet(**sheet_facts(gated, one)) for one in sheets[:limit]]
    cursor = items[-1].sheet if len(sheets) > limit else None
    return GateAnswer(**gate_facts(run_row, gated), items=items, next=cursor)


@router.get("/runs/{run}/gate/log", responses=ONE)
def gate_log(
    request: Request,
    _who: Viewer,
    run: RunId,
    after: Annotated[int, Query(ge=0, lt=2**53, description="`next` of the answer before.")] = 0,
    limit: Limit = 100,
) -> GateLogAnswer:
    """List the lines of the gate's log: `decision`, `written`, `unsent`, `tray` and other events."""
    state = console(request)
    rows = state.gates.lines(state.reading.run_named(run), after=after, limit=limit + 1)
    items = [GateLine(**row) for row in rows[:limit]]
    return GateLogAnswer(items=items, next=items[-1].line if len(rows) > limit else None)
