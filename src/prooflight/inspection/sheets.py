"""Verdicts of sheets and sets from those of sides: one for each side, sheet, set, and each page on them.

The worst counts: misprint, then not inspected, then good. A side that did not come leaves its sheet not
inspected, and a sheet that did not come its set incomplete. Of a misprint whose places are known, only the
pages are misprints on which one lies; where no place is known, or all lie outside the pages, every page of
the side counts as one, since the page is not known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol, Self

from prooflight.detectors.disposition import Disposition, gravest

if TYPE_CHECKING:
    from prooflight.detectors.verdict import Verdict, VerdictName
    from prooflight.pages.layout.imposing import Place
    from prooflight.pages.layout.plan import SheetPlan

WORST_FIRST: Final[tuple[VerdictName, ...]] = ("misprint", "not-inspected", "good")
OPEN_SHEETS: Final = 4096
"""Greatest number of sheets that wait for a side or for the rest of their set.

assumed: no loop, batch or set is longer, and one that is gets its verdict before its end, which says so.
"""
PATIENCE: Final = 64
"""assumed: no side comes later than this after its turn. [positions]"""
NEXT: Final = 4
"""Patience of a live display: a sheet is reported when the next two or three have come. [positions]"""
NAMED: Final = 5
"""Greatest number of sheets that are named; the rest is counted."""
NEVER: Final = "the sheet was not detected"
HOLD: Final[tuple[Disposition, ...]] = ("hold",)
SideName = Literal["front", "back", ""]


class SideRow(Protocol):
    """Record of a side that passed, or did not: a row of the journal, ``journal.records.PageRecord``."""

    @property
    def sheet(self) -> int:
        """Return its number in the run."""

    @property
    def job_page(self) -> int | None:
        """Return its position; None: it cannot be placed."""

    @property
    def verdict(self) -> Verdict:
        """Return the verdict on the side."""

    @property
    def faults(self) -> tuple[str, ...]:
        """Return the faults of the paper path, and of the camera's lines."""

    @property
    def disposition(self) -> Disposition:
        """Return its disposition."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageVerdict:
    """Verdict on one page at one place."""

    page: int
    """Number of the page in the job, from 1."""
    place: int
    """Place on its side, from 1, row by row from the top left as the side was laid out."""
    verdict: VerdictName
    why: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SideVerdict:
    """Verdict on one side of a sheet."""

    side: SideName
    """Side of the sheet; empty: the sheet has but one."""
    name: str
    verdict: VerdictName
    why: str = ""
    came: bool = True
    """Whether the camera saw it."""
    rows: tuple[int, ...] = ()
    """Row numbers in the journal; more than one: it came again."""
    faults: tuple[str, ...] = ()
    pages: tuple[PageVerdict, ...] = ()
    disposition: Disposition = "accept"
    """Disposition of the side, the gravest where it came more than once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetVerdict:
    """Verdict on one sheet of a run."""

    sheet: int
    """Number in the run, from 0."""
    copy: int
    """Number of the copy of the job, from 1."""
    number: int
    """Number in the job, from 1."""
    name: str
    verdict: VerdictName
    why: tuple[str, ...]
    sides: tuple[SideVerdict, ...]
    set_number: int | None = None
    """Number of its set, from 0; None: the job has no sets."""

    @property
    def disposition(self) -> Disposition:
        """Return its disposition, the gravest of its sides."""
        return gravest(side.disposition for side in self.sides)

    @property
    def missing(self) -> bool:
        """Return whether no side of it came."""
        return not any(side.came for side in self.sides)

    @property
    def doubled(self) -> bool:
        """Return whether a side of it came again."""
        return any(len(side.rows) > 1 or "repeated" in side.faults for side in self.sides)

    @property
    def out_of_order(self) -> bool:
        """Return whether a side of it came after its turn."""
        return any("out-of-order" in side.faults for side in self.sides)

    @property
    def clean(self) -> bool:
        """Return whether it is good and came once, in its turn."""
        return self.verdict == "good" and not (self.doubled or self.out_of_order)

    @property
    def bad_pages(self) -> tuple[int, ...]:
        """Return the pages of the job, from 1, that are not good."""
        return tuple(
            dict.fromkeys(page.page for side in self.sides for page in side.pages if page.verdict != "good")
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SetVerdict:
    """Verdict on a set of a run's sheets."""

    set_number: int
    """Number in the run, from 0."""
    sheets: int
    """Number of sheets that it should have."""
    verdict: VerdictName
    bad: tuple[int, ...] = ()
    """Sheets of the run that are misprints."""
    unseen: tuple[int, ...] = ()
    """Sheets that came, but were not all inspected."""
    missing: tuple[int, ...] = ()
    doubled: tuple[int, ...] = ()
    out_of_order: tuple[int, ...] = ()
    disposition: Disposition = "accept"
    """Disposition of the set, the gravest of its sheets; hold where one did not come."""

    @property
    def complete(self) -> bool:
        """Return whether all its sheets came, once each and in order."""
        return not (self.missing or self.doubled or self.out_of_order)

    @property
    def why(self) -> tuple[str, ...]:
        """Return the reasons why it may not be delivered."""
        reasons = (
            ("misprint", self.bad),
            ("not all inspected", self.unseen),
            ("missing", self.missing),
            ("doubled", self.doubled),
            ("out of order", self.out_of_order),
        )
        return tuple(f"{what}: {_numbers(sheets)}" for what, sheets in reasons if sheets)

    @property
    def clean(self) -> bool:
        """Return whether it is good and complete: it may be delivered."""
        return self.verdict == "good" and self.complete


def _numbers(sheets: Sequence[int]) -> str:
    """Return sheets by number; of many the first."""
    more = f" and {len(sheets) - NAMED} more" if len(sheets) > NAMED else ""
    return f"sheet{'s' if len(sheets) > 1 else ''} {', '.join(map(str, sheets[:NAMED]))}{more}"


def worst(verdicts: Iterable[VerdictName]) -> VerdictName:
    """Return the worst of the verdicts; good where there is none."""
    return min(verdicts, key=WORST_FIRST.index, default="good")


def came(record: SideRow) -> bool:
    """Return whether a row of the journal is of a side that the camera saw, and not of one that did not come.

    A side that came after a gap has the fault ``missing`` too, but was inspected, or says why it was not.
    """
    return not (
        record.faults == ("missing",)
        and record.verdict.verdict == "not-inspected"
        and not record.verdict.detector
        and record.job_page is not None
    )


def why_of(verdict: Verdict) -> str:
    """Return the reason for a verdict in a few words."""
    return "" if verdict.verdict == "good" else verdict.reason or verdict.kind or verdict.verdict


def page_verdicts(
    verdict: Verdict, pages: Sequence[int | None], places: Sequence[Place]
) -> tuple[PageVerdict, ...]:
    """Return the verdicts on the pages of one side.

    pages: their numbers by place; None where it stays blank, and a misprint there alone spoils no page.
    places: in mm of the side; empty: unknown.
    """
    decision, why = verdict.verdict, why_of(verdict)
    if decision == "misprint" and len(pages) > 1 and len(places) == len(pages):
        boxes = [(one.x_mm, one.y_mm, one.width_mm, one.height_mm) for one in verdict.regions]
        boxes += [(one.x_mm, one.y_mm, one.width_mm, one.height_mm) for one in verdict.codes if one.failed]
        hit = [any(place.meets(box) for box in boxes) for place in places]
        if any(hit):
            return tuple(
                PageVerdict(
                    page=page, place=at, verdict="misprint" if bad else "good", why=why if bad else ""
                )
                for at, (page, bad) in enumerate(zip(pages, hit, strict=True), start=1)
                if page is not None
            )
    return _all_alike(pages, decision, why)


def _all_alike(pages: Sequence[int | None], verdict: VerdictName, why: str = "") -> tuple[PageVerdict, ...]:
    return tuple(
        PageVerdict(page=page, place=at, verdict=verdict, why=why)
        for at, page in enumerate(pages, start=1)
        if page is not None
    )


def side_verdict(
    plan: SheetPlan, sheet: int, back: int, records: Sequence[SideRow], *, passed: bool = False
) -> SideVerdict:
    """Return the verdict on one side.

    records: the journal's rows of it, one each time that it came, or that it did not; none: it did not come,
    or, where it is known to have ``passed``, was good.
    """
    number = (sheet * plan.layout.sides + back) % plan.sides + 1
    shown = [record for record in records if came(record)]
    pages, name = plan.layout.pages_on(number), plan.layout.side_name(number)
    places = plan.places(back=bool(back)) if len(pages) > 1 else []
    side: SideName = "" if plan.layout.sides == 1 else "back" if back else "front"
    if passed and not records:
        return SideVerdict(side=side, name=name, verdict="good", pages=_all_alike(pages, "good"))
    if not shown:
        never = _all_alike(pages, "not-inspected", NEVER)
        return SideVerdict(
            side=side,
            name=name,
            verdict="not-inspected",
            why=NEVER,
            came=False,
            pages=never,
            disposition="hold",
        )
    worst_row = min(shown, key=lambda record: WORST_FIRST.index(record.verdict.verdict))
    return SideVerdict(
        side=side,
        name=name,
        verdict=worst_row.verdict.verdict,
        why=why_of(worst_row.verdict),
        rows=tuple(record.sheet for record in shown),
        faults=tuple(dict.fromkeys(fault for record in shown for fault in record.faults)),
        pages=page_verdicts(worst_row.verdict, pages, places),
        disposition=gravest(record.disposition for record in shown),
    )


def sheet_verdict(plan: SheetPlan, sheet: int, sides: Sequence[SideVerdict]) -> SheetVerdict:
    """Return the verdict on a sheet from its sides, front first."""
    copy, number = divmod(sheet, plan.sheets_a_job)
    why = [f"{side.side}: {side.why}" if side.side else side.why for side in sides if side.verdict != "good"]
    again = [side for side in sides if len(side.rows) > 1 or "repeated" in side.faults]
    why += [f"the {side.side or 'print'} was captured twice" for side in again]
    why += [
        f"the {side.side or 'print'} came out of order" for side in sides if "out-of-order" in side.faults
    ]
    return SheetVerdict(
        sheet=sheet,
        copy=copy + 1,
        number=number + 1,
        name=plan.name(sheet),
        verdict=worst(side.verdict for side in sides),
        why=tuple(why),
        sides=tuple(sides),
        set_number=plan.set_of(sheet),
    )


def set_verdict(plan: SheetPlan, number: int, sheets: Sequence[SheetVerdict]) -> SetVerdict:
    """Return the verdict on a set from its sheets; those that are not among them did not come."""
    by_number = {one.sheet: one for one in sheets}
    own = plan.sheets_of(number)
    missing = [at for at in own if at not in by_number or by_number[at].missing]
    there = [one for at, one in sorted(by_number.items()) if at not in missing]
    verdicts = [one.verdict for one in there] + ["not-inspected" for _ in missing]
    return SetVerdict(
        set_number=number,
        sheets=len(own),
        verdict=worst(verdicts),
        bad=tuple(one.sheet for one in there if one.verdict == "misprint"),
        unseen=tuple(one.sheet for one in there if one.verdict == "not-inspected"),
        missing=tuple(missing),
        doubled=tuple(one.sheet for one in there if one.doubled),
        out_of_order=tuple(one.sheet for one in there if one.out_of_order),
        disposition=gravest([*(one.disposition for one in there), *(HOLD if missing else ())]),
    )


# --- of a run ---


@dataclass(slots=True)
class Counts:
    """Numbers of sheets and sets by verdict; a sheet or set that is counted is complete."""

    sheets: dict[VerdictName, int] = field(default_factory=lambda: dict.fromkeys(WORST_FIRST, 0))
    sets: dict[VerdictName, int] = field(default_factory=lambda: dict.fromkeys(WORST_FIRST, 0))
    spoiled: int = 0
    """Number of sets that may not be delivered as they are."""

    @classmethod
    def of(cls, counted: Iterable[SheetVerdict | SetVerdict]) -> Self:
        """Count these sheets and sets."""
        counts = cls()
        for one in counted:
            counts.add(one)
        return counts

    def add(self, counted: SheetVerdict | SetVerdict) -> None:
        """Count one more sheet or set."""
        if isinstance(counted, SheetVerdict):
            self.sheets[counted.verdict] += 1
        else:
            self.sets[counted.verdict] += 1
            self.spoiled += not counted.clean

    @property
    def facts(self) -> dict[str, Any]:
        """Return the counts in types that JSON can hold."""
        return {"sheets": dict(self.sheets), "sets": dict(self.sets), "sets_spoiled": self.spoiled}


class Assembling:
    """Assembly of sides to sheets and sets as their rows come; its memory is bounded however long the run is.

    A sheet's verdict is due when a side has come that lies ``patience`` positions or more after its last one:
    any side that comes after its turn, or twice, has come by then. The rest is due at the end.
    """

    def __init__(self, plan: SheetPlan, *, patience: int = PATIENCE) -> None:
        self.plan, self.counts, self._patience = plan, Counts(), patience
        self._rows: dict[int, list[list[SideRow]]] = {}
        self._sets: dict[int, list[SheetVerdict]] = {}
        self._next = 0
        """Number of the first sheet that has no verdict yet."""

    def add(self, record: SideRow) -> list[SheetVerdict | SetVerdict]:
        """Add one row, in the order of the run; return the verdicts that are due with it.

        A side that cannot be placed belongs to no sheet.
        """
        position = record.job_page
        if position is None or not 0 <= position < self.plan.passings:
            return []
        sheet, back = self.plan.sheet_at(position)
        if sheet >= self._next:  # else it has been told: the side came far behind its turn
            self._rows.setdefault(sheet, [[] for _ in range(self.plan.layout.sides)])[back].append(record)
        return list(self._verdicts_until(self._due(position)))

    def end(self) -> list[SheetVerdict | SetVerdict]:
        """Return the remaining verdicts, up to the last sheet of which any side came."""
        verdicts = list(self._verdicts_until(max((sheet + 1 for sheet in self._rows), default=self._next)))
        return [*verdicts, *(self._set_verdict(own) for own in sorted(self._sets))]

    def _due(self, position: int) -> int:
        until = self._next
        while until < self.plan.sheets and max(self.plan.positions(until)) <= position - self._patience:
            until += 1
        return max(until, max(self._rows, default=0) - OPEN_SHEETS)

    def _verdicts_until(self, until: int) -> Iterator[SheetVerdict | SetVerdict]:
        while self._next < until:
            sheet, self._next = self._next, self._next + 1
            rows = self._rows.pop(sheet, None) or [[] for _ in range(self.plan.layout.sides)]
            sides = [side_verdict(self.plan, sheet, at, one) for at, one in enumerate(rows)]
            verdict = sheet_verdict(self.plan, sheet, sides)
            self.counts.add(verdict)
            yield verdict
            own = verdict.set_number
            if own is None:
                continue
            self._sets.setdefault(own, []).append(verdict)
            if sheet + 1 == self.plan.sheets_of(own).stop:
                yield self._set_verdict(own)

    def _set_verdict(self, own: int) -> SetVerdict:
        verdict = set_verdict(self.plan, own, self._sets.pop(own))
        self.counts.add(verdict)
        return verdict


def assembled(plan: SheetPlan, records: Iterable[SideRow]) -> Iterator[SheetVerdict | SetVerdict]:
    """Yield all sheets and sets of a run from all its rows, in order."""
    assembling = Assembling(plan)
    for record in records:
        yield from assembling.add(record)
    yield from assembling.end()


@dataclass(frozen=True, slots=True, kw_only=True)
class ReviewList:
    """Sheets and sets of a run that are not clean, and the number of each kind."""

    sheets: tuple[SheetVerdict, ...]
    sets: tuple[SetVerdict, ...]
    counts: Counts


def to_review(plan: SheetPlan, records: Iterable[SideRow], *, passed: int, ended: bool) -> ReviewList:
    """Return the same from those rows alone that a person should see, as all others are good.

    passed: number of positions that have been passed. ended: whether no more come; else what lacks a side is
    not due yet.
    """
    rows: dict[int, list[list[SideRow]]] = {}
    for record in records:
        position = record.job_page
        if position is not None and 0 <= position < plan.passings:
            sheet, back = plan.sheet_at(position)
            rows.setdefault(sheet, [[] for _ in range(plan.layout.sides)])[back].append(record)
    seen = _first_not(range(plan.sheets), lambda sheet: max(plan.positions(sheet)) < passed)
    while ended and seen < plan.sheets and min(plan.positions(seen)) < passed:  # a part of it came
        rows.setdefault(seen, [[] for _ in range(plan.layout.sides)])
        seen += 1
    counts, sheets = Counts(), dict[int, SheetVerdict]()
    for sheet in sorted(rows):
        if sheet >= seen:
            break
        sides = [
            side_verdict(plan, sheet, back, own, passed=at < passed)
            for back, (own, at) in enumerate(zip(rows[sheet], plan.positions(sheet), strict=True))
        ]
        verdict = sheet_verdict(plan, sheet, sides)
        if not verdict.clean:
            sheets[sheet] = verdict
            counts.add(verdict)
    counts.sheets["good"] += seen - len(sheets)
    sets, of_set = [], plan.layout.sheets_a_set
    if of_set is not None:
        begun = -(-seen // of_set)
        of_sets = dict.fromkeys(sheet // of_set for sheet in sheets)
        if begun and plan.sheets_of(begun - 1).stop > seen:
            of_sets[begun - 1] = None  # the run is within it, or ended there
            if not ended:
                of_sets.pop(begun - 1)
                begun -= 1
        for own in of_sets:
            there = [sheets.get(at) or _good(plan, at) for at in plan.sheets_of(own) if at < seen]
            sets.append(set_verdict(plan, own, there))
            counts.add(sets[-1])
        counts.sets["good"] += begun - len(sets)
    return ReviewList(sheets=tuple(sheets.values()), sets=tuple(sets), counts=counts)


def _good(plan: SheetPlan, sheet: int) -> SheetVerdict:
    sides = [side_verdict(plan, sheet, back, (), passed=True) for back in range(plan.layout.sides)]
    return sheet_verdict(plan, sheet, sides)


def _first_not(among: range, holds: Callable[[int], bool]) -> int:
    """Return the first for which it does not hold, where it holds for none after it.

    Return their end where it holds for all.
    """
    low, high = among.start, among.stop
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if holds(middle) else (low, middle)
    return low
