"""The exchange with the controller, without a wire: the registers to write next, and the meaning of an answer.

One result is in the registers at a time, until the controller has acknowledged it by its number. Each
connection is a session of its own: the controller forgets the results that it had, and receives again that of
every sheet that has not reached the gate. The exchange therefore does not depend on what either side
remembers of the other.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final, Literal

from prooflight_line.plant.gate.handshake import Event, State, after
from prooflight_line.plant.gate.registers import Fault, OurStatus, Result, Shown, count_distance, packed
from prooflight_line.plant.gate.registers import after as next_number
from prooflight_line.plant.gate.waiting import Pending, Waiting

if TYPE_CHECKING:
    from collections.abc import Callable

    from prooflight.press.gate import GateSettings
    from prooflight_line.plant.events import SheetAtGate
    from prooflight_line.plant.gate.deciding import SheetDecision
    from prooflight_line.plant.gate.log import GateLog
    from prooflight_line.plant.gate.tracking import Tracker

TRAYS: Final[dict[int, Literal["good", "reject"]]] = {1: "good", 2: "reject"}
POLICIES: Final = {"reject": 0, "accept": 1, "stop": 2}


class Exchange(Waiting):
    """Queue of results; the link takes registers to write and returns answers. It may be used by several threads."""

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
        """Begin an exchange; the arguments are those of ``Waiting``."""
        super().__init__(settings, tracker, log=log, tell=tell, report=report, clock=clock)
        self._session = self._number = self._heartbeat = 0
        self._current: Pending | None = None
        self._result: dict[str, int] = {}
        self._at_camera = self._busy = 0
        self._stop = self._was_taken = False
        self._fault = Fault.NONE
        self._beat: tuple[int, float] = (-1, 0.0)
        self._at_gate: int | None = None

    @property
    def session(self) -> int:
        """Number of the session of this connection; 0 before the first."""
        return self._session

    @property
    def waiting(self) -> int:
        """Number of decided sheets that have not reached the gate."""
        with self._guard:
            self._passed(self._clock())
            return len(self._sheets)

    # --- from the run ---

    def arrived(self, tag: int) -> None:
        """Note that a sheet has passed the camera and will be decided."""
        with self._guard:
            self._at_camera, self._busy = tag, self._busy + 1

    def post(self, decision: SheetDecision, *, line: int, last_line_s: float) -> None:
        """Take the decision for a sheet; never waits."""
        super().post(decision, line=line, last_line_s=last_line_s)
        self.wake.set()

    def _posted(self, decision: SheetDecision) -> None:
        self._busy = max(self._busy - 1, 0)
        self._stop |= decision.result is Result.STOP

    # --- from the link ---

    def connected(self, shown: Shown, *, session: int) -> None:
        """Begin a session with a controller that answers, and shows this."""
        with self._guard:
            self._join(session)
            self._beat = (shown.values["plc_heartbeat"], self._clock())
            self._tracker.forget_readings()
            self._step(Event.CONNECTED, f"session {session}")

    def words(self) -> list[int]:
        """Return the registers to write now."""
        now_s = self._clock()
        with self._guard:
            self._passed(now_s)
            if self._state is State.READY and self._current is None:
                self._next()
            self._heartbeat = next_number(self._heartbeat)
            status = OurStatus(0)
            for flag, holds in (
                (OurStatus.READY, self._state is State.READY),
                (OurStatus.BUSY, self._busy > 0 or any(not one.taken for one in self._sheets.values())),
                (OurStatus.RESULT_VALID, bool(self._result)),
                (OurStatus.PASS, self._result.get("result") == Result.ACCEPT),
                (OurStatus.FAULT, self._fault is not Fault.NONE),
                (OurStatus.STOP, self._stop),
            ):
                status |= flag if holds else 0
            return packed(
                {
                    "status": int(status),
                    "heartbeat": self._heartbeat,
                    "session": self._session,
                    "policy": POLICIES[self._settings.policy],
                    "fault": int(self._fault),
                    "sheet_at_camera": self._at_camera,
                    "tolerance": round(self._settings.tolerance_mm * self._settings.plc.counts_per_mm),
                    **self._result,
                }
            )

    def wrote(self) -> None:
        """Note that the controller has confirmed the write."""
        now_s = self._clock()
        with self._guard:
            if self._current is not None and self._current.written_s is None:
                self._current.written_s = now_s

    def answered(self, shown: Shown, *, request_s: float, answered_s: float) -> bool:
        """Take what the controller shows, and return whether it is alive.

        It is not alive if its heartbeat has stood still for too long.
        """
        values = shown.values
        self._tracker.counted(values["encoder"], request_s=request_s, answered_s=answered_s)
        aligned = self._tracker.aligned
        with self._guard:
            if values["plc_heartbeat"] != self._beat[0]:
                self._beat = (values["plc_heartbeat"], answered_s)
            elif answered_s - self._beat[1] > self._settings.plc.heartbeat_ms / 1e3:
                self._fault = Fault.PLC_HEARTBEAT
                return False
            if values["session_taken"] == self._session:
                self._was_taken = True
                self._step(Event.TAKEN, "")
            else:
                self._step(Event.DROPPED, "the controller has forgotten this session")
            if aligned:
                self._step(Event.ALIGNED, "")
            else:
                self._step(Event.MISALIGNED, "the encoder and the camera's lines do not agree")
            self._fault = {State.JOINING: Fault.NOT_TAKEN, State.ALIGNING: Fault.ENCODER}.get(
                self._state, Fault.NONE
            )
            self._acknowledge(values["result_taken"], answered_s)
            self._log_trays(shown)
        return True

    def lost(self, why: str) -> None:
        """Note that no answer came in time."""
        with self._guard:
            self._step(Event.LOST, why)

    def dropped(self, *, session: int) -> bool:
        """Return whether the controller has forgotten this session after taking it; if so, begin another session."""
        with self._guard:
            if self._state is not State.JOINING or not self._was_taken:
                return False
            self._join(session)
            return True

    # --- parts ---

    def _join(self, session: int) -> None:
        self._session, self._number, self._was_taken = session, 0, False
        self._current, self._result, self._at_gate = None, {}, None
        for one in self._sheets.values():
            one.taken = False
        self._log.add("session", session=session)

    def _step(self, event: Event, why: str) -> None:
        self._went(after(self._state, event), why)

    def _next(self) -> None:
        for tag, one in self._sheets.items():
            if one.taken:
                continue
            position = self._tracker.position(one.line) if one.position is None else one.position
            if position is None:
                continue
            self._current, one.written_s = one, None
            self._number = next_number(self._number)
            self._result = {
                "result_number": self._number,
                "tag": tag,
                "result": int(one.decision.result),
                "code": int(one.decision.code),
                "position": position,
            }
            return

    def _acknowledge(self, number: int, now_s: float) -> None:
        one = self._current
        if one is None or number != self._number:
            return
        self._current = None
        position = self._result["position"]
        self._written(one, session=self._session, position=position, at_s=one.written_s or now_s)
        if any(not sheet.taken for sheet in self._sheets.values()):
            self.wake.set()

    def _log_trays(self, shown: Shown) -> None:
        """Log the trays of the sheets since the last exchange of this session."""
        count = shown.values["sheets_at_gate"]
        new = 0 if self._at_gate is None else count_distance(count, self._at_gate)
        self._at_gate = count
        for tag, number in shown.passed(max(new, 0), last_tag=self._at_camera):
            tray = TRAYS.get(number)
            self._log.add("tray", tag=tag, tray=tray or "unknown", session=self._session)
            self._left.confirmed(tag, tray or "unconfirmed")

    def _passed(self, now_s: float) -> None:
        """Forget sheets that have reached the gate, and report each that was not written in time."""
        for _, one in self._overdue(now_s):
            if one is self._current:
                self._current = None
