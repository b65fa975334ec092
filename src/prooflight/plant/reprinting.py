"""What must be printed again, and where it goes in the stack: one list, from the trays where there is a gate, else from
verdicts.

Its unit is the sheet, which is a page where the job's layout says nothing else; a set is printed again as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from prooflight.inspection.sheets import SheetVerdict
    from prooflight.plant.gate.log import KeptDecisions
    from prooflight.plant.gate.reconciling import Accounted

NEVER: Final = "no sheet of it was seen"
OF_ITS_SET: Final = "its set is printed again"
NO_END: Final = 2**62
"""Sheets of a run of which nobody said how many it has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reprint:
    """One sheet that is not to be delivered, or must leave the good tray with its set."""

    run_sheet: int
    """Its place in the run, from 0."""
    copy: int
    """Of the job, from 1."""
    number: int
    """The sheet's number in the job, from 1."""
    page: str
    """What it is called: as its page, where it has one."""
    pages: tuple[int, ...]
    """Numbers of its pages in the job, from 1."""
    set_number: int
    """From 1."""
    why: str
    behind: str
    """The sheet that it follows in the good tray; empty: it lies below all."""
    take_out: bool = False
    """Whether a good sheet of it lies in the good tray and must be taken out, because its set is printed again."""


def reprints(
    plan: SheetPlan,
    lacking: Mapping[int, tuple[str, str]],
    *,
    upto: int,
    delivered: Callable[[int], str] | None = None,
) -> list[Reprint]:
    """In the order of the run.

    lacking: sheets of the run that are not delivered, each with its name (empty: as the plan has it) and why. upto: so
    many sheets have come. delivered: what any other sheet is called; None: as the plan has it.
    """
    name = plan.name if delivered is None else delivered
    of_set = plan.layout.sheets_a_set or 1
    again = dict.fromkeys(lacking)
    if of_set > 1:
        sets = dict.fromkeys(sheet // of_set for sheet in sorted(lacking))
        again = {at: None for own in sets for at in range(own * of_set, min((own + 1) * of_set, upto))}
    found, behind = [], ""
    for sheet in sorted(again):
        if sheet and sheet - 1 not in again:
            behind = name(sheet - 1)
        own, why = lacking.get(sheet, ("", OF_ITS_SET))
        copy, number = divmod(sheet, plan.sheets_a_job)
        found.append(
            Reprint(
                run_sheet=sheet,
                copy=copy + 1,
                number=number + 1,
                page=own or (plan.name(sheet) if sheet in lacking else name(sheet)),
                pages=plan.pages(sheet),
                set_number=sheet // of_set + 1,
                why=why,
                behind=behind,
                take_out=sheet not in lacking,
            )
        )
    return found


def by_trays(sheets: Iterable[Accounted], kept: KeptDecisions) -> list[Reprint]:
    """Of a run with a gate: sheets that are not in the good tray, up to the furthest that was seen."""
    plan = gate_plan(kept)
    delivered: dict[int, str] = {}
    why: dict[int, tuple[str, str]] = {}
    for one in sheets:
        if one.job_page is None:
            continue
        if one.account == "accepted" or (one.account == "not-at-gate" and one.decision == "accept"):
            delivered[one.job_page] = one.page
        else:
            why.setdefault(one.job_page, (one.page, one.why))
    upto = max((*delivered, *why), default=-1) + 1
    lacking = {at: why.get(at, ("", NEVER)) for at in range(upto) if at not in delivered}
    return reprints(plan, lacking, upto=upto, delivered=delivered.__getitem__)


def by_verdicts(
    plan: SheetPlan, sheets: Iterable[SheetVerdict], *, upto: int, said_good: Callable[[int], bool]
) -> list[Reprint]:
    """Of a run without a gate: sheets whose verdict is not good.

    sheets: those that somebody should look at; upto: so many have come. said_good: whether people called the misprint
    in this row of the journal a false alarm.
    """
    lacking = {}
    for one in sheets:
        left = [
            side
            for side in one.sides
            if side.verdict != "good" and not (side.rows and all(map(said_good, side.rows)))
        ]
        if left:
            why = [f"{side.side}: {side.why}" if side.side else side.why for side in left]
            lacking[one.sheet] = ("", "; ".join(why))
    return reprints(plan, lacking, upto=upto)


def gate_plan(kept: KeptDecisions) -> SheetPlan:
    """How a run's job lay on sheets, from its gate's log."""
    began = kept.began
    pages_a_set = int(began.get("settings", {}).get("pages_a_set", 1))
    return SheetPlan.of(began.get("layout")) or SheetPlan(
        layout=Layout(pages_a_set=pages_a_set), sides=max(int(began.get("job_pages", 1)), 1), sheets=NO_END
    )
