"""Decision for each sheet at the gate: accept, divert, or stop the press.

Sheets come in the order of the run. A misprint is never accepted. A sheet in doubt follows the policy of the
press file. A bad sheet takes others with it: the rest of its set and, if the stack must keep its order, all
that follow until a whole copy of the job begins.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from prooflight.detectors.disposition import NOT_ITS_PLACE, NOT_WHOLE
from prooflight_line.plant.gate.registers import Code, Result

if TYPE_CHECKING:
    from collections.abc import Mapping

    from prooflight.detectors.disposition import Disposition
    from prooflight.press.gate import GateSettings
    from prooflight_line.journal.records import PageRecord

UNKNOWN_PAGES: Final = frozenset({"unknown", "blank"})
DOUBTS: Final = frozenset({Code.NOT_INSPECTED, Code.LOST_LINES, Code.TOO_LATE, Code.PLACE_UNKNOWN})
"""Codes to which the policy applies; for all other codes the decision is fixed."""
CODE_TEXTS: Final = {
    Code.GOOD: "good",
    Code.MISPRINT: "the sheet is a misprint",
    Code.NOT_INSPECTED: "the sheet was not inspected",
    Code.LOST_LINES: "camera lines were lost or are surplus",
    Code.UNKNOWN_SHEET: "the sheet shows no page of the job",
    Code.OUT_OF_PLACE: "the sheet is a duplicate or out of sequence",
    Code.SET_SPOILED: "another page of the set is bad or missing",
    Code.UNTIL_CLEAN_BREAK: "the sheet follows a bad sheet, before the next copy begins",
    Code.TOO_LATE: "the result came too late for the gate",
    Code.PLACE_UNKNOWN: "the arrival time at the gate could not be determined",
}
"""Description of each code, for people."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetDecision:
    """Decision for one sheet."""

    sheet: int
    """Number of the sheet in the run, from 0."""
    result: Result
    code: Code
    job_page: int | None
    """Page of the run that the sheet shows or stands for; None: not known."""
    page: str
    set_number: int
    """Number of the set, from 0."""
    came: bool = True
    """Whether a sheet came. False: the decision is about a page that did not come."""
    why: str = ""

    @property
    def tag(self) -> int:
        """Number of the sheet for the controller: from 1, because 0 means none."""
        return self.sheet + 1


@dataclass(slots=True)
class GateDecider:
    """Decider that takes the sheets one by one, in the order of the run."""

    settings: GateSettings
    job_pages: int
    """Number of pages of one copy of the job."""
    _last_page: int = -1
    _spoiled: set[int] = field(default_factory=set)
    _diverting: bool = False
    _stopped: bool = False
    _bad: deque[bool] = field(init=False)

    def __post_init__(self) -> None:
        of_sheets = 0 if self.settings.stop_of is None else self.settings.stop_of[1]
        self._bad = deque(maxlen=max(self.settings.stop_in_a_row or 0, of_sheets))

    @property
    def stopped(self) -> bool:
        """Whether the press has been asked to stop."""
        return self._stopped

    def decide(self, record: PageRecord, *, came: bool = True, watched: bool = True) -> SheetDecision:
        """Decide the next sheet, or the next page that did not come.

        ``watched`` False: it passed while nothing watched. Nothing can be sent for it, as its place is not known.
        """
        shown = record.job_page
        place = self._last_page if shown is None else shown
        own_set = max(place, 0) // self.settings.pages_a_set
        if not came:
            self._spoil(own_set)
            return self._decision(record, Result.NONE, Code.NONE, own_set, came=False)
        if not watched:
            self._spoil(own_set)
            return self._decision(record, Result.NONE, Code.NOT_INSPECTED, own_set)
        code = own_code(record)
        result = self._own_result(code)
        if result is Result.ACCEPT:
            code, result = self._in_company(code, shown, own_set)
        elif code in DOUBTS or code is Code.MISPRINT or shown is not None:
            self._spoil(own_set)
        else:
            self._spoil_order()
        if shown is not None:
            self._last_page = max(self._last_page, shown)
        if self._to_stop(code):
            self._stopped, result = True, Result.STOP
        return self._decision(record, result, code, own_set)

    def recall(self, row: Mapping[str, Any]) -> None:
        """Follow a decision that an earlier process of the run made, by its line in the gate's log."""
        code, result, shown, own_set = Code(row["code"]), Result(row["result"]), row["job_page"], row["set"]
        if not row["came"]:
            self._spoil(own_set)
            return
        if code is Code.SET_SPOILED:
            self._spoiled.add(own_set)
        elif code is Code.UNTIL_CLEAN_BREAK:
            self._diverting = True
        elif result is Result.ACCEPT:
            self._diverting = False
        elif code in DOUBTS or code is Code.MISPRINT or shown is not None:
            self._spoil(own_set)
        else:
            self._spoil_order()
        if shown is not None:
            self._last_page = max(self._last_page, shown)
        if result is not Result.NONE:
            self._to_stop(code)

    def alone(self, record: PageRecord, *, came: bool = True) -> Disposition:
        """Return what the policy decides for one side by itself, before its sheet is decided."""
        return disposition_of(self._own_result(own_code(record)) if came else Result.NONE)

    def lost(self, decision: SheetDecision) -> None:
        """Note that an accepted sheet did not get to the good tray, so that the sheets that belong to it follow it."""
        if decision.result is Result.ACCEPT:
            self._spoil(decision.set_number)

    # --- parts ---

    def _own_result(self, code: Code) -> Result:
        if code is Code.GOOD:
            return Result.ACCEPT
        if code in DOUBTS:
            return {"reject": Result.DIVERT, "accept": Result.ACCEPT, "stop": Result.STOP}[
                self.settings.policy
            ]
        return Result.DIVERT

    def _in_company(self, code: Code, shown: int | None, own_set: int) -> tuple[Code, Result]:
        """Return code and result, given the sheets around it, of a sheet that is accepted by itself."""
        if self._diverting:
            begins = self._break_every
            if shown is None or shown % begins or own_set in self._spoiled:
                return Code.UNTIL_CLEAN_BREAK, Result.DIVERT
            self._diverting = False
        if own_set in self._spoiled and self.settings.pages_a_set > 1:
            return Code.SET_SPOILED, Result.DIVERT
        return code, Result.ACCEPT

    @property
    def _break_every(self) -> int:
        """Number of pages from one place where the stack may be broken to the next."""
        sets = self.settings.pages_a_set
        return sets if sets > 1 else max(self.job_pages, 1)

    def _spoil(self, own_set: int) -> None:
        if self.settings.pages_a_set > 1:
            self._spoiled.add(own_set)
        self._spoil_order()

    def _spoil_order(self) -> None:
        self._diverting = self.settings.divert == "until-clean-break"

    def _to_stop(self, code: Code) -> bool:
        """Return whether the press is to be stopped with this sheet."""
        if code in (Code.SET_SPOILED, Code.UNTIL_CLEAN_BREAK):
            return False  # it is good itself
        bad = code in (Code.MISPRINT, Code.UNKNOWN_SHEET)
        self._bad.append(bad)
        if not bad:
            return code in DOUBTS and self.settings.policy == "stop"
        row, share = self.settings.stop_in_a_row, self.settings.stop_of
        recent = list(self._bad)
        if row is not None and len(recent) >= row and all(recent[-row:]):
            return True
        return share is not None and sum(recent[-share[1] :]) >= share[0]

    def _decision(
        self, record: PageRecord, result: Result, code: Code, own_set: int, *, came: bool = True
    ) -> SheetDecision:
        return SheetDecision(
            sheet=record.sheet,
            result=result,
            code=code,
            job_page=record.job_page,
            page=record.verdict.page,
            set_number=own_set,
            came=came,
            why=record.verdict.reason or (record.verdict.kind or ""),
        )


def disposition_of(result: Result) -> Disposition:
    """Return a result as the disposition of all other outlets.

    A page that did not come is held, because a sheet is missing for it.
    """
    by_result: dict[Result, Disposition] = {
        Result.ACCEPT: "accept",
        Result.DIVERT: "divert",
        Result.STOP: "stop",
    }
    return by_result.get(result, "hold")


def own_code(record: PageRecord) -> Code:
    """Return the code of a sheet by itself."""
    faults = set(record.faults)
    if record.verdict.verdict == "misprint":
        return Code.UNKNOWN_SHEET if faults & UNKNOWN_PAGES else Code.MISPRINT
    if faults & NOT_WHOLE:
        return Code.LOST_LINES
    if record.verdict.verdict != "good" or record.job_page is None:
        return Code.NOT_INSPECTED
    return Code.OUT_OF_PLACE if faults & NOT_ITS_PLACE else Code.GOOD
