"""Sheets that have passed the gate: the decision for each, and the tray that the controller confirmed.

A controller reports the tray of the last sheet after that sheet has passed. If two sheets pass between
reports, it reports the second only. A sheet therefore waits a while for its confirmation, and is then
reported without one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from prooflight_line.plant.events import SheetAtGate
from prooflight_line.plant.gate.deciding import disposition_of
from prooflight_line.plant.gate.registers import Code

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight_line.plant.events import GateCode, TrayName
    from prooflight_line.plant.gate.deciding import SheetDecision

PATIENCE_S: Final = 1.0
"""Longest wait for a confirmation after a sheet was due at the gate. assumed: ten exchanges of a slow
controller."""
NAMES: Final[dict[Code, GateCode]] = {
    Code.GOOD: "good",
    Code.MISPRINT: "misprint",
    Code.NOT_INSPECTED: "not-inspected",
    Code.LOST_LINES: "lost-lines",
    Code.UNKNOWN_SHEET: "unknown-sheet",
    Code.OUT_OF_PLACE: "out-of-place",
    Code.SET_SPOILED: "set-spoiled",
    Code.UNTIL_CLEAN_BREAK: "until-clean-break",
    Code.TOO_LATE: "too-late",
    Code.PLACE_UNKNOWN: "place-unknown",
}


@dataclass(slots=True, kw_only=True)
class _Passing:
    decision: SheetDecision
    code: Code
    in_time: bool = False
    passed_s: float | None = None
    """Time at which it was due at the gate; None: it has not passed."""


class PassedSheets:
    """Reporter that reports every sheet once. It is called by one thread at a time."""

    def __init__(self, report: Callable[[SheetAtGate], None]) -> None:
        self._report = report
        self._sheets: dict[int, _Passing] = {}

    def decided(self, decision: SheetDecision) -> None:
        """Take a sheet on its way to the gate."""
        self._sheets[decision.tag] = _Passing(decision=decision, code=decision.code)

    def written(self, tag: int) -> None:
        """Note that the controller has the result of a sheet."""
        if (one := self._sheets.get(tag)) is not None:
            one.in_time = True

    def passed(self, tag: int, *, now_s: float, unsent: Code | None) -> None:
        """Note that a sheet was due.

        ``unsent`` is the reason why the controller did not have its result; None: it had.
        """
        if (one := self._sheets.get(tag)) is not None:
            one.passed_s, one.in_time, one.code = now_s, unsent is None, unsent or one.code

    def confirmed(self, tag: int, tray: TrayName) -> None:
        """Report a sheet in the tray that the controller names."""
        if tag in self._sheets:
            self._leave(tag, tray)

    def overdue(self, now_s: float) -> None:
        """Report sheets whose trays the controller has not reported in time."""
        for tag, one in list(self._sheets.items()):
            if one.passed_s is not None and now_s - one.passed_s >= PATIENCE_S:
                self._leave(tag, "unconfirmed")

    def ended(self) -> None:
        """Report all remaining sheets, because the controller is read no more."""
        for tag in list(self._sheets):
            self._leave(tag, "unconfirmed")

    def _leave(self, tag: int, tray: TrayName) -> None:
        one = self._sheets.pop(tag)
        self._report(
            SheetAtGate(
                sheet=one.decision.sheet,
                page=one.decision.page,
                disposition=disposition_of(one.decision.result),
                code=NAMES[one.code],
                in_time=one.in_time,
                tray=tray,
            )
        )
