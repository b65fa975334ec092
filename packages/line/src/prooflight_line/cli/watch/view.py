"""Display of a run of ``prooflight watch`` for people and programs, and the signals that end it."""

from __future__ import annotations

import signal
import threading
import time
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Final

from rich.live import Live

from prooflight.cli import event_log, faults, show
from prooflight.cli.imposition import sheet_facts, sheets_line
from prooflight.reporting.wording import count, not_inspected
from prooflight_line.cli.watch.run_log import RunLog
from prooflight_line.journal.exporting import page_facts
from prooflight_line.journal.start import Start
from prooflight_line.reporting.run_line import alarm_lines, preparation, run_line
from prooflight_line.run.notices import Notice
from prooflight_line.run.pace import REMEDY
from prooflight_line.run.status import Phase

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from rich.text import Text

    from prooflight.inspection.sheets import Assembling, SetVerdict, SheetVerdict
    from prooflight_line.cameras.camera import Health
    from prooflight_line.journal.run_control import Request
    from prooflight_line.journal.start import StartFile
    from prooflight_line.run.outcomes import Outcome
    from prooflight_line.run.recording import Recorder
    from prooflight_line.run.runner import Running
    from prooflight_line.run.status import Status

REFRESH_S: Final = 0.25
TELL_S: Final = 5.0
"""Time between two lines of JSON that report the cameras' health, or that the run is still being prepared."""


@dataclass(slots=True, kw_only=True)
class Watching:
    """Display of a run for a person or a program."""

    deadline_s: float | None
    json: bool
    at_once: bool = False
    """Whether lines are read before all designs are ready."""
    waits: bool = False
    """Whether the source can be made to wait, so that sheets wait for their designs."""
    sheets: Assembling | None = None
    """Combination of sides into sheets and sets; None: the job has neither."""
    first_passed: str = ""
    """The first sheet that was not inspected, and why."""
    phase: Callable[[str, str], None] = lambda _phase, _detail: None
    """Function that receives the run's phase and error at each refresh."""
    too_late: Callable[[], int] = lambda: 0
    """Function that returns how many sheets have passed the gate before their result could be written."""
    cameras: Callable[[], Mapping[str, Health]] = dict
    """Function that returns the health of the source's cameras, by name."""
    stop_request: Callable[[], Request | None] = lambda: None
    """Function that returns the request of a person elsewhere to end the run."""
    stopped_by: str = ""
    """Who ended the run from elsewhere; empty: nobody."""
    start_file: StartFile | None = None
    """File in which consoles read how far the start has got; None: there is no journal."""
    health_printed_s: float = 0.0
    """Time at which a program last received the cameras' health."""
    last_phase: Phase | None = None
    phase_s: float = 0.0
    """Time at which a program last received the phase, which is ``last_phase``."""
    log: RunLog = field(default_factory=RunLog)
    live: threading.Event = field(default_factory=threading.Event)
    """Whether the status line is on, above which the notices are printed."""

    def observe(self, outcome: Outcome, *, recorder: Recorder | None) -> None:
        """Record one sheet in the journal first, then show it."""
        verdict = outcome.record.verdict
        if outcome.came and verdict.verdict == "not-inspected" and not self.first_passed:
            self.first_passed = f"{verdict.page}: {verdict.reason}"
        if recorder is not None:
            recorder.record(outcome.record)
        self.log.sheet(outcome)
        parts = [] if self.sheets is None else self.sheets.add(outcome.record)
        if not self.json:
            for line in alarm_lines(outcome):
                show.people.print(line)
            return
        latency_ms = None if outcome.latency_s is None else round(1e3 * outcome.latency_s, 1)
        announcements = [asdict(one) for one in outcome.announcements]
        show.print_json(
            page_facts(outcome.record) | {"latency_ms": latency_ms, "announcements": announcements}
        )
        self._tell_sheets(parts)

    def end_sheets(self) -> None:
        """Show the sheets that waited for more sides, because no more sheets come."""
        if self.sheets is not None:
            parts = self.sheets.end()
            if self.json:
                self._tell_sheets(parts)

    def _tell_sheets(self, parts: Iterable[SheetVerdict | SetVerdict]) -> None:
        for one in parts:
            show.print_json(sheet_facts(one))

    def noticed(self, notice: Notice) -> None:
        """Show at once a notice that belongs to no sheet."""
        if self.json:
            show.print_json({"notice": notice.kind, "text": notice.text})
        if event_log.is_on():
            self.log.notice(notice)
        elif self.live.is_set():
            show.people.print(notice.text, style="yellow")
        else:
            faults.report(notice.text)

    def line(self, status: Status) -> Text:
        """Return the state of the run in one line."""
        return run_line(
            status,
            deadline_s=self.deadline_s,
            cameras=self.cameras(),
            sheets="" if self.sheets is None else sheets_line(self.sheets.counts),
        )

    def _fitted(self, status: Status) -> Text:
        """Return the status line, cut to the width of the terminal."""
        line = self.line(status)
        line.truncate(show.people.width, overflow="ellipsis")
        return line

    def tell_phase(self, status: Status) -> None:
        """Print that the run is ready, and for a program, now and then before, how far the preparation is."""
        now_s, prepares = time.monotonic(), status.phase is Phase.PREPARING
        begins = status.phase is Phase.INSPECTING and self.last_phase is not Phase.INSPECTING
        if begins or ((self.json or event_log.is_on()) and prepares and now_s - self.phase_s >= TELL_S):
            self.last_phase, self.phase_s = status.phase, now_s
            ready = f"{count(status.ahead, 'design')} ready"
            detail = preparation(status) if prepares else ready
            self.log.phase(str(status.phase), detail)
            if self.json:
                show.print_json({"phase": str(status.phase), "detail": detail})
            else:
                rest = "the press may print"
                if self.at_once:
                    rest = f"sheets of others {'wait for theirs' if self.waits else 'are not inspected yet'}"
                show.people.print(f"Ready after {status.elapsed_s:.0f} s, {ready}: {rest}")

    def note_start(self, status: Status) -> None:
        """Write how far the start has got, for consoles; once it is over, nothing."""
        if self.start_file is None:
            return
        begun = status.phase not in (Phase.WAITING, Phase.PREPARING)
        if begun and (status.pages_seen or not (self.at_once and self.waits)):
            self.start_file.clear()
            self.start_file = None
            return
        left = status.to_prepare - status.ahead
        if left > 0 or not status.to_rehearse:
            left_s = status.elapsed_s * left / status.ahead if status.ahead else None
            start = Start(stage="prepare", done=status.ahead, total=status.to_prepare, left_s=left_s)
        else:
            start = Start(stage="rehearse", done=status.rehearsed, total=status.to_rehearse)
        self.start_file.write_at_times(start)

    def tell_cameras(self) -> None:
        """Print the cameras' health for a program, as a line of JSON."""
        healths = self.cameras()
        if healths:
            show.print_json({"cameras": {name: asdict(health) for name, health in healths.items()}})

    def until_ended(self, running: Running) -> bool:
        """Start the run and wait for its end; return whether a person ended it."""
        with _signals(running) as stops, ExitStack() as stack:
            view = None
            if not self.json and show.people.is_terminal and not show.people.quiet:
                view = stack.enter_context(
                    Live(
                        self._fitted(running.status()),
                        console=show.people,
                        transient=True,
                        auto_refresh=False,
                    )
                )
                self.live.set()
            running.start()
            while not running.join(REFRESH_S):
                if not stops:
                    self._stop_if_requested(running)
                status = running.status()
                self.phase(str(status.phase), status.detail)
                self.tell_phase(status)
                self.note_start(status)
                now_s = time.monotonic()
                if self.json and now_s - self.health_printed_s >= TELL_S:
                    self.health_printed_s = now_s
                    self.tell_cameras()
                if view is not None:
                    view.update(self._fitted(status), refresh=True)
            status = running.status()
            self.phase(str(status.phase), status.detail)
            self.note_start(status)
        return bool(stops or self.stopped_by)

    def _stop_if_requested(self, running: Running) -> None:
        """End the run as the first Ctrl-C does, if a person asked for it elsewhere."""
        if not self.stopped_by and (request := self.stop_request()) is not None:
            self.stopped_by = request.by
            running.note(Notice(kind="stopped", text=self.stopped_text))
            running.stop()

    @property
    def stopped_text(self) -> str:
        """Who ended the run from elsewhere, in words; empty: nobody."""
        return f"{self.stopped_by} stopped the run in the console" if self.stopped_by else ""

    def lacks(self, status: Status, *, sheets: int, unrecorded: int = 0) -> str:
        """Return why a run of ``sheets`` sheets is incomplete, in one line; empty if it is complete."""
        parts = []
        if status.overloads:
            late = count(status.out_of_time, "sheet")
            parts.append(f"inspection could not keep up with the press, and {late} passed for that; {REMEDY}")
        if status.absent:
            parts.append(f"{status.absent:,} of {count(sheets, 'sheet')} did not come")
        if unseen := status.not_inspected:
            parts.append(not_inspected(count(unseen, "sheet"), unseen, self.first_passed))
        if status.unvouched:
            text = f"{count(status.unvouched, 'sheet')} printed well, but not released manually"
            parts.append(f"{text}: lines were lost, or the order was wrong")
        if too_late := self.too_late():
            parts.append(f"{count(too_late, 'sheet')} passed the gate before the controller had the result")
        if status.untold:
            parts.append(f"{count(status.untold, 'verdict')} could not be recorded or shown")
        if unrecorded:
            parts.append(f"{count(unrecorded, 'verdict')} not recorded in the journal")
        return "; ".join(parts)


@contextmanager
def _signals(running: Running) -> Iterator[list[int]]:
    """End the run cleanly at the first Ctrl-C or SIGTERM, and drop waiting sheets at the second."""
    stops: list[int] = []

    def stop(number: int, _frame: object) -> None:
        stops.append(number)
        running.stop(drop=len(stops) > 1)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stops
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
