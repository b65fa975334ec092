"""The gate of a running press: it decides every sheet and sends the decision to the controller in time."""

from __future__ import annotations

import time
from collections import OrderedDict
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

from prooflight.detectors.verdict import Verdict
from prooflight.inspection.sheets import OPEN_SHEETS, came, sheet_verdict, side_verdict
from prooflight_line.plant.gate.coil import CoilProtocol
from prooflight_line.plant.gate.deciding import GateDecider, disposition_of
from prooflight_line.plant.gate.exchange import Exchange
from prooflight_line.plant.gate.handshake import State
from prooflight_line.plant.gate.link import PlcLink, RegisterProtocol, Wire
from prooflight_line.plant.gate.log import GateLog, PlantError, log_path
from prooflight_line.plant.gate.registers import Result
from prooflight_line.plant.gate.resuming import on_their_way
from prooflight_line.plant.gate.tracking import TrackedLines, Tracker, Transport

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from prooflight.detectors.disposition import Disposition
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.press.gate import GateSettings
    from prooflight.scans.geometry import ScanGeometry
    from prooflight.scans.lines import LineSource
    from prooflight_line.journal.records import PageRecord
    from prooflight_line.plant.events import SheetAtGate
    from prooflight_line.plant.gate.log import LoggedDecisions
    from prooflight_line.run.outcomes import Outcome
    from prooflight_line.run.sheets.records import SeenPage

CYCLES: Final = 3
"""Exchanges that a result may need to be in the registers: one under way, its own, and one that is repeated."""
LEAVING_S: Final = 30.0
"""Longest wait, at the end of a run, for its last sheets to reach the gate."""
SETTLING_S: Final = 0.3
"""Wait for the last sheet, which may reach the gate late by the tolerance, and for the controller's report
of its tray."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Travel:
    """Time budget that shows whether a verdict can be at the gate before its sheet."""

    distance_mm: float
    speed_mm_s: float
    sheet_mm: float
    """Length from the leading edge to the last line of a scan."""
    deadline_s: float
    """Time from the last line to the verdict."""
    exchange_s: float
    """Time from the verdict to its register."""

    @property
    def spare_s(self) -> float:
        """Time that remains when the result is in its register."""
        return (self.distance_mm - self.sheet_mm) / self.speed_mm_s - self.deadline_s - self.exchange_s

    @property
    def least_mm(self) -> float:
        """Distance at which no time remains."""
        return self.sheet_mm + (self.deadline_s + self.exchange_s) * self.speed_mm_s


def exchange_s(settings: GateSettings) -> float:
    """Return the longest time that an exchange should take if the controller answers in time. [s]"""
    plc = settings.plc
    return (CYCLES * plc.cycle_ms + plc.timeout_ms) / 1e3


def refuse_near(settings: GateSettings, travel: Travel, *, where: object) -> None:
    """Raise PlantError if sheets reach the gate before their verdicts can; ``where`` is the press file."""
    if travel.spare_s < 0:
        what = (
            f"[gate] distance_mm = {settings.distance_mm:g} is too short for the verdict: sheets of "
            f"{travel.sheet_mm:.0f} mm at {travel.speed_mm_s:.0f} mm/s need {travel.least_mm:.0f} mm"
        )
        raise PlantError(where, what, remedy="move the gate, run slower, or give a shorter --deadline")


def refuse_close(settings: GateSettings, sheet_mm: float, *, where: object) -> None:
    """Raise PlantError if two sheets could be expected at one place.

    ``sheet_mm`` is the length of the shortest sheet, and ``where`` the press file.
    """
    if 2 * settings.tolerance_mm >= sheet_mm:
        what = f"[gate] tolerance_mm = {settings.tolerance_mm:g} is half a sheet of {sheet_mm:.0f} mm or more"
        raise PlantError(where, what, remedy=f"give less than {sheet_mm / 2:.0f}")


def try_controller(settings: GateSettings) -> dict[str, int]:
    """Return the values that the controller shows; for an output, whether it is on. Nothing is written.

    PlantError: the controller does not answer, or has no such registers.
    """
    wire = Wire(settings.plc)
    try:
        if settings.plc.style == "coil":
            return {"coil": wire.coil()}
        return dict(wire.checked().values)
    finally:
        wire.close()


class Gate:
    """Gate of one run, used as a context around the run."""

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
        past: LoggedDecisions | None = None,
        open_sides: Iterable[PageRecord] = (),
        clock: Callable[[], float] = time.monotonic,
        open_wire: Callable[..., Wire] = Wire,
        pace: float = 1.0,
    ) -> None:
        """Prepare the gate of a run.

        Parameters
        ----------
        job_pages
            Number of pages of one copy.
        plan
            How the pages are imposed on sheets; None: one page a sheet.
        journal
            Journal next to which the gate's log is written; None: no log is written.
        tell, report
            As for ``Waiting``.
        past
            Gate's log of a run that is resumed; None: the run is new.
        open_sides
            Rows of the sides of that run whose sheets were not decided.
        open_wire, pace
            As for ``PlcLink``.
        """
        self.settings = settings
        self._lead_in = round(geometry.lead_in_mm / geometry.line_pitch_mm)
        self._clock, self._pace = clock, pace
        transport = Transport(line_pitch_mm=geometry.line_pitch_mm, counts_per_mm=settings.plc.counts_per_mm)
        self.tracker = Tracker(
            transport, distance_mm=settings.distance_mm, tolerance_mm=settings.tolerance_mm
        )
        self._sides = None if plan is None else SheetSides(plan)
        self.decider = GateDecider(
            settings=settings
            if plan is None
            else replace(settings, pages_a_set=plan.layout.sheets_a_set or 1),
            job_pages=job_pages if plan is None else plan.sheets_a_job,
        )
        self._log = GateLog(None if journal is None else log_path(journal, run_id))
        if past is None:
            sheets = {} if plan is None else {"layout": plan.facts}
            self._log.add("run", run=run_id, job_pages=job_pages, settings=asdict(settings), **sheets)
        else:
            self._log.add("resumed", run=run_id)

        def stepped(state: State, why: str) -> None:
            self._log.add("state", state=str(state), why=why)
            tell(state, why)

        how: dict[str, Any] = {"log": self._log, "tell": stepped, "report": report, "clock": clock}
        self.protocol: Exchange | CoilProtocol
        if settings.plc.style == "coil":
            self.protocol = coil = CoilProtocol(settings, self.tracker, **how)
            self._link = PlcLink(settings.plc, coil, open_wire=open_wire, pace=pace)
        else:
            self.protocol = exchange = Exchange(settings, self.tracker, **how)
            self._link = PlcLink(
                settings.plc, RegisterProtocol(exchange, clock=clock), open_wire=open_wire, pace=pace
            )

        if past is not None:
            self._resume(past, open_sides)

    def __enter__(self) -> Gate:
        self._link.start()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self._let_pass()
        self._link.close()
        self.protocol.ended()
        self._log.add("end", too_late=self.protocol.too_late)
        self._log.close()

    def followed(self, source: LineSource) -> TrackedLines:
        """Return the source, with its lines tracked to the gate."""
        return TrackedLines(source, self.tracker)

    def arrived(self, number: int, page: SeenPage) -> None:
        """Note that a sheet has passed the camera.

        A sheet that comes again with its other side is not on its way to the gate yet.
        """
        if self._sides is None or self._sides.is_due(page.job_page):
            self.protocol.arrived(number + 1)

    def observe(self, outcome: Outcome) -> Outcome:
        """Decide the next sheet, or a page that did not come, in the order of the run; return it with the decision.

        A side that comes before its sheet is decided gets what the policy decides for it alone.
        """
        record, came, more = outcome.record, outcome.came, dict[str, Any]()
        if self._sides is not None:
            combined = self._sides.add(record, came=came)
            if combined is None:
                return _decided(outcome, self.decider.alone(record, came=came))
            record, came, more = combined.record, combined.came, {"rows": combined.rows}
        while self.protocol.lost_sheets:
            self.decider.lost(self.protocol.lost_sheets.popleft())
        watched = "unwatched" not in outcome.record.faults
        decision = self.decider.decide(record, came=came, watched=watched)
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
            position=None if decision.result is Result.NONE else self.tracker.position(line),
            **more,
        )
        if decision.result is not Result.NONE:
            self.protocol.post(decision, line=line, last_line_s=record.time_s)
        return _decided(outcome, disposition_of(decision.result))

    def _resume(self, past: LoggedDecisions, open_sides: Iterable[PageRecord]) -> None:
        """Continue after the decisions of an earlier process; sheets on their way to the gate are sent once more."""
        for row in past.decisions.values():
            self.decider.recall(row)
        if self._sides is not None:
            for record in open_sides:
                self._sides.add(record, came=came(record))
        self.protocol.too_late = len(past.unsent)
        for decision, position, was_taken in on_their_way(past):
            self.protocol.resumed(decision, position=position, was_taken=was_taken)

    def _let_pass(self) -> None:
        """Wait until the last sheets have reached the gate; a heartbeat that stops would reject them."""
        begun_s = self._clock()
        until = self._link.closing
        while (
            self.protocol.waiting
            and self.protocol.state is State.READY
            and self._clock() - begun_s < LEAVING_S
        ):
            if until.wait(0.02 / self._pace):
                return
        if self.protocol.state is State.READY:
            until.wait(SETTLING_S / self._pace)


def _decided(outcome: Outcome, disposition: Disposition) -> Outcome:
    return replace(outcome, record=replace(outcome.record, gate=disposition))


# --- sides of a sheet: it is decided when the last one was seen ---


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetRecord:
    """Record of a sheet for the gate's decision."""

    record: PageRecord
    """Record of its last side, in which ``job_page`` is the sheet of the run and the verdict is that of
    the sheet."""
    rows: tuple[int, ...]
    """Numbers of its sides in the run."""
    came: bool = True
    """Whether its last side came. False: no sheet is due at the gate."""


@dataclass(slots=True)
class SheetSides:
    """Store of first sides until the last one comes; those of a sheet whose last side never comes are dropped
    in the end.
    """

    plan: SheetPlan
    _first: OrderedDict[int, list[PageRecord]] = field(default_factory=OrderedDict)

    def is_due(self, job_page: int | None) -> bool:
        """Return whether a sheet goes on to the gate with this side.

        A side without a known position may be any side, and its sheet is due.
        """
        return job_page is None or self.plan.sheet_at(job_page)[1] == self.plan.layout.sides - 1

    def add(self, record: PageRecord, *, came: bool) -> SheetRecord | None:
        """Add the next side, and return the sheet to be decided with it.

        None: the sheet comes again for its other side.
        """
        if record.job_page is None or self.plan.layout.sides == 1:
            return SheetRecord(record=record, rows=(record.sheet,), came=came)
        sheet, back = self.plan.sheet_at(record.job_page)
        if not back:
            self._first.setdefault(sheet, []).append(record)
            while len(self._first) > OPEN_SHEETS:
                self._first.popitem(last=False)
            return None
        fronts = self._first.get(sheet, []) if came else self._first.pop(sheet, [])
        sides = [side_verdict(self.plan, sheet, at, records) for at, records in enumerate((fronts, [record]))]
        combined = sheet_verdict(self.plan, sheet, sides)
        decisive = min((*fronts, record), key=lambda one: one.verdict.verdict != combined.verdict)
        verdict = Verdict(
            page=combined.name,
            verdict=combined.verdict,
            kind=decisive.verdict.kind,
            reason="; ".join(combined.why),
        )
        faults = dict.fromkeys(fault for side in sides for fault in side.faults)
        return SheetRecord(
            record=replace(record, job_page=sheet, verdict=verdict, faults=tuple(faults)),
            rows=tuple(one.sheet for one in (*fronts, record)),
            came=came,
        )
