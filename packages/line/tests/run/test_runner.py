"""The loop: every sheet has one outcome, in order; deadlines, queues and faults by a clock that only tests move."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.run.runs import NOTHING, PATIENCE_S, Book, SheetInspector

from prooflight.detectors.cost import RunningCosts
from prooflight.detectors.verdict import Verdict
from prooflight.errors import JobError, ScanError
from prooflight.inspection.guarantee import GuaranteeMonitor
from prooflight.scans.lines import LineBlock, Unseen
from prooflight_line.run.monitor.run import PageEvidence, RunMonitor
from prooflight_line.run.outcomes import InOrder, Outcome, RunWatch, skipped
from prooflight_line.run.prefetch import DesignPrefetcher
from prooflight_line.run.queues import Waiting
from prooflight_line.run.runner import Running
from prooflight_line.run.settings import Settings
from prooflight_line.run.sheet_inspector import SheetResult
from prooflight_line.run.sheets.records import Fault, MissingPage, SeenPage
from prooflight_line.run.status import Phase, Times
from prooflight_line.run.warm_up import REHEARSALS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from prooflight.detectors.verdict import VerdictName
    from prooflight_line.run.notices import Notice


def seen(page: int | None, time_s: float = 0.0, *kinds: Any) -> SeenPage:
    faults = tuple(Fault(kind=kind, first_line=0, detail=f"a {kind} sheet") for kind in kinds)
    return SeenPage(scan=NOTHING, first_line=0, last_line_time_s=time_s, job_page=page, faults=faults)


@dataclass
class Clock:
    now_s: float = 0.0

    def __call__(self) -> float:
        return self.now_s


@dataclass
class Source:
    """Blocks whose number of the first line is the place in a script of sheets."""

    script: list[SeenPage | MissingPage]
    before: Callable[[int], None] = lambda _place: None
    closed: threading.Event = field(default_factory=threading.Event)
    sensors: int = 1
    pixels: int = 1
    pitch_s: float = 1.0

    def blocks(self) -> Iterator[LineBlock]:
        for place in range(len(self.script)):
            self.before(place)
            if self.closed.is_set():
                return
            yield LineBlock(first_line=place, lines=NOTHING, time_s=place * self.pitch_s)

    def close(self) -> None:
        self.closed.set()


@dataclass
class Pager:
    script: list[SeenPage | MissingPage]
    next_page: int = 0
    to_come: int = 0
    missing: int = 0

    @property
    def may_come(self) -> tuple[int, ...]:
        return (self.next_page,)

    def warm_up(self) -> None:
        pass

    def push(self, block: LineBlock) -> list[SeenPage | MissingPage]:
        return [self.script[block.first_line]]

    def flush(self) -> list[SeenPage | MissingPage]:
        return []


@pytest.fixture(autouse=True)
def _on_two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let two sheets be inspected at once, as two inspectors on two processors do."""
    monkeypatch.setattr("os.cpu_count", lambda: 2)


def watched(
    script: list[SeenPage | MissingPage],
    *,
    inspector: SheetInspector | None = None,
    source: Source | None = None,
    clock: Clock | None = None,
    page_store: Book | None = None,
    guarantee: GuaranteeMonitor | None = None,
    notice: Callable[[Notice], None] = lambda _notice: None,
    misprint: Callable[[Outcome], None] = lambda _outcome: None,
    **settings: Any,
) -> tuple[Running, list[Outcome]]:
    told: list[Outcome] = []
    costs = RunningCosts()
    monitor = RunMonitor.begin(sensors=("mono",), columns_mm=np.array([0.5]), costs=costs)
    running = Running(
        press=None,  # type: ignore[arg-type]
        source=source or Source(script),
        pager=lambda _known: Pager(script),  # type: ignore[arg-type,return-value]
        page_store=page_store or Book(len(script)),
        inspector=inspector or SheetInspector(),  # type: ignore[arg-type]
        watch=RunWatch(
            monitor=monitor, adapting=None, sheets=len(script), guarantee=guarantee or GuaranteeMonitor()
        ),
        settings=Settings(**{"source_waits": True, "inspectors": 2} | settings),
        tell=told.append,
        misprint=misprint,
        notice=notice,
        clock=clock or Clock(),
    )
    return running, told


def run(*arguments: Any, **settings: Any) -> tuple[Running, list[Outcome]]:
    running, told = watched(*arguments, **settings)
    running.start()
    assert running.join(PATIENCE_S)
    return running, told


def test_every_sheet_has_one_outcome_in_order() -> None:
    running, told = run([seen(page) for page in range(100)])
    assert [one.record.sheet for one in told] == list(range(100))
    assert [one.record.verdict.page for one in told] == [f"design {page}" for page in range(100)]
    status = running.status()
    assert (status.phase, status.pages_seen, status.good) == (Phase.STOPPED, 100, 100)
    assert (status.late, status.not_inspected, status.queue_depth, status.being_inspected) == (0, 0, 0, 0)


def test_outcomes_are_put_in_order_whichever_is_decided_first() -> None:
    """The first sheet's verdict waits until the second's is there."""
    second = threading.Event()

    def first(name: str) -> None:
        if name == "sheet 0":
            assert second.wait(PATIENCE_S)
        if name == "sheet 1":
            second.set()

    _, told = run([seen(0), seen(1), seen(2)], inspector=SheetInspector(first=first))
    assert [one.record.sheet for one in told] == [0, 1, 2]


def test_repeated_designs_are_made_ready_once() -> None:
    inspector = SheetInspector()
    run([seen(page) for page in range(60)], inspector=inspector, page_store=Book(60, designs=7))
    assert sorted(inspector.prepared) == list(range(7))


def test_designs_are_made_ready_ahead_of_their_sheets() -> None:
    """When the first line is read, the next ten are."""
    inspector, ready = SheetInspector(), list[list[int]]()
    script = [seen(page) for page in range(30)]
    source = Source(
        script, before=lambda place: ready.append(sorted(inspector.prepared)) if place == 0 else None
    )
    run(script, inspector=inspector, source=source, ahead=10)
    assert ready == [list(range(10))]


@pytest.mark.parametrize(
    ("room", "at_once", "fewest", "most"),
    [(100, False, 25, 25), (100, True, 1, 12), (12, False, 12, 14)],
    ids=["all", "at once", "as far as memory allows"],
)
def test_a_press_that_does_not_wait_is_read_when_all_designs_are_ready(
    room: int, at_once: bool, fewest: int, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that no sheet meets a design that is not ready, unless the user says so or memory holds no more.

    Two more may be begun while the last is waited for, and ten are begun when the first sheet is expected.
    """
    monkeypatch.setattr(DesignPrefetcher, "has_room", property(lambda self: self.ready < room))
    begun: list[int] = []
    script, inspector = [seen(page) for page in range(50)], SheetInspector()
    source = Source(
        script, before=lambda place: begun.append(len(set(inspector.prepared))) if place == 0 else None
    )
    settings = {"source_waits": False, "start_at_once": at_once, "ahead": 10, "deadline_s": 1e6}
    run(script, inspector=inspector, source=source, page_store=Book(50, designs=25), **settings)
    assert fewest <= begun[0] <= most


def test_inspection_is_rehearsed_after_all_designs_are_loaded() -> None:
    inspector = SheetInspector()
    run([seen(page) for page in range(5)], inspector=inspector, source_waits=False, inspectors=1, room=10)
    assert inspector.before_sheets == ["load"] * 5 + ["rehearse"] * REHEARSALS


@pytest.mark.parametrize("at_once", [False, True])
def test_a_run_whose_first_sheets_wait_is_not_warmed_up_if_it_starts_at_once(at_once: bool) -> None:
    inspector = SheetInspector()
    running, told = run([seen(page) for page in range(3)], inspector=inspector, start_at_once=at_once)
    assert len(told) == 3
    assert (running.status().to_rehearse == 0) == at_once
    assert running.status().rehearsed == running.status().to_rehearse


def test_a_verdict_behind_its_deadline_is_late_and_still_told() -> None:
    clock = Clock()

    def first(name: str) -> None:
        clock.now_s += 0.6 if name == "sheet 1" else 0.1

    script = [seen(page) for page in range(3)]
    running, told = run(
        script, inspector=SheetInspector(first=first), clock=clock, source_waits=False, inspectors=1, room=10
    )
    late = [one.record.sheet for one in told if one.record.late]
    assert late[0] == 1
    assert told[1].record.verdict.verdict == "good"
    assert told[1].latency_s is not None
    assert told[1].latency_s > 0.5
    assert running.status().late == len(late)


def test_a_misprint_is_decided_in_time_before_it_is_explained() -> None:
    """Sheet 1 is known to be a misprint while sheet 0 is inspected; its explanation ends after its deadline."""
    clock, known, told_first = Clock(), threading.Event(), threading.Event()
    early: list[tuple[int, str, int]] = []

    class Slow(SheetInspector):
        def inspect(self, ready: Any, scan: Any, *, decided: Any, name: str, **more: Any) -> SheetResult:
            misprint = Verdict(page="p", verdict="misprint")
            if name == "sheet 0":
                assert known.wait(PATIENCE_S)
            if name == "sheet 1":
                decided(misprint)
                known.set()
                assert told_first.wait(PATIENCE_S)
                clock.now_s += 10
                return SheetResult(verdict=replace(misprint, kind="streak"))
            return super().inspect(ready, scan, name=name, **more)

    def misprint(outcome: Outcome) -> None:
        early.append((outcome.record.sheet, outcome.record.verdict.verdict, len(told)))
        told_first.set()

    running, told = watched(
        [seen(0), seen(1)], inspector=Slow(), clock=clock, source_waits=False, misprint=misprint
    )
    running.start()
    assert running.join(PATIENCE_S)
    assert early == [(1, "misprint", 1)]
    assert [(one.record.verdict.kind, one.record.late) for one in told] == [(None, False), ("streak", False)]
    assert told[1].latency_s is not None
    assert told[1].latency_s < 1


@pytest.mark.parametrize("next_is_misprint", [False, True])
def test_others_are_inspected_while_a_misprint_is_explained(next_is_misprint: bool) -> None:
    """The one inspecting thread goes on to sheet 1, without which the explanation of sheet 0 would not end."""
    went_on = threading.Event()
    early: list[int] = []

    class Slow(SheetInspector):
        def inspect(self, ready: Any, scan: Any, *, decided: Any, name: str, **more: Any) -> SheetResult:
            misprint = Verdict(page="p", verdict="misprint")
            if name == "sheet 1" and not next_is_misprint:
                went_on.set()
                return super().inspect(ready, scan, name=name, **more)
            decided(misprint)
            assert went_on.wait(PATIENCE_S)
            return SheetResult(verdict=replace(misprint, kind="streak"))

    def misprint(outcome: Outcome) -> None:
        early.append(outcome.record.sheet)
        if len(early) == 2:
            went_on.set()

    running, told = watched(
        [seen(0), seen(1)], inspector=Slow(), inspectors=1, explainers=1, misprint=misprint
    )
    running.start()
    assert running.join(PATIENCE_S)
    assert [one.record.verdict.kind for one in told] == ["streak", "streak" if next_is_misprint else None]
    assert early == ([0, 1] if next_is_misprint else [0])


def test_an_explanation_that_fails_leaves_the_sheet_uninspected() -> None:
    class Failing(SheetInspector):
        def inspect(self, ready: Any, scan: Any, *, decided: Any, **_more: Any) -> SheetResult:
            decided(Verdict(page="p", verdict="misprint"))
            raise ValueError("no kind")

    early: list[Outcome] = []
    running, told = watched([seen(0)], inspector=Failing(), misprint=early.append)
    running.start()
    assert running.join(PATIENCE_S)
    assert [one.record.verdict.verdict for one in (*early, *told)] == ["misprint", "not-inspected"]


def test_a_source_that_waits_has_no_deadline_and_loses_no_sheet() -> None:
    clock = Clock()

    def first(_name: str) -> None:
        clock.now_s += 10

    running, told = run(
        [seen(page) for page in range(20)], inspector=SheetInspector(first=first), clock=clock, room=2
    )
    assert [one.record.verdict.verdict for one in told] == ["good"] * 20
    assert running.status().late == 0


def test_a_slow_machine_passes_sheets_on_and_says_so() -> None:
    """The judge is held until all sheets have come: two wait, the rest were dropped, oldest first."""
    all_came = threading.Event()
    taken = threading.Event()

    def before(place: int) -> None:
        if place == 1:
            assert taken.wait(PATIENCE_S)

    def first(_name: str) -> None:
        taken.set()
        assert all_came.wait(PATIENCE_S)

    script = [seen(page) for page in range(10)]
    source = Source(script, before=before)
    running, told = watched(
        script, inspector=SheetInspector(first=first), source=source, source_waits=False, inspectors=1, room=2
    )
    running.start()
    while running.status().pages_seen < 10:
        assert not running.join(0.01)
    all_came.set()
    assert running.join(PATIENCE_S)
    verdicts = [one.record.verdict.verdict for one in told]
    assert verdicts == ["good"] + 7 * ["not-inspected"] + 2 * ["good"]
    assert running.status().not_inspected == 7
    assert all(one.record.verdict.reason for one in told if one.record.verdict.verdict == "not-inspected")


def test_faults_of_the_paper_path_are_counted_and_spoil_no_run() -> None:
    script: list[SeenPage | MissingPage] = [
        seen(0),
        seen(None, 0.0, "blank"),
        seen(None, 0.0, "unknown"),
        seen(0, 0.0, "repeated"),
        MissingPage(job_page=1, faults=(Fault(kind="missing", first_line=7, detail="never came"),)),
        seen(2, 0.0, "lost-lines"),
    ]
    running, told = run(script)
    assert [one.record.faults for one in told] == [
        (), ("blank",), ("unknown",), ("repeated",), ("missing",), ("lost-lines",)
    ]  # fmt: skip
    assert [one.record.verdict.verdict for one in told] == [
        "good", "misprint", "misprint", "good", "not-inspected", "good"
    ]  # fmt: skip
    assert told[1].record.verdict.kind == "missing-content"
    assert told[2].record.verdict.kind == "wrong-page"
    status = running.status()
    assert (status.pages_seen, status.missing, status.not_inspected) == (5, 1, 0)
    assert status.faults == {"blank": 1, "unknown": 1, "repeated": 1, "lost-lines": 1}


def test_a_spoilt_scan_adds_nothing_to_its_run() -> None:
    evidence = PageEvidence(values={"gain-cyan": 9.0})

    class Loud(SheetInspector):
        def inspect(
            self, ready: Any, scan: Any, *, name: str, seed: int, unseen: Any = (), **_more: Any
        ) -> SheetResult:
            return SheetResult(verdict=Verdict(page="p", verdict="good"), evidence=evidence)

    _, told = run([seen(0), seen(1, 0.0, "stretch"), seen(2, 0.0, "out-of-order")], inspector=Loud())
    assert [dict(one.evidence.values) for one in told] == [{"gain-cyan": 9.0}, {}, {"gain-cyan": 9.0}]


@dataclass
class Third:
    """A run's test that has had enough of the third page; remembers what it was given."""

    seen: list[float] = field(default_factory=list)
    strangest: str = "lines along the travel"
    remedy: str = "look at it"

    def add(self, summary: NDArray[np.float64]) -> None:
        self.seen.append(float(summary[0]))

    @property
    def suspended(self) -> bool:
        return len(self.seen) >= 3


class Summing(SheetInspector):
    """Sheet n adds n to its run, whatever is said of it."""

    def inspect(
        self, ready: Any, scan: Any, *, name: str, seed: int, unseen: Any = (), **_more: Any
    ) -> SheetResult:
        said = super().inspect(ready, scan, name=name, seed=seed)
        word: VerdictName = "misprint" if name == "sheet 3" else "good"
        evidence = PageEvidence(summary=np.array([float(name.removeprefix("sheet "))]))
        return replace(said, verdict=replace(said.verdict, verdict=word), evidence=evidence)


def test_a_run_suspends_its_promise_once_and_every_verdict_from_then_on_says_so() -> None:
    """Sheet 0 is decided last of the first two; 1 is spoilt, 2 did not come, 4 breaks the judge, 3 is a misprint."""
    third, second = Third(), threading.Event()

    def first(name: str) -> None:
        if name == "sheet 4":
            raise RuntimeError(name)
        if name == "sheet 0":
            assert second.wait(PATIENCE_S)
        else:
            second.set()

    gone = MissingPage(job_page=2, faults=(Fault(kind="missing", first_line=0, detail="gone"),))
    script = [seen(0), seen(1, 0.0, "stretch"), gone, *(seen(page) for page in range(3, 9))]
    notices: list[Notice] = []
    running, told = watched(
        script, inspector=Summing(first=first), guarantee=GuaranteeMonitor(test=third), notice=notices.append
    )
    running.start()
    assert running.join(PATIENCE_S)
    assert third.seen == [0.0, 3.0, 5.0]
    assert [one.record.verdict.promise_suspended for one in told] == [False] * 5 + [True] * 4
    (notice,) = notices
    assert notice.kind == "promise-suspended"
    assert "lines along the travel" in notice.text
    assert [one.record.notes for one in told] == [()] * 5 + [(notice.text,)] + [()] * 3
    status = running.status()
    assert (status.promise_suspended, status.good, status.untold) == (4, 6, 0)


def test_a_run_whose_detector_has_no_test_promises_on() -> None:
    running, told = run([seen(page) for page in range(5)], inspector=Summing())
    assert {one.record.verdict.promise_suspended for one in told} == {False}
    assert running.status().promise_suspended == 0


@pytest.mark.parametrize("error", [ScanError("sheet", "is short", remedy="scan"), RuntimeError("odd")])
def test_a_sheet_that_breaks_the_judge_is_passed_on(error: Exception) -> None:
    def first(name: str) -> None:
        if name == "sheet 1":
            raise error

    running, told = run([seen(page) for page in range(4)], inspector=SheetInspector(first=first))
    assert [one.record.verdict.verdict for one in told] == ["good", "not-inspected", "good", "good"]
    assert running.status().phase is Phase.STOPPED


def test_a_page_that_cannot_be_read_costs_its_sheets_only() -> None:
    torn = {2: JobError("job.pdf", "page 3 is damaged", remedy="send it again")}
    _, told = run([seen(page) for page in range(4)], page_store=Book(4, torn))
    assert [one.record.verdict.verdict for one in told] == ["good", "good", "not-inspected", "good"]
    assert "damaged" in told[2].record.verdict.reason


def test_a_source_that_breaks_off_is_a_fault_and_keeps_what_came() -> None:
    def before(place: int) -> None:
        if place == 3:
            raise ScanError("pipe", "ends inside a line", remedy="send whole lines")

    script = [seen(page) for page in range(5)]
    running, told = run(script, source=Source(script, before=before))
    assert [one.record.sheet for one in told] == [0, 1, 2]
    status = running.status()
    assert status.phase is Phase.FAULT
    assert "whole lines" in status.detail


def test_stopping_inspects_what_waits_and_reads_no_more() -> None:
    holds: list[Running] = []

    def before(place: int) -> None:
        if place == 5:
            holds[0].stop()

    script = [seen(page) for page in range(50)]
    running, told = watched(script, source=Source(script, before=before))
    holds.append(running)
    running.start()
    assert running.join(PATIENCE_S)
    assert [one.record.verdict.verdict for one in told] == ["good"] * 5
    assert running.status().phase is Phase.STOPPED


def test_who_watches_cannot_stop_the_inspection() -> None:
    running, told = watched([seen(page) for page in range(3)])

    def tell(outcome: Outcome) -> None:
        told.append(outcome)
        raise OSError("the terminal is gone")

    running._tell = tell
    running.start()
    assert running.join(PATIENCE_S)
    assert len(told) == 3


def test_waiting_drops_the_oldest_where_the_source_cannot_wait() -> None:
    waiting: Waiting[int] = Waiting(2, source_waits=False)
    assert waiting.put(0, 1.0) == []
    assert waiting.put(1, 2.0) == []
    assert waiting.put(2, 3.0) == [0]
    assert len(waiting) == 2


def test_waiting_passes_over_what_would_be_late_but_for_the_last() -> None:
    waiting: Waiting[int] = Waiting(9, source_waits=False)
    for item in range(4):
        waiting.put(item, float(item))
    assert waiting.take(lambda: 1.5) == (2, [0, 1])
    assert waiting.take(lambda: 9.0) == (3, [])
    waiting.close()
    assert waiting.take(lambda: 0.0) == (None, [])


def test_waiting_passes_over_the_last_as_well_where_reading_lags_behind() -> None:
    waiting: Waiting[int] = Waiting(9, source_waits=False)
    waiting.put(0, 1.0)
    assert waiting.take(lambda: 9.0, is_late=lambda: True) == (None, [0])


def test_a_reader_that_lags_passes_sheets_on_instead_of_judging_each_too_late() -> None:
    """Every block is read 3 s after its lines: each sheet is already lost, and none keeps the next from being read."""
    clock = Clock()

    def before(place: int) -> None:
        clock.now_s = place + 3.0

    script = [seen(page, float(page)) for page in range(6)]
    running, told = run(
        script, source=Source(script, before=before), clock=clock, source_waits=False, source_clock=True
    )
    assert {one.record.verdict.verdict for one in told} == {"not-inspected"}
    assert (running.status().not_inspected, running.status().late) == (6, 0)


def test_a_slow_start_does_not_end_all_trying() -> None:
    """The first sheet takes 9 s of a deadline of 1 s; those after it are in time, one at a time."""
    clock, done = Clock(), [threading.Event() for _ in range(6)]

    def before(place: int) -> None:
        if place:
            assert done[place - 1].wait(PATIENCE_S)
            clock.now_s = 20.0 * place

    def first(name: str) -> None:
        clock.now_s += 9.0 if name == "sheet 0" else 0.0

    script = [seen(page, 20.0 * page) for page in range(6)]
    source = Source(script, before=before, pitch_s=20.0)
    told: list[Outcome] = []

    def tell(outcome: Outcome) -> None:
        told.append(outcome)
        done[outcome.record.sheet].set()

    running, _ = watched(
        script,
        inspector=SheetInspector(first=first),
        source=source,
        clock=clock,
        source_waits=False,
        source_clock=True,
        deadline_s=1.0,
    )
    running._tell = tell
    running.start()
    assert running.join(PATIENCE_S)
    assert [one.record.late for one in told] == [True, False, False, False, False, False]
    assert {one.record.verdict.verdict for one in told} == {"good"}


def test_in_order_holds_back_what_comes_early() -> None:
    order = InOrder()
    outcomes = [skipped(number, seen(number), "why") for number in range(3)]
    assert order.put(outcomes[2]) == []
    assert order.put(outcomes[0]) == [outcomes[0]]
    assert order.put(outcomes[1]) == [outcomes[1], outcomes[2]]


def test_times_are_known_to_two_percent() -> None:
    times = Times()
    for milliseconds in range(1, 1001):
        times.add(milliseconds / 1000)
    assert times.quantile_s(0.5) == pytest.approx(0.5, rel=0.03)
    assert times.median_s == times.quantile_s(0.5)
    assert times.quantile_s(0.999) == pytest.approx(0.999, rel=0.03)
    assert times.stage().greatest_ms == 1000


def lost(page: int | None, *unseen: tuple[int, int], torn: bool = False, lines: int = 100) -> SeenPage:
    """A sheet of which the camera lost lines."""
    fault = Fault(
        kind="lost-lines", first_line=7, detail="lines 7 to 9 were lost: parts of block 3 did not arrive"
    )
    scan = np.zeros((1, lines, 1), np.uint16)
    return replace(
        seen(page), scan=scan, faults=(fault,), unseen=tuple(Unseen(*run) for run in unseen), torn=torn
    )


def test_a_sheet_with_lost_lines_is_judged_where_it_was_seen_and_says_so() -> None:
    asked: list[Any] = []

    class Asked(SheetInspector):
        def inspect(
            self, ready: Any, scan: Any, *, name: str, seed: int, unseen: Any = (), **_more: Any
        ) -> SheetResult:
            asked.append(unseen)
            return super().inspect(ready, scan, name=name, seed=seed)

    _, told = run([seen(0), lost(1, (7, 10))], inspector=Asked())
    assert [one.record.verdict.verdict for one in told] == ["good", "good"]
    assert sorted(asked) == [(), (Unseen(7, 10),)]
    assert told[1].record.faults == ("lost-lines",)
    assert told[1].record.notes == ("lines lost: lines 7 to 9 were lost: parts of block 3 did not arrive",)


def test_a_sheet_of_which_too_much_was_lost_is_not_inspected_and_no_misprint() -> None:
    _, told = run([lost(0, (10, 40)), lost(None, (7, 10)), lost(None, (7, 8)), lost(None, (0, 1), torn=True)])
    said = [(one.record.verdict.verdict, one.record.verdict.reason) for one in told]
    assert [word for word, _ in said] == ["not-inspected", "not-inspected", "misprint", "not-inspected"]
    assert said[0][1].endswith("30% of the sheet was not seen")
    assert said[3][1].startswith("lines lost: lines 7 to 9 ")
