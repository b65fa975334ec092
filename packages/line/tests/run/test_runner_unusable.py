"""Pages that cannot be used, sources that fall silent or end too early: the run says so, and goes on."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from packages.line.tests.run.runs import NOTHING, PATIENCE_S, Book, SheetInspector

from prooflight.detectors.cost import RunningCosts
from prooflight.errors import JobError, ScanError
from prooflight.scans.lines import LineBlock
from prooflight_line.run.monitor.run import RunMonitor
from prooflight_line.run.notices import Notice
from prooflight_line.run.outcomes import Outcome, RunWatch
from prooflight_line.run.prefetch import DesignPrefetcher
from prooflight_line.run.runner import Running
from prooflight_line.run.settings import Settings
from prooflight_line.run.sheets.records import Fault, SeenPage
from prooflight_line.run.status import Phase

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TORN = JobError("p0003.tif", "the TIFF is truncated", remedy="copy it again")


@dataclass
class Source:
    """A block a sheet; ``before`` is called before each, and once more before the end."""

    sheets: int
    before: Callable[[int], None] = lambda _place: None
    closed: threading.Event = field(default_factory=threading.Event)
    sensors: int = 1
    pixels: int = 1

    def blocks(self) -> Iterator[LineBlock]:
        for place in range(self.sheets):
            self.before(place)
            if self.closed.is_set():
                return
            yield LineBlock(first_line=place, lines=NOTHING, time_s=0.0)
        self.before(self.sheets)

    def close(self) -> None:
        self.closed.set()


@dataclass
class Pager:
    """Every block a sheet, which shows the page of its number if that is known."""

    known: Any
    odd: dict[int, SeenPage] = field(default_factory=dict)
    next_page: int = 0
    missing: int = 0

    @property
    def to_come(self) -> int:
        return len(self.known) - self.next_page

    @property
    def may_come(self) -> tuple[int, ...]:
        return (self.next_page,)

    def warm_up(self) -> None:
        pass

    def push(self, block: LineBlock) -> list[SeenPage]:
        number = block.first_line
        if number in self.odd:
            return [self.odd[number]]
        self.next_page = number + 1
        known = self.known[number] is not None
        return [seen(number if known else None, taken_for=None if known else number)]

    def flush(self) -> list[SeenPage]:
        return []


def seen(page: int | None, **facts: Any) -> SeenPage:
    return SeenPage(scan=NOTHING, first_line=0, last_line_time_s=0.0, job_page=page, **facts)


def like_nothing() -> SeenPage:
    return seen(None, faults=(Fault(kind="unknown", first_line=0, detail="no page is like the sheet"),))


@dataclass
class Run:
    running: Running
    told: list[Outcome] = field(default_factory=list)
    noticed: list[Notice] = field(default_factory=list)

    def words(self) -> list[str]:
        return [one.record.verdict.verdict for one in self.told]

    def reasons(self) -> list[str]:
        return [one.record.verdict.reason for one in self.told if one.record.verdict.reason]


def run_of(
    book: Book,
    *,
    source: Source | None = None,
    inspector: SheetInspector | None = None,
    odd: dict[int, SeenPage] | None = None,
    clock: Callable[[], float] = lambda: 0.0,
    start: bool = True,
    **given: Any,
) -> Run:
    monitor = RunMonitor.begin(sensors=("mono",), columns_mm=np.array([0.5]), costs=RunningCosts())
    settings = {name: given.pop(name) for name in ("ahead", "stall_s") if name in given}
    told, noticed = list[Outcome](), list[Notice]()
    running = Running(
        press=None,  # type: ignore[arg-type]
        source=source or Source(book.sheets),
        pager=lambda known: Pager(known, odd or {}),  # type: ignore[arg-type,return-value]
        page_store=book,
        inspector=inspector or SheetInspector(),  # type: ignore[arg-type]
        watch=RunWatch(monitor=monitor, adapting=None, sheets=book.sheets),
        settings=Settings(source_waits=True, **settings),
        **{"tell": told.append, "notice": noticed.append, "clock": clock} | given,
    )
    run = Run(running, told, noticed)
    if start:
        running.start()
        assert running.join(PATIENCE_S)
    return run


def test_a_torn_page_is_named_before_the_first_line_and_in_each_reason() -> None:
    noticed, said = list[Notice](), threading.Event()

    def notice(one: Notice) -> None:
        noticed.append(one)
        said.set()

    def before(place: int) -> None:
        assert said.wait(PATIENCE_S)

    run = run_of(Book(6, {2: TORN}), source=Source(6, before=before), notice=notice)
    (named,) = noticed
    assert named.kind == "page-unusable"
    assert str(TORN) in named.text
    assert "p0003" in named.text
    assert run.words() == ["good", "good", "not-inspected", "good", "good", "good"]
    assert run.told[2].record.verdict.page == "p0003"
    assert run.reasons() == [str(TORN)]
    assert run.told[0].record.notes == (named.text,)
    status = run.running.status()
    assert (status.not_inspected, status.absent, status.untold, status.phase) == (1, 0, 0, Phase.STOPPED)


def test_a_page_known_to_be_torn_is_named_long_before_its_turn() -> None:
    run = run_of(Book(40, {39: TORN}), ahead=2, flaws={39: TORN})
    assert [notice.kind for notice in run.noticed] == ["page-unusable"]
    assert run.told[0].record.notes == (run.noticed[0].text,)
    assert run.words() == ["good"] * 39 + ["not-inspected"]


def test_the_first_page_may_be_torn() -> None:
    run = run_of(Book(3, {0: TORN}))
    assert run.words() == ["not-inspected", "good", "good"]


def test_where_no_page_can_be_used_the_press_is_not_watched() -> None:
    run = run_of(Book(3, dict.fromkeys(range(3), TORN)))
    status = run.running.status()
    assert (status.phase, status.detail, run.told) == (Phase.FAULT, str(TORN), [])
    assert len(run.noticed) == 3


def test_a_fault_of_our_own_in_a_design_costs_its_sheets_alone(caplog: pytest.LogCaptureFixture) -> None:
    class Odd(SheetInspector):
        def prepare(self, page: Any) -> Any:
            if page == 1:
                raise IndexError("7 is out of bounds")
            return super().prepare(page)

    run = run_of(Book(3), inspector=Odd())
    assert run.words() == ["good", "not-inspected", "good"]
    assert "a fault of Prooflight itself: IndexError: 7 is out of bounds" in run.reasons()[0]
    assert "Traceback" in caplog.text


def test_a_sheet_like_none_is_no_misprint_where_it_may_be_the_torn_page() -> None:
    """Sheet 4 comes two behind the page that is torn, sheet 18 far from it."""
    run = run_of(Book(20, {2: TORN}), odd={4: like_nothing(), 18: like_nothing()})
    assert (run.words()[4], run.words()[18]) == ("not-inspected", "misprint")
    assert run.told[4].record.verdict.reason.startswith(
        "the sheet matches no prepared page, but may show p0003"
    )
    assert str(TORN) in run.told[4].record.verdict.reason


def test_a_blank_sheet_is_a_misprint_wherever_it_comes() -> None:
    blank = seen(None, faults=(Fault(kind="blank", first_line=0, detail="nothing is printed"),))
    assert run_of(Book(6, {2: TORN}), odd={4: blank}).words()[4] == "misprint"


def test_a_sheet_within_which_the_lines_ended_is_not_inspected() -> None:
    run = run_of(Book(3), odd={2: seen(None, taken_for=2, cut_short=True)})
    assert run.words() == ["good", "good", "not-inspected"]
    assert run.reasons() == ["the lines ended within the sheet"]
    assert run.told[2].record.verdict.page == "p0003"


@pytest.mark.parametrize("came", [0, 3])
def test_lines_that_end_too_early_leave_pages_to_come(came: int) -> None:
    status = run_of(Book(9), source=Source(came)).running.status()
    assert (status.good, status.to_come, status.absent) == (came, 9 - came, 9 - came)
    assert status.phase is Phase.STOPPED


def test_a_source_that_breaks_off_leaves_pages_to_come_and_nobody_unjudged() -> None:
    def before(place: int) -> None:
        if place == 3:
            raise ScanError("pipe", "cannot be read any more", remedy="start it again")

    run = run_of(Book(9), source=Source(9, before=before))
    status = run.running.status()
    assert (status.phase, status.good, status.absent) == (Phase.FAULT, 3, 6)


def test_a_silent_source_is_announced_and_can_be_stopped() -> None:
    """The source says nothing from the third sheet on, until it is closed."""
    now_s, announced = [0.0], threading.Event()

    def before(place: int) -> None:
        if place == 2:
            now_s[0] = 30.0
            assert announced.wait(PATIENCE_S)
            assert run.running._source.closed.wait(PATIENCE_S)  # type: ignore[attr-defined]

    def notice(one: Notice) -> None:
        run.noticed.append(one)
        announced.set()

    source = Source(5, before=before)
    run = run_of(Book(5), source=source, clock=lambda: now_s[0], start=False, stall_s=4.0, notice=notice)
    run.running.start()
    assert announced.wait(PATIENCE_S)
    run.running.stop()
    assert run.running.join(PATIENCE_S)
    assert [(one.kind, one.text) for one in run.noticed] == [("silent", "no line has arrived for 4 s")]
    assert run.words() == ["good", "good"]
    assert run.running.status().absent == 3


def test_a_verdict_that_is_not_told_is_counted() -> None:
    told = list[Outcome]()

    def tell(outcome: Outcome) -> None:
        if outcome.record.sheet == 1:
            raise OSError(28, "No space left on device")
        told.append(outcome)

    run = run_of(Book(3), tell=tell)
    assert [one.record.sheet for one in told] == [0, 2]
    status = run.running.status()
    assert status.untold == 1
    assert "No space left" in status.detail


def test_a_fault_behind_the_verdict_holds_no_other_sheet_back() -> None:
    class Odd(SheetInspector):
        def inspect(
            self, ready: Any, scan: Any, *, name: str, seed: int, unseen: Any = (), **_more: Any
        ) -> Any:
            return None if ready.page == 1 else super().inspect(ready, scan, name=name, seed=seed)

    run = run_of(Book(3), inspector=Odd())
    assert run.words() == ["good", "not-inspected", "good"]


def test_what_is_dropped_at_the_second_stop_includes_what_comes_last() -> None:
    class Last(Pager):
        def flush(self) -> list[SeenPage]:
            return [seen(self.next_page)]

    def before(place: int) -> None:
        if place == 1:
            run.running.stop(drop=True)

    run = run_of(Book(3), source=Source(3, before=before), start=False)
    run.running._make_pager = lambda known: Last(known)  # type: ignore[assignment,return-value]
    run.running.start()
    assert run.running.join(PATIENCE_S)
    assert run.told[-1].record.verdict.reason == "the run was stopped"


def test_designs_that_lag_are_looked_for_as_far_ahead_as_sheets_have_come(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Sheets 2, 3 and 5 pass before their designs are ready: what comes next is behind all that have passed."""
    expected = list[int]()
    monkeypatch.setattr(DesignPrefetcher, "expect", lambda _self, sheet: expected.append(sheet))
    late = {number: seen(None, taken_for=2) for number in (2, 3)} | {5: seen(None, taken_for=5)}
    run = run_of(Book(6), odd=late)
    assert run.words() == ["good", "good", "not-inspected", "not-inspected", "good", "not-inspected"]
    assert run.reasons() == ["the page was not prepared in time"] * 3
    at_the_start = 0
    assert expected == [at_the_start, 0, 1, 2 + 1, 2 + 2, 4, 5 + 1]


def test_a_page_that_cannot_be_used_is_no_design_that_lags(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = list[int]()
    expect = DesignPrefetcher.expect
    monkeypatch.setattr(
        DesignPrefetcher, "expect", lambda self, sheet: (expected.append(sheet), expect(self, sheet))[1]
    )
    run = run_of(Book(4, {2: TORN}), odd={2: seen(None, taken_for=2)})
    assert run.reasons() == [str(TORN)]
    assert expected == [0, 0, 1, 2, 3]
