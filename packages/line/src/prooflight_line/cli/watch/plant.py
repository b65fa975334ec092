"""The plant of ``prooflight watch --plant PRESS.toml``: its gate and outlets, checked and then served."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final, Self

from prooflight.errors import JobError, RequestError
from prooflight.press.press_file import PressFile
from prooflight.reporting.wording import count
from prooflight_line.cli.watch.sources import drum_rate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from prooflight.pages.job import Job
    from prooflight.pages.layout.plan import SheetPlan
    from prooflight.press.artefact import Press
    from prooflight.press.gate import GateSettings, PlcSettings
    from prooflight.scans.lines import LineSource
    from prooflight_line.cli.watch.resuming import Resumption
    from prooflight_line.journal.records import Ending, RunFacts
    from prooflight_line.plant.events import SheetAtGate
    from prooflight_line.plant.gate.gate import Gate
    from prooflight_line.plant.gate.handshake import State
    from prooflight_line.plant.outlets.outbox import OutletHealth
    from prooflight_line.plant.outlets.outlet import Outlet
    from prooflight_line.plant.stream import EventStream
    from prooflight_line.run.notices import Notice
    from prooflight_line.run.outcomes import Outcome
    from prooflight_line.run.recording import Recorder
    from prooflight_line.run.sheets.records import SeenPage


REMEDY: Final = "see `prooflight plant check`, correct it, or remove its block from [plant]"


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """Plant components of a press file, each tried."""

    file: PressFile | None
    gate: GateSettings | None
    outlets: Sequence[Outlet]
    lengths_mm: list[float]
    """Lengths of the job's pages along the travel."""
    size_mm: tuple[float, float] | None
    """Size of the job's first page; None: it cannot be read."""

    @classmethod
    def tried(cls, path: Path | None, job: Job, press: Press) -> Self:
        """Try the components of a press file's plant; ``path`` None: there is no plant.

        RequestError, PlantError: an outlet or the controller does not answer.
        """
        if path is None:
            return cls(file=None, gate=None, outlets=(), lengths_mm=[0.0], size_mm=None)
        lengths_mm = _lengths_mm(job, press)
        size_mm = None if job.flaws() else job.page_size_mm(1)
        file = PressFile.read(path)
        outlets = _outlets_in(file, press.name)
        gate = file.gate_settings()
        if gate is not None:
            from prooflight_line.plant.gate.gate import try_controller

            try_controller(gate)
        return cls(file=file, gate=gate, outlets=outlets, lengths_mm=lengths_mm, size_mm=size_mm)

    def refuse_unfit(self, source: str, press: Press, *, deadline_s: float) -> None:
        """Raise an error if the gate cannot work with this source, the value of the option, and this job.

        RequestError: the source keeps no time. PlantError: sheets reach the gate before their verdicts can, or are
        nearer to each other than the gate can distinguish.
        """
        if self.file is None or self.gate is None:
            return
        gate = self.gate
        from prooflight_line.plant.gate.gate import Travel, exchange_s, refuse_close, refuse_near

        geometry, shortest_mm, longest_mm = press.geometry, min(self.lengths_mm), max(self.lengths_mm)
        kind, _, rest = source.partition(":")
        if kind == "camera":
            camera = self.file.camera()
            rate_hz = self.file.camera_settings().line_rate_hz or camera.sensors[0].line_rate_hz
            speed_mm_s = camera.line_travel_mm * rate_hz
        elif kind == "drum" and rest:
            speed_mm_s = drum_rate(source, rest) * geometry.lines(longest_mm) * geometry.line_pitch_mm
        else:
            what = "has a gate, and this source has no speed of its own"
            raise RequestError(self.file.path, what, remedy="give --source drum:PAGES_PER_S or camera:ID")
        travel = Travel(
            distance_mm=gate.distance_mm,
            speed_mm_s=speed_mm_s,
            sheet_mm=longest_mm + geometry.lead_out_mm,
            deadline_s=deadline_s,
            exchange_s=exchange_s(gate),
        )
        refuse_near(gate, travel, where=self.file.path)
        refuse_close(gate, shortest_mm, where=self.file.path)

    def with_sets(self, plan: SheetPlan | None, *, pages: int, sheets: int | None) -> SheetPlan | None:
        """Return the plan of the run with the sets of ``[gate] pages_a_set``, if the layout states none.

        ``pages`` is the number of pages of the job, and ``sheets`` that of the run; None: the job once.
        RequestError: both state sets, and not the same, or the set is no whole number of sheets.
        """
        own = 1 if self.gate is None else self.gate.pages_a_set
        if self.file is None or own == 1:
            return plan
        from prooflight.pages.layout.layout import Layout
        from prooflight.pages.layout.plan import SheetPlan

        if plan is None:
            return SheetPlan(layout=Layout(pages_a_set=own), sides=pages, sheets=sheets or pages)
        stated = plan.layout.pages_a_set
        if stated is not None and stated != own:
            what = f"[gate] pages_a_set = {own}, but --layout states pages-a-set={stated}"
            raise RequestError(
                self.file.path, what, remedy="remove it from [gate]: the job determines its sets"
            )
        if own % plan.layout.pages_a_sheet:
            what = f"[gate] pages_a_set = {own}, but a sheet takes {plan.layout.pages_a_sheet} pages"
            raise RequestError(self.file.path, what, remedy="give --layout pages-a-set of whole sheets")
        return replace(plan, layout=replace(plan.layout, pages_a_set=own))

    @property
    def simulated(self) -> PlcSettings | None:
        """The gate's controller, if it is a simulated one."""
        if self.gate is None:
            return None
        from prooflight_line.plant.simulator.feed import is_simulated

        return self.gate.plc if is_simulated(self.gate.plc) else None

    @contextmanager
    def served(
        self,
        facts: RunFacts,
        press: Press,
        *,
        job_pages: int,
        plan: SheetPlan | None,
        recorder: Recorder | None,
        resumption: Resumption | None = None,
        notice: Callable[[Notice], None],
        progress: Callable[[str], None],
    ) -> Iterator[ServedPlant]:
        """Serve the plant until the run is over and the last sheets have reached the gate.

        ``notice`` and ``progress`` are those of ``_gate_of``.
        """
        with ExitStack() as stack:
            stream = stack.enter_context(
                _events_published(
                    self.outlets,
                    facts,
                    run_id=None if recorder is None else recorder.run_id,
                    room=1 if self.file is None else self.file.plant.room,
                    size_mm=self.size_mm,
                    plan=plan,
                    notice=notice,
                )
            )
            after_gate = stack.enter_context(ExitStack())
            gate = stack.enter_context(
                _gate_of(
                    self.gate,
                    press,
                    job_pages=job_pages,
                    plan=plan,
                    recorder=recorder,
                    resumption=resumption,
                    notice=notice,
                    state=(lambda _state, _why: None) if stream is None else partial(stream.state, "gate"),
                    report=(lambda _passed: None) if stream is None else stream.at_gate,
                    progress=progress,
                )
            )
            yield ServedPlant(gate=gate, stream=stream, after_gate=after_gate)


@dataclass(frozen=True, slots=True, kw_only=True)
class ServedPlant:
    """Gate and stream of events of one run; either may be missing, and then receives nothing."""

    gate: Gate | None
    stream: EventStream | None
    after_gate: ExitStack
    """Callbacks that run when the last sheets have passed the gate."""

    def followed(self, source: LineSource) -> LineSource:
        """Return the source, whose lines the gate tracks."""
        return source if self.gate is None else self.gate.followed(source)

    def arrived(self, number: int, page: SeenPage) -> None:
        """Note that a sheet has passed the camera."""
        if self.gate is not None:
            self.gate.arrived(number, page)

    @property
    def gate_observer(self) -> Callable[[Outcome], Outcome] | None:
        """Function that decides every sheet and returns it with the decision; called first, because the gate is due."""
        return None if self.gate is None else self.gate.observe

    @property
    def stream_observer(self) -> Callable[[Outcome], None] | None:
        """Function that receives every sheet, after the sheet is in the journal."""
        return None if self.stream is None else self.stream.observe

    @property
    def noticed(self) -> Callable[[Notice], None] | None:
        """Function that receives notices that belong to no sheet."""
        return None if self.stream is None else self.stream.noticed

    def too_late(self) -> int:
        """Return how many sheets have passed the gate before their result could be written."""
        return 0 if self.gate is None else self.gate.protocol.too_late

    def phase(self, phase: str, detail: str) -> None:
        """Publish the run's phase."""
        if self.stream is not None:
            self.stream.state("press", phase, detail)

    def ended(self, ending: Ending, lacks: str) -> None:
        """Publish the end of the run, after the gate has reported its last sheets."""
        if self.stream is not None:
            self.after_gate.callback(self.stream.ended, ending, lacks)


def _outlets_in(plant: PressFile, press: str) -> list[Outlet]:
    """Return the outlets that a press file names, each tried; ``press`` is the name in the events.

    RequestError: one does not answer; others as of ``outlets_of``.
    """
    from prooflight_line.plant.outlets.configured import outlets_of
    from prooflight_line.plant.outlets.outlet import check

    outlets = outlets_of(plant, press)
    for outlet in outlets:
        tried = check(outlet)
        if not tried.ok:
            raise RequestError(tried.name, f"does not answer ({tried.answer})", remedy=REMEDY)
    return outlets


@contextmanager
def _events_published(
    outlets: Sequence[Outlet],
    facts: RunFacts,
    *,
    run_id: int | None,
    room: int,
    size_mm: tuple[float, float] | None,
    plan: SheetPlan | None,
    notice: Callable[[Notice], None],
) -> Iterator[EventStream | None]:
    """Give the run's stream of events while its outlets are served; None if there are no outlets.

    ``size_mm`` is the size of a sheet, and ``plan`` as for ``EventStream``. ``notice`` is called when an
    outlet connects or disconnects.
    """
    if not outlets:
        yield None
        return
    from prooflight_line.plant.outlets.outlet import Outlets
    from prooflight_line.plant.stream import EventStream
    from prooflight_line.run.notices import Notice

    def changed(health: OutletHealth) -> None:
        if health.connected:
            notice(Notice(kind="outlet-ready", text=f"{health.name}: connected"))
        else:
            notice(Notice(kind="outlet-away", text=f"{health.name}: {health.detail}; events wait"))

    with Outlets(outlets, room=room, changed=changed) as served:
        stream = EventStream([served.put], press=facts.press, run=run_id, size_mm=size_mm, plan=plan)
        stream.started(facts)
        yield stream


def _lengths_mm(job: Job, press: Press) -> list[float]:
    """Return the lengths of the job's pages along the travel, as they enter the press, without unreadable pages."""
    geometry, lengths = press.geometry, list[float]()
    for number in range(1, len(job) + 1):
        with suppress(JobError):
            width_mm, height_mm = job.page_size_mm(number)
            turned = width_mm > geometry.pixels * geometry.pixel_pitch_mm
            lengths.append(width_mm if turned else height_mm)
    return lengths or [0.0]


@contextmanager
def _gate_of(
    settings: GateSettings | None,
    press: Press,
    *,
    job_pages: int,
    plan: SheetPlan | None,
    recorder: Recorder | None,
    resumption: Resumption | None,
    notice: Callable[[Notice], None],
    state: Callable[[str, str], None],
    report: Callable[[SheetAtGate], None],
    progress: Callable[[str], None],
) -> Iterator[Gate | None]:
    """Serve the gate until the last sheets have reached it; None if the press has none.

    ``progress`` is called when they are waited for. ``notice`` is called when the gate becomes ready and when
    it does not stay so; ``state``, with every step of the handshake, and why; ``report``, with every sheet
    that has passed the gate.
    """
    if settings is None:
        yield None
        return
    from prooflight_line.plant.gate.gate import Gate
    from prooflight_line.plant.gate.handshake import State
    from prooflight_line.run.notices import Notice

    ready = False

    def tell(step: State, why: str) -> None:
        nonlocal ready
        state(str(step), why)
        if step is State.READY:
            ready = True
            notice(Notice(kind="gate-ready", text=f"the gate at {settings.plc.where} is ready"))
        elif ready:
            ready = False
            doubt = {"reject": "are rejected", "accept": "pass", "stop": "stop the press"}[settings.policy]
            text = f"the gate at {settings.plc.where} is not ready ({why}): sheets without a result {doubt}"
            notice(Notice(kind="gate-away", text=text))

    journal = None if recorder is None else recorder.journal.path
    run_id = 0 if recorder is None else recorder.run_id
    with Gate(
        settings,
        press.geometry,
        job_pages=job_pages,
        plan=plan,
        journal=journal,
        run_id=run_id,
        past=None if resumption is None else resumption.gate,
        open_sides=() if resumption is None else resumption.open_sides,
        tell=tell,
        report=report,
    ) as gate:
        yield gate
        if left := gate.protocol.waiting:
            progress(f"{count(left, 'sheet')} on the way to the gate")
