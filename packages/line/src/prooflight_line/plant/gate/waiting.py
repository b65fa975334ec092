"""Sheets that are decided and have not reached the gate, independent of how the controller receives results."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from threading import Event as Signal
from threading import Lock
from typing import TYPE_CHECKING, Final

from prooflight_line.plant.events import SheetAtGate
from prooflight_line.plant.gate.deciding import disposition_of
from prooflight_line.plant.gate.handshake import State
from prooflight_line.plant.gate.registers import Code, Result

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.press.gate import GateSettings
    from prooflight_line.plant.events import GateCode, TrayName
    from prooflight_line.plant.gate.deciding import SheetDecision
    from prooflight_line.plant.gate.log import GateLog
    from prooflight_line.plant.gate.tracking import Tracker

GIVEN_UP_S: Final = 60.0
"""Time after which a sheet with unknown time at the gate is taken to have passed it."""


@dataclass(slots=True, kw_only=True)
class Pending:
    """A sheet that has not reached the gate."""

    decision: SheetDecision
    line: int
    """The camera's line count at its leading edge."""
    last_line_s: float
    posted_s: float
    written_s: float | None = None
    taken: bool = False
    """Whether the controller has acknowledged it in this session, or its output is set by it."""
    position: int | None = None
    """Encoder count at which it reaches the gate, of a sheet that was decided before the run was resumed."""
    was_taken: bool = False
    """Whether the controller had acknowledged such a sheet before."""


class Waiting:
    """Sheets by tag until they have passed the gate; one lock guards all that several threads use."""

    def __init__(
        self,
        settings: GateSettings,
        tracker: Tracker,
        *,
        log: GateLog,
        tell: Callable[[State, str], None] = lambda _state, _why: None,
        report: Callable[[SheetAtGate], None] = lambda _passed: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin without sheets.

        Parameters
        ----------
        tell
            Called with the new state and the reason when the handshake changes its state.
        report
            Called with every sheet that has passed the gate, and its tray.
        clock
            Clock of the lines.
        """
        self._settings, self._tracker, self._log = settings, tracker, log
        self._tell, self._clock = tell, clock
        self.wake = Signal()
        """Signal that is set when there is something new to write."""
        self._guard = Lock()
        self._state = State.AWAY
        self._sheets: dict[int, Pending] = {}
        self._left = PassedSheets(report)
        self.latencies_s: list[float] = []
        """Time from each sheet's last line to its result with the controller."""
        self.too_late = 0
        """Number of sheets that reached the gate before their result could be written."""
        self.lost_sheets: deque[SheetDecision] = deque()
        """Those of them that were accepted and are lost, until the decider takes them."""

    @property
    def state(self) -> State:
        """State of the handshake."""
        return self._state

    @property
    def waiting(self) -> int:
        """Number of decided sheets that have not passed the gate."""
        with self._guard:
            return len(self._sheets)

    def arrived(self, tag: int) -> None:
        """Note that a sheet has passed the camera and will be decided."""

    def post(self, decision: SheetDecision, *, line: int, last_line_s: float) -> None:
        """Take the decision for a sheet; never waits."""
        now_s = self._clock()
        with self._guard:
            self._posted(decision)
            self._left.decided(decision)
            self._sheets[decision.tag] = Pending(
                decision=decision, line=line, last_line_s=last_line_s, posted_s=now_s
            )

    def resumed(self, decision: SheetDecision, *, position: int | None, was_taken: bool) -> None:
        """Take a sheet that was decided before the run was resumed and may not have reached the gate.

        ``position`` is the encoder count at which it does; None: not known. ``was_taken`` tells whether the
        controller had acknowledged its result.
        """
        now_s = self._clock()
        with self._guard:
            self._left.decided(decision)
            one = Pending(
                decision=decision,
                line=0,
                last_line_s=now_s,
                posted_s=now_s,
                position=position,
                was_taken=was_taken,
            )
            if position is not None:
                self._sheets[decision.tag] = one
                return
            self._unsent(decision.tag, one, Code.PLACE_UNKNOWN)
            self._left.passed(decision.tag, now_s=now_s, unsent=Code.PLACE_UNKNOWN)

    def _due_s(self, one: Pending) -> float | None:
        """Return when a sheet reaches the gate; None: not known."""
        if one.position is None:
            return self._tracker.due_s(one.line)
        return self._tracker.due_at_s(one.position)

    def _posted(self, decision: SheetDecision) -> None:
        """Update what else changes with a decision; called with the lock held."""

    def _went(self, state: State, why: str) -> None:
        if state is not self._state:
            self._state = state
            self._tell(state, why)

    def _overdue(self, now_s: float, *, after_s: float = 0.0) -> list[tuple[int, Pending]]:
        """Forget and return sheets that were due at the gate ``after_s`` ago or more; called with the lock held."""
        forgotten = []
        for tag, one in list(self._sheets.items()):
            due_s = self._due_s(one)
            if now_s >= (one.posted_s + GIVEN_UP_S if due_s is None else due_s + after_s):
                del self._sheets[tag]
                forgotten.append((tag, one))
                unsent = None
                if not one.taken:
                    unsent = Code.PLACE_UNKNOWN if due_s is None else Code.TOO_LATE
                    self._unsent(tag, one, unsent)
                self._left.passed(tag, now_s=now_s, unsent=unsent)
        self._left.overdue(now_s)
        return forgotten

    def ended(self) -> None:
        """Report the sheets whose trays will not be reported any more."""
        with self._guard:
            self._left.ended()

    def _unsent(self, tag: int, one: Pending, code: Code) -> None:
        """Note that a sheet passed before its result could be written."""
        self.too_late += not one.was_taken
        if one.decision.result is Result.ACCEPT and self._rejects:
            self.lost_sheets.append(one.decision)
        if not one.was_taken:  # the controller had its result, if it did not forget it before the sheet came
            self._log.add("unsent", tag=tag, code=int(code), state=str(self._state))

    @property
    def _rejects(self) -> bool:
        """Whether a sheet without a result is rejected."""
        return self._settings.policy != "accept"

    def _written(self, one: Pending, *, session: int, position: int, at_s: float) -> None:
        """Note that the controller has the sheet's result."""
        one.taken = True
        self._left.written(one.decision.tag)
        self.latencies_s.append(at_s - one.last_line_s)
        self._log.add(
            "written",
            tag=one.decision.tag,
            session=session,
            result=int(one.decision.result),
            position=position,
            ms=round(1e3 * (at_s - one.last_line_s), 1),
        )


# --- sheets that have passed the gate ---
#
# A controller reports the tray of the last sheet after that sheet has passed. If two sheets pass between reports, it
# reports the second only. A sheet therefore waits a while for its confirmation, and is then reported without one.

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
