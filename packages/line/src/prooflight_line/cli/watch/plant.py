"""The plant of ``prooflight watch --plant PRESS.toml``: its gate and its outlets, or neither."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Self

from prooflight.press.press_file import PressFile
from prooflight_line.cli.watch import gate as watch_gate
from prooflight_line.cli.watch import outlets as watch_outlets

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
    from prooflight_line.plant.gate.gate import Gate
    from prooflight_line.plant.outlets.outlet import Outlet
    from prooflight_line.plant.stream import EventStream
    from prooflight_line.run.notices import Notice
    from prooflight_line.run.outcomes import Outcome
    from prooflight_line.run.recording import Recorder
    from prooflight_line.run.sheets.records import SeenPage


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
        lengths_mm = watch_gate.lengths_mm(job, press)
        size_mm = None if job.flaws() else job.page_size_mm(1)
        file = PressFile.read(path)
        outlets = watch_outlets.outlets_in(file, press.name)
        gate = watch_gate.gate_settings(file)
        return cls(file=file, gate=gate, outlets=outlets, lengths_mm=lengths_mm, size_mm=size_mm)

    def refuse_unfit(self, source: str, press: Press, *, deadline_s: float) -> None:
        """Check the gate; see ``watch_gate.refuse_unfit``."""
        if self.file is not None and self.gate is not None:
            watch_gate.refuse_unfit(
                self.file, self.gate, source, press, lengths_mm=self.lengths_mm, deadline_s=deadline_s
            )

    def with_sets(self, plan: SheetPlan | None, *, pages: int, sheets: int | None) -> SheetPlan | None:
        """Return the plan of the run with the sets of ``[gate] pages_a_set``, if the layout states none.

        ``pages`` is the number of pages of the job, and ``sheets`` that of the run; None: the job once.
        RequestError: both state sets, and not the same, or the set is no whole number of sheets.
        """
        own = 1 if self.gate is None else self.gate.pages_a_set
        if self.file is None or own == 1:
            return plan
        return watch_gate.with_sets(plan, own, pages=pages, sheets=sheets, where=self.file.path)

    @property
    def simulated(self) -> PlcSettings | None:
        """The gate's controller, if it is a simulated one."""
        return watch_gate.simulated(self.gate)

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

        ``notice`` and ``progress`` are those of ``gate_of``.
        """
        with ExitStack() as stack:
            stream = stack.enter_context(
                watch_outlets.events_published(
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
                watch_gate.gate_of(
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
