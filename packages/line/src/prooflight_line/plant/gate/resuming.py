"""What a gate's log says of a run that broke off: decisions that the journal does not have, and sheets on their way.

A decision is in the log before the controller can know of it, and in the journal up to half a second later. So the
log has every decision that a sheet may have followed, and says which rows the journal lost.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

from prooflight.detectors.verdict import Verdict
from prooflight_line.journal.records import PageRecord
from prooflight_line.plant.gate.deciding import CODE_TEXTS, SheetDecision, disposition_of
from prooflight_line.plant.gate.log import PlantError
from prooflight_line.plant.gate.registers import Code, Result

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.press.gate import GateSettings
    from prooflight_line.plant.gate.log import LoggedDecisions

LOST: Final = "the verdict was lost when the run was interrupted"
MOST_ON_THEIR_WAY: Final = 64
"""Greatest number of sheets between camera and gate: twice the results that the register map asks a controller to
store."""


def cut_torn_line(path: Path) -> None:
    """Cut off the last line of a log if its end was not written: the controller cannot know of it.

    Lines that are added would continue it otherwise.
    """
    with path.open("r+b") as log:
        text = log.read()
        if not text.endswith(b"\n"):
            log.truncate(text.rfind(b"\n") + 1)


def refuse_other_gate(gate_log: LoggedDecisions, settings: GateSettings, *, where: object) -> None:
    """Raise PlantError if the gate of a run was served with other settings than these of the press file ``where``."""
    if json.loads(json.dumps(asdict(settings))) != gate_log.began.get("settings"):
        what = "[gate] is not that of the run"
        raise PlantError(where, what, remedy="resume with the press file of the run, or leave out --resume")


def unrecorded(
    gate_log: LoggedDecisions, first_sheet: int, plan: SheetPlan | None, *, time_s: float
) -> list[PageRecord]:
    """Return rows for the sheets that were decided and that the journal lacks.

    A sheet that was called a misprint is recorded as one. Of all others nothing but the decision is known, so they
    are not inspected.

    Parameters
    ----------
    first_sheet
        Number of the first sheet that the journal lacks.
    time_s
        Time of the last sheet that is recorded.
    """
    by_row = dict[int, tuple[dict[str, Any], bool]]()
    for row in gate_log.decisions.values():
        sides = [int(number) for number in row.get("rows", ())] or [row["tag"] - 1]
        for number in sides:
            by_row[number] = row, number == sides[-1]
    last = max(by_row, default=-1)
    return [
        _row_of(number, *by_row.get(number, ({}, True)), plan, time_s)
        for number in range(first_sheet, last + 1)
    ]


def _row_of(
    number: int, row: dict[str, Any], is_last: bool, plan: SheetPlan | None, time_s: float
) -> PageRecord:
    shown, page = row.get("job_page"), row.get("page") or f"sheet {number}"
    if plan is not None and shown is not None and plan.layout.sides > 1:
        shown = plan.positions(shown)[-1 if is_last else 0]
    code = Code(row.get("code", 0))
    reason = f"{LOST} (the gate's log: {CODE_TEXTS[code]})" if code else LOST
    bad = code in (Code.MISPRINT, Code.UNKNOWN_SHEET)
    verdict = Verdict(page=page, verdict="misprint", reason=reason) if bad else Verdict.skipped(page, reason)
    came = row.get("came", True)
    return PageRecord(
        sheet=number,
        job_page=shown,
        verdict=verdict,
        late=False,
        first_line=0,
        time_s=time_s,
        faults=() if came else ("missing",),
        gate=disposition_of(Result(row["result"])) if row else "hold",
    )


def on_their_way(gate_log: LoggedDecisions) -> Iterator[tuple[SheetDecision, int | None, bool]]:
    """Yield the sheets that the log does not show at the gate: decision, encoder count there, and whether acknowledged.

    Whether each has passed meanwhile, the controller's count will show.
    """
    last = max((*gate_log.trays, *gate_log.unsent), default=0)
    tags = [
        tag
        for tag, row in gate_log.decisions.items()
        if tag > last and row["came"] and Result(row["result"]) is not Result.NONE
    ]
    for tag in sorted(tags)[-MOST_ON_THEIR_WAY:]:
        row = gate_log.decisions[tag]
        written = gate_log.written.get(tag)
        decision = SheetDecision(
            sheet=tag - 1,
            result=Result(row["result"]),
            code=Code(row["code"]),
            job_page=row["job_page"],
            page=row["page"],
            set_number=row["set"],
            why=row.get("why", ""),
        )
        position = row.get("position") if written is None else written["position"]
        yield decision, position, written is not None
