"""Sheets to print again: every sheet that the job needs and that is not in the good tray, with its reason.

No other module counts them. The count uses the journal, the labels, the gate's log and the controller's log
of its trays. Without a gate, a sheet is delivered if it was judged good. The unit is the sheet, which is one
page unless the job's layout states otherwise; a set is printed again as a whole. A page that was printed well
later is not counted. A sheet that lost lines is not delivered by its verdict, because not all of it was seen.

A label states what a misprint was. Without a gate, a false alarm is a good sheet; with a gate, it is in the
reject tray all the same. No label makes a sheet good that was not inspected. A person who has a sheet in hand
may vouch for it, with or without a gate, and puts it where it belongs.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

from prooflight.detectors.disposition import NOT_WHOLE
from prooflight.inspection.sheets import WORST_FIRST, came, why_of
from prooflight.pages.layout.layout import Layout
from prooflight.pages.layout.plan import SheetPlan, facts_plan
from prooflight_line.journal.labels import OF_GOOD, VOUCHED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set

    from prooflight.detectors.verdict import VerdictName
    from prooflight_line.journal.labels import Labels
    from prooflight_line.journal.records import PageRecord, RunRow
    from prooflight_line.plant.gate.log import LoggedDecisions
    from prooflight_line.plant.gate.reconciling import Accounted, Reconciliation, TraySource

NEVER: Final = "no sheet with this page was detected"
NOT_PRINTED: Final = "the run ended before the sheet was printed"
UNCONFIRMED: Final = "the sheet was accepted, but the controller did not confirm it in the good tray"
CONTESTED: Final = "the controller reported two trays"
NOT_SEEN_WHOLE: Final = "the sheet was not captured completely"
TAKE_OUT: Final = "the sheet is in the good tray"
OF_ITS_SET: Final = "the set is reprinted as a whole"
NO_END: Final = 2**62
"""Number of sheets of a run whose length is not stated."""
Source = Literal["verdicts", "trays"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reprint:
    """One sheet that is not delivered, or must be taken out of the good tray."""

    run_sheet: int
    """Number of the sheet in the run, from 0."""
    copy: int
    """Copy of the job, from 1."""
    number: int
    """Number of the sheet in the job, from 1."""
    page: str
    """Name of the sheet: that of its page, if it has one."""
    pages: tuple[int, ...]
    """Numbers of the sheet's pages in the job, from 1."""
    set_number: int
    """Number of the set, from 1."""
    why: str
    behind: str
    """Name of the sheet that it follows in the good tray; empty: it is below all others."""
    take_out: bool = False
    """Whether a print of the sheet is in the good tray and must be taken out."""
    sheet: int | None = None
    """Number, in the run, of the side to be examined first; None: no side came, or the sheet is good and
    leaves the good tray with its set."""
    job_page: int | None = None
    """Position of that side in the run's pages."""
    verdict: VerdictName = "good"
    """Verdict of that side; not-inspected if the sheet did not come."""
    kind: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReprintList:
    """All sheets of one run that are to be printed again, in the order of the run."""

    sheets: tuple[Reprint, ...]
    unprinted: range
    """Sheets of the run that were not printed when it ended; they follow all others."""
    plan: SheetPlan
    vouched: tuple[int, ...]
    """Numbers, in the run, of the sheets that are delivered because a person has vouched for them."""
    by: Source
    """Basis of the count: ``trays`` for a run with a gate."""
    trays_from: TraySource | None
    """Source of the trays; None if the run had no gate."""

    def __len__(self) -> int:
        return len(self.sheets) + len(self.unprinted)

    def all(self) -> Iterator[Reprint]:
        """Yield all sheets, including those that were not printed."""
        yield from self.sheets
        after = _name_below(self)
        for sheet in self.unprinted:
            yield _reprint(self.plan, sheet, _Lacking(why=NOT_PRINTED), after=after)

    def pages(self) -> Counter[str]:
        """Count how often each sheet of the job is to be printed again, by its name."""
        return Counter(one.page for one in self.all())


@dataclass(frozen=True, slots=True, kw_only=True)
class _Lacking:
    """A sheet that is not delivered."""

    why: str
    name: str = ""
    """Name of the sheet; empty: the name in the plan."""
    verdict: VerdictName = "not-inspected"
    """Verdict, used where the journal has no row for the sheet."""
    sheet: int | None = None
    """Number of the sheet in the run, if the journal has it."""


@dataclass(slots=True)
class _Sheets:
    """State of a run's sheets while they are counted."""

    delivered: dict[int, str] = field(default_factory=dict)
    """Names of delivered sheets, where they differ from those of the plan."""
    lacking: dict[int, _Lacking] = field(default_factory=dict)
    """Sheets that are not delivered."""
    taken_out: set[int] = field(default_factory=set)
    """Sheets that are not delivered although a print of them is in the good tray."""
    vouched: list[int] = field(default_factory=list)
    upto: int = 0


def reprint_list(
    run: RunRow,
    pages: Iterable[PageRecord],
    *,
    passed: int,
    labels: Labels,
    incident_of: Callable[[int], int | None],
    gate: tuple[LoggedDecisions, Reconciliation] | None = None,
) -> ReprintList:
    """Return the sheets of a run that are to be printed again.

    Parameters
    ----------
    pages
        Rows of the journal in order. Sheets of which every side is good, in time, and without fault and note may be
        left out.
    passed
        Number of positions up to the furthest side that came.
    incident_of
        Function that returns the incident to which a sheet of the run belongs.
    gate
        For a run with a gate: its log, and the account of its sheets.
    """
    plan = _plan(run, None if gate is None else gate[0])
    ended = run.state != "running"
    rows = _rows_by_sheet(plan, pages)
    cleared = _Cleared(labels, incident_of)
    if gate is None:
        tally = _by_verdicts(plan, rows, passed=passed, ended=ended, cleared=cleared)
    else:
        silent = _accepted_by_output(*gate)
        tally = _by_trays(
            plan,
            gate[1].sheets,
            rows,
            passed=passed,
            ended=ended,
            cleared=cleared,
            taken_for_delivered=silent,
        )
    needed = _needed(run, plan) if ended else None
    unprinted = range(tally.upto, tally.upto if needed is None else max(needed, tally.upto))
    if unprinted and (spoiled := plan.layout.sheets_a_set or 1) > 1:
        # The set within which the run ended is printed again as a whole.
        until = min(-(-tally.upto // spoiled) * spoiled, unprinted.stop)
        tally.lacking |= {sheet: _Lacking(why=NOT_PRINTED) for sheet in range(tally.upto, until)}
        tally.upto, unprinted = until, range(until, unprinted.stop)
    return ReprintList(
        sheets=tuple(_reprints(plan, tally, rows)),
        unprinted=unprinted,
        plan=plan,
        vouched=tuple(tally.vouched),
        by="verdicts" if gate is None else "trays",
        trays_from=None if gate is None else gate[1].source,
    )


# --- whether a sheet is delivered ---


class _Cleared:
    """Rows of the journal that labels clear."""

    def __init__(self, labels: Labels, incident_of: Callable[[int], int | None]) -> None:
        self._labels, self._incident_of = labels, incident_of

    def good(self, row: PageRecord) -> bool:
        """Return whether the row counts as good.

        It does if a person has vouched for it; or if all of it was seen, and it was judged good or is a
        misprint that was labelled good.
        """
        if self.vouched(row):
            return True
        if _judged_good(row):
            return True
        label = self._labels.of(row.sheet, self._incident_of(row.sheet))
        misprint = row.verdict.verdict == "misprint" and not NOT_WHOLE & set(row.faults)
        return misprint and label is not None and label.word in OF_GOOD

    def vouched(self, row: PageRecord) -> bool:
        """Return whether a person has vouched for the row."""
        label = self._labels.of(row.sheet)
        return label is not None and label.word == VOUCHED

    def by_hand(self, rows: Sequence[PageRecord]) -> bool:
        """Return whether people have vouched for the sheet with these rows."""
        return any(map(self.vouched, rows)) and all(map(self.good, rows))


def _by_verdicts(
    plan: SheetPlan,
    rows: Mapping[int, list[PageRecord]],
    *,
    passed: int,
    ended: bool,
    cleared: _Cleared,
) -> _Sheets:
    """Tally a run without a gate."""
    tally = _Sheets(upto=_seen(plan, passed, ended=ended))
    for sheet, own in sorted(rows.items()):
        if sheet >= tally.upto:
            break
        sides = [
            [row for row in own if plan.sheet_at(_position(row))[1] == at] for at in range(plan.layout.sides)
        ]
        lacks = [
            bool(side) or position >= passed
            for side, position in zip(sides, plan.positions(sheet), strict=True)
        ]
        prints = _prints(sides, lacks)
        good = [one for one in prints if all(map(cleared.good, one))]
        if not good:
            tally.lacking[sheet] = _Lacking(why=_why(plan, sides, lacks, cleared))
        elif not any(all(map(_judged_good, one)) for one in good) and any(map(cleared.by_hand, good)):
            tally.vouched.append(sheet)
    if ended:
        for sheet in range(_seen(plan, passed, ended=False), tally.upto):  # of which a side did not come
            if sheet not in rows:
                tally.lacking[sheet] = _Lacking(why=NEVER)
    return tally


def _prints(sides: Sequence[list[PageRecord]], lacks: Sequence[bool]) -> list[list[PageRecord]]:
    """Return each print of a sheet as the rows of its sides, without those that are good.

    The list is empty if a side never came. If one side came more often than another, the sides cannot be
    paired and all of them form one print.
    """
    shown = [[row for row in side if came(row)] for side in sides]
    if any(lack and not side for lack, side in zip(lacks, shown, strict=True)):
        return []
    present = [side for side in shown if side]
    if len({len(side) for side in present}) <= 1:
        return [list(one) for one in zip(*present, strict=True)]
    return [[row for side in present for row in side]]


def _why(plan: SheetPlan, sides: Sequence[list[PageRecord]], lacks: Sequence[bool], cleared: _Cleared) -> str:
    names = ("",) if plan.layout.sides == 1 else ("front: ", "back: ")
    reasons = []
    for name, side, lack in zip(names, sides, lacks, strict=True):
        shown = [row for row in side if came(row)]
        bad = [row for row in shown if not cleared.good(row)]
        if bad:
            reasons.append(name + (why_of(min(bad, key=_worst_first).verdict) or NOT_SEEN_WHOLE))
        elif lack and not shown:
            reasons.append(name + NEVER)
    return "; ".join(reasons)


def _by_trays(
    plan: SheetPlan,
    sheets: Sequence[Accounted],
    rows: Mapping[int, list[PageRecord]],
    *,
    passed: int,
    ended: bool,
    cleared: _Cleared,
    taken_for_delivered: Set[int],
) -> _Sheets:
    """Tally a run with a gate.

    An accepted sheet is on its way until a later one has reached the gate. ``taken_for_delivered`` holds the
    accepted sheets of a run whose controller is a mere output that names no tray.
    """
    tally = _Sheets()
    last = max((one.sheet for one in sheets if one.tray and one.sheet is not None), default=-1)
    on_way = set[int]()
    for one in sheets:
        if one.job_page is None:
            continue
        tally.upto = max(tally.upto, one.job_page + 1)
        if (one.account == "accepted" and not one.contested) or (
            one.account == "not-at-gate" and one.decision == "accept" and one.sheet in taken_for_delivered
        ):
            tally.delivered[one.job_page] = one.page
        elif (
            not ended
            and one.account == "not-at-gate"
            and (not one.decision or (one.decision == "accept" and (one.sheet or 0) > last))
        ):
            on_way.add(one.job_page)
        else:
            assumed = "good" if one.decision == "accept" else "not-inspected"
            verdict: VerdictName = one.verdict or assumed  # type: ignore[assignment]
            tally.lacking.setdefault(
                one.job_page,
                _Lacking(
                    why=_why_not(one),
                    name=one.page,
                    verdict=verdict,
                    sheet=one.sheet if one.in_journal else None,
                ),
            )
            if one.tray == "good" and not one.contested:
                tally.taken_out.add(one.job_page)
    for sheet, own in rows.items():
        whole = all(position < passed for position in plan.positions(sheet))
        if whole and sheet < tally.upto and sheet not in tally.delivered and cleared.by_hand(own):
            tally.vouched.append(sheet)
            tally.delivered[sheet] = ""
    for sheet in range(tally.upto):
        if sheet not in tally.delivered and sheet not in on_way:
            tally.lacking.setdefault(sheet, _Lacking(why=NEVER))
    tally.lacking = {
        at: lacks for at, lacks in tally.lacking.items() if at not in {*tally.delivered, *on_way}
    }
    return tally


def _accepted_by_output(gate_log: LoggedDecisions, accounts: Reconciliation) -> set[int]:
    """Return the sheets for which the output was switched, if the gate is one output without a log of trays."""
    style = gate_log.began.get("settings", {}).get("plc", {}).get("style")
    if style != "coil" or accounts.source == "file":
        return set()
    return {tag - 1 for tag in gate_log.decisions.keys() - gate_log.unsent.keys()}


def _why_not(one: Accounted) -> str:
    if one.contested:
        return CONTESTED
    if one.account == "not-at-gate" and one.decision == "accept":
        return UNCONFIRMED
    return f"{one.why or 'there is no verdict'}; {TAKE_OUT}" if one.tray == "good" else one.why


# --- as a list ---


def _reprints(plan: SheetPlan, tally: _Sheets, rows: Mapping[int, list[PageRecord]]) -> Iterator[Reprint]:
    of_set = plan.layout.sheets_a_set or 1
    again = dict.fromkeys(sorted(tally.lacking))
    if of_set > 1:
        sets = dict.fromkeys(sheet // of_set for sheet in again)
        again = {at: None for own in sets for at in range(own * of_set, min((own + 1) * of_set, tally.upto))}
    after = ""
    for sheet in again:
        if sheet and sheet - 1 not in again:
            after = tally.delivered.get(sheet - 1) or plan.name(sheet - 1)
        with_set = _Lacking(why=OF_ITS_SET, name=tally.delivered.get(sheet, ""), verdict="good")
        yield _reprint(
            plan,
            sheet,
            tally.lacking.get(sheet, with_set),
            after=after,
            take_out=sheet not in tally.lacking or sheet in tally.taken_out,
            rows=rows.get(sheet, ()),
        )


def _reprint(
    plan: SheetPlan,
    sheet: int,
    lacks: _Lacking,
    *,
    after: str,
    take_out: bool = False,
    rows: Sequence[PageRecord] = (),
) -> Reprint:
    copy, number = divmod(sheet, plan.sheets_a_job)
    row = min(rows, key=_worst_first, default=None)
    name = lacks.name
    if row is not None and plan.layout.pages_a_sheet == 1:
        name = row.verdict.page or name
    return Reprint(
        run_sheet=sheet,
        copy=copy + 1,
        number=number + 1,
        page=name or plan.name(sheet),
        pages=plan.pages(sheet),
        set_number=sheet // (plan.layout.sheets_a_set or 1) + 1,
        why=lacks.why,
        behind=after,
        take_out=take_out,
        sheet=lacks.sheet if row is None else row.sheet,
        job_page=None if row is None else row.job_page,
        verdict=lacks.verdict if row is None else row.verdict.verdict,
        kind=None if row is None else row.verdict.kind,
    )


def _name_below(listed: ReprintList) -> str:
    """Return the name of the sheet below those that were not printed."""
    first = listed.unprinted.start
    if listed.sheets and listed.sheets[-1].run_sheet == first - 1:
        return listed.sheets[-1].behind
    return listed.plan.name(first - 1) if first else ""


# --- parts ---


def _plan(run: RunRow, gate_log: LoggedDecisions | None) -> SheetPlan:
    """Return how the run's job is imposed on sheets."""
    began: dict[str, Any] = {} if gate_log is None else gate_log.began
    plan = SheetPlan.of(began.get("layout")) or facts_plan(run.facts.settings)
    if plan is not None:
        return plan
    pages = began.get("job_pages") or run.facts.settings.get("job_pages") or run.facts.sheets or NO_END
    pages_a_set = began.get("settings", {}).get("pages_a_set", 1)
    return SheetPlan(layout=Layout(pages_a_set=int(pages_a_set)), sides=int(pages), sheets=NO_END)


def _needed(run: RunRow, plan: SheetPlan) -> int | None:
    """Return the number of sheets that the job needs; None if it is not stated."""
    if plan.sheets < NO_END:
        return plan.sheets
    return None if run.facts.sheets is None else run.facts.sheets // plan.layout.sides


def _seen(plan: SheetPlan, passed: int, *, ended: bool) -> int:
    """Count the leading sheets of which all sides have passed or, in a run that has ended, at least one side."""
    sides = plan.layout.sides
    if sides == 1:
        return min(passed, plan.sheets)
    reached = min if ended else max
    return bisect_left(range(plan.sheets), passed, key=lambda sheet: reached(plan.positions(sheet)))


def _position(row: PageRecord) -> int:
    assert row.job_page is not None
    return row.job_page


def _rows_by_sheet(plan: SheetPlan, pages: Iterable[PageRecord]) -> dict[int, list[PageRecord]]:
    """Group rows by sheet in the order of the run; a side without a known position belongs to no sheet."""
    by_sheet: dict[int, list[PageRecord]] = {}
    for row in pages:
        if row.job_page is not None and 0 <= row.job_page < plan.passings:
            by_sheet.setdefault(plan.sheet_at(row.job_page)[0], []).append(row)
    return by_sheet


def _judged_good(row: PageRecord) -> bool:
    """Return whether the row's verdict is good and all of it was seen."""
    return row.verdict.verdict == "good" and not NOT_WHOLE & set(row.faults)


def _worst_first(row: PageRecord) -> int:
    return WORST_FIRST.index(row.verdict.verdict)
