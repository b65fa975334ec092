"""The gate of a running press: told of every sheet, it decides, and has the controller told in time."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from prooflight.plant.gate.coil import CoilTalk
from prooflight.plant.gate.deciding import GateDecider, disposition_of
from prooflight.plant.gate.exchange import Exchange
from prooflight.plant.gate.handshake import State
from prooflight.plant.gate.link import PlcLink, RegisterTalk, Wire
from prooflight.plant.gate.log import GateLog, PlantError, log_path
from prooflight.plant.gate.sides import SidesTogether
from prooflight.plant.gate.tracking import TrackedLines, Tracker, Transport

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from prooflight.detectors.disposition import Disposition
    from prooflight.line.outcomes import Outcome
    from prooflight.line.sheets.records import SeenPage
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.plant.events import SheetAtGate
    from prooflight.press.gate import GateSettings
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.lines import LineSource

CYCLES: Final = 3
"""Exchanges that a result may take to be in the registers: one under way, its own, and one that is repeated."""
LEAVING_S: Final = 30.0
"""After which the end of a run waits no longer for its last sheets to reach the gate."""
SETTLING_S: Final = 0.3
"""The last sheet may reach the gate late by the tolerance, and the controller then says where it went."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Travel:
    """Whether a verdict can be at the gate before its sheet."""

    distance_mm: float
    speed_mm_s: float
    sheet_mm: float
    """From the leading edge to the last line of a scan."""
    deadline_s: float
    """From the last line to the verdict."""
    exchange_s: float
    """From the verdict to its register."""

    @property
    def spare_s(self) -> float:
        """What is left when the result is in its register."""
        return (self.distance_mm - self.sheet_mm) / self.speed_mm_s - self.deadline_s - self.exchange_s

    @property
    def least_mm(self) -> float:
        """Distance at which nothing is left."""
        return self.sheet_mm + (self.deadline_s + self.exchange_s) * self.speed_mm_s


def exchange_s(settings: GateSettings) -> float:
    """What an exchange is reckoned to take at most where the controller answers in time."""
    plc = settings.plc
    return (CYCLES * plc.cycle_ms + plc.timeout_ms) / 1e3


def refuse_near(settings: GateSettings, travel: Travel, *, where: object) -> None:
    """PlantError: sheets reach the gate before their verdicts can. where: the press file."""
    if travel.spare_s < 0:
        what = (
            f"[gate] distance_mm = {settings.distance_mm:g} is nearer than the verdict can be: sheets of "
            f"{travel.sheet_mm:.0f} mm at {travel.speed_mm_s:.0f} mm/s need {travel.least_mm:.0f} mm"
        )
        raise PlantError(where, what, remedy="move the gate, run slower, or give a shorter --deadline")


def refuse_close(settings: GateSettings, sheet_mm: float, *, where: object) -> None:
    """PlantError: two sheets could be expected at one place. sheet_mm: of the shortest; where: the press file."""
    if 2 * settings.tolerance_mm >= sheet_mm:
        what = f"[gate] tolerance_mm = {settings.tolerance_mm:g} is half a sheet of {sheet_mm:.0f} mm or more"
        raise PlantError(where, what, remedy=f"give less than {sheet_mm / 2:.0f}")


def try_controller(settings: GateSettings) -> dict[str, int]:
    """What the controller shows; of an output, whether it is on. Nothing is written.

    PlantError: it does not answer, or has no such registers.
    """
    wire = Wire(settings.plc)
    try:
        if settings.plc.style == "coil":
            return {"coil": wire.coil()}
        return wire.checked()
    finally:
        wire.close()


class Gate:
    """One run's gate; use it as a context, around the run."""

    def __init__(
        self,
        settings: GateSettings,
        geometry: ScanGeometry,
        *,
        job_pages: int,
        plan: SheetPlan | None = None,
        journal: Path | None = None,
        run_id: int = 0,
        tell: Callable[[State, str], None] = lambda _state, _why: None,
        report: Callable[[SheetAtGate], None] = lambda _passed: None,
        clock: Callable[[], float] = time.monotonic,
        open_wire: Callable[..., Wire] = Wire,
        pace: float = 1.0,
    ) -> None:
        """job_pages: of one copy. plan: how they lie on sheets; None: a page a sheet. journal: beside which the gate's
        log lies; None: none is kept. tell, report: as of ``Waiting``. open_wire, pace: as of ``PlcLink``.
        """
        self.settings = settings
        self._lead_in = round(geometry.lead_in_mm / geometry.line_pitch_mm)
        self._clock, self._pace = clock, pace
        transport = Transport(line_pitch_mm=geometry.line_pitch_mm, counts_per_mm=settings.plc.counts_per_mm)
        self.tracker = Tracker(
            transport, distance_mm=settings.distance_mm, tolerance_mm=settings.tolerance_mm
        )
        self._sides = None if plan is None else SidesTogether(plan)
        self.decider = GateDecider(
            settings=settings
            if plan is None
            else replace(settings, pages_a_set=plan.layout.sheets_a_set or 1),
            job_pages=job_pages if plan is None else plan.sheets_a_job,
        )
        self._log = GateLog(None if journal is None else log_path(journal, run_id))
        sheets = {} if plan is None else {"layout": plan.facts}
        self._log.add("run", run=run_id, job_pages=job_pages, settings=asdict(settings), **sheets)

        def stepped(state: State, why: str) -> None:
            self._log.add("state", state=str(state), why=why)
            tell(state, why)

        how: dict[str, Any] = {"log": self._log, "tell": stepped, "report": report, "clock": clock}
        self.talk: Exchange | CoilTalk
        if settings.plc.style == "coil":
            self.talk = coil = CoilTalk(settings, self.tracker, **how)
            self._link = PlcLink(settings.plc, coil, open_wire=open_wire, pace=pace)
        else:
            self.talk = exchange = Exchange(settings, self.tracker, **how)
            self._link = PlcLink(
                settings.plc, RegisterTalk(exchange, clock=clock), open_wire=open_wire, pace=pace
            )

    def __enter__(self) -> Gate:
        self._link.start()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self._let_pass()
        self._link.close()
        self.talk.ended()
        self._log.add("end", too_late=self.talk.too_late)
        self._log.close()

    def followed(self, source: LineSource) -> TrackedLines:
        """The source, with its lines followed to the gate."""
        return TrackedLines(source, self.tracker)

    def arrived(self, number: int, page: SeenPage) -> None:
        """A sheet has passed the camera; where it comes again with its other side, it is on its way to no gate."""
        if self._sides is None or self._sides.is_due(page.job_page):
            self.talk.arrived(number + 1)

    def told(self, outcome: Outcome) -> Outcome:
        """Decide the next sheet, or a page that did not come, in the order of the run; return it with that.

        A side that comes before its sheet is decided has what the policy says of it alone.
        """
        record, came, more = outcome.record, outcome.came, dict[str, Any]()
        if self._sides is not None:
            found = self._sides.add(record, came=came)
            if found is None:
                return _decided(outcome, self.decider.alone(record, came=came))
            record, came, more = found.record, found.came, {"rows": found.rows}
        while self.talk.lost_sheets:
            self.decider.lost(self.talk.lost_sheets.popleft())
        decision = self.decider.decide(record, came=came)
        line = record.first_line + self._lead_in
        # The log first: whoever is killed between the two has said what the controller may know.
        self._log.add(
            "decision",
            tag=decision.tag,
            sheet=decision.sheet,
            came=decision.came,
            result=int(decision.result),
            code=int(decision.code),
            job_page=decision.job_page,
            page=decision.page,
            set=decision.set_number,
            why=decision.why,
            position=self.tracker.position(line) if decision.came else None,
            **more,
        )
        if decision.came:
            self.talk.post(decision, line=line, last_line_s=record.time_s)
        return _decided(outcome, disposition_of(decision.result))

    def _let_pass(self) -> None:
        """Wait until the last sheets have reached the gate; a heartbeat that stops would reject them."""
        begun_s = self._clock()
        until = self._link.closing
        while self.talk.waiting and self.talk.state is State.READY and self._clock() - begun_s < LEAVING_S:
            if until.wait(0.02 / self._pace):
                return
        if self.talk.state is State.READY:
            until.wait(SETTLING_S / self._pace)


def _decided(outcome: Outcome, disposition: Disposition) -> Outcome:
    return replace(outcome, record=replace(outcome.record, gate=disposition))
