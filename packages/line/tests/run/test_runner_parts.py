"""Parts of the running inspection: designs ahead, what is followed, what pages add to their run, the live view."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.detectors.print_prior import PrintPrior
from prooflight.detectors.verdict import Region, Verdict
from prooflight.inspection.inspector import Inspector
from prooflight.prediction.predict import predict
from prooflight.simulation.scans import ideal_scan
from prooflight_line.reporting.run_line import alarm_lines, run_line
from prooflight_line.run.following import BOUND_SDS, MOST_SDS, PACE, Adapting, followed
from prooflight_line.run.monitor.evidence import COLUMN_MM, columns, columns_mm, run_evidence
from prooflight_line.run.monitor.run import PageEvidence
from prooflight_line.run.outcomes import outcome
from prooflight_line.run.prefetch import DesignPrefetcher, ThumbnailCache
from prooflight_line.run.settings import Settings
from prooflight_line.run.sheets.records import SeenPage
from prooflight_line.run.sheets.thumbnails import Thumbnail
from prooflight_line.run.status import Tally
from prooflight_line.run.watching import threads_a_sheet

if TYPE_CHECKING:
    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press


@dataclass
class Book:
    sheets: int = 100
    asked: list[int] = field(default_factory=list)

    def __len__(self) -> int:
        return self.sheets

    def design(self, sheet: int) -> int:
        return sheet

    def page(self, sheet: int) -> Any:
        self.asked.append(sheet)
        return np.full(1000, sheet, np.uint8)


def test_designs_are_kept_as_far_as_memory_allows() -> None:
    book = Book()
    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(book, lambda page: page, depth=2, room_bytes=3000)
    for sheet in (0, 1, 2, 3):
        prefetcher.expect(sheet)
        prefetcher.get(sheet)
    prefetcher.close()
    assert prefetcher.ready == 3
    assert book.asked[:4] == [0, 1, 2, 3]


def test_a_stored_design_is_not_prepared_again() -> None:
    book, kept = Book(sheets=2), dict[object, Any]()
    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(
        book,
        lambda page: page,
        depth=2,
        room_bytes=3000,
        stored=lambda design: "stored" if design == 0 else None,
        store=kept.__setitem__,
    )
    assert prefetcher.get(0) == "stored"
    assert prefetcher.get(1)[0] == 1
    prefetcher.close()
    assert book.asked == list(kept) == [1]


@dataclass
class Loop(Book):
    """A job that is printed over and over."""

    designs: int = 5

    def design(self, sheet: int) -> int:
        return sheet % self.designs


def test_what_is_needed_last_makes_room() -> None:
    """Of a loop of five designs of which four fit, most are there when they are needed; none, if the oldest went."""
    book = Loop(sheets=60)
    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(book, lambda page: page, depth=1, room_bytes=4000)
    for sheet in range(60):
        prefetcher.expect(sheet)
        prefetcher.get(sheet)
    prefetcher.close()
    # Belady's optimum makes a miss every (designs - 1) sheets once memory is full.
    assert len(book.asked) == 5 + (60 - 5) // 4


def test_there_is_room_for_as_many_designs_as_fit() -> None:
    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(Book(), lambda page: page, depth=1, room_bytes=3500)
    for sheet, room in enumerate([True, True, True, False]):
        assert prefetcher.has_room is room
        prefetcher.get(sheet)
    prefetcher.close()


def test_the_largest_design_is_rehearsed() -> None:
    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(
        Book(), lambda page: page[: 100 * (3 - abs(int(page[0]) - 1))], depth=3, room_bytes=10**6
    )
    with pytest.raises(ValueError, match="empty"):
        prefetcher.largest()
    for sheet in (0, 1, 2):
        prefetcher.get(sheet)
    assert prefetcher.largest()[0] == 1
    prefetcher.close()


def test_a_design_of_middle_size_is_rehearsed_too() -> None:
    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(
        Book(), lambda page: page[: 100 * (1 + int(page[0]) * 2 % 3)], depth=3, room_bytes=10**6
    )
    with pytest.raises(IndexError):
        prefetcher.middle()
    for sheet in (0, 1, 2):  # sizes 100, 300, 200
        prefetcher.get(sheet)
    assert prefetcher.middle()[0] == 2
    prefetcher.close()


def test_a_design_that_failed_is_tried_again() -> None:
    failures = [RuntimeError("once")]

    def prepare(page: Any) -> Any:
        if failures:
            raise failures.pop()
        return page

    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(Book(), prepare, depth=1, room_bytes=10**6)
    with pytest.raises(RuntimeError, match="once"):
        prefetcher.get(5)
    assert prefetcher.get(5)[0] == 5
    prefetcher.close()


def test_what_is_stale_is_used_until_it_is_made_again() -> None:
    begun, again = threading.Event(), threading.Event()

    def renewed(page: Any) -> Any:
        begun.set()
        again.wait(20)
        return page + 100

    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(Book(), lambda page: page, depth=1, room_bytes=10**6)
    assert prefetcher.get(7)[0] == 7
    prefetcher.renew(renewed)
    prefetcher.expect(7)
    assert prefetcher.get(7)[0] == 7
    assert begun.wait(20)
    again.set()
    prefetcher.close()
    assert prefetcher.get(7)[0] == 107


def test_what_is_ready_is_made_anew_from_what_it_was_where_that_is_less_work() -> None:
    book = Book()
    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(book, lambda page: page, depth=1, room_bytes=10**6)
    assert prefetcher.get(7)[0] == 7
    prefetcher.renew(lambda page: page + 100, again=lambda ready: ready + 50)
    prefetcher.expect(7)
    prefetcher.close()
    assert prefetcher.get(7)[0] == 57
    assert book.asked == [7]


def test_stale_designs_are_made_again_one_at_a_time_so_that_new_ones_need_not_wait() -> None:
    book = Book()
    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(book, lambda page: page, depth=3, room_bytes=10**6)
    for sheet in range(3):
        prefetcher.get(sheet)
    held, begun = threading.Event(), threading.Event()

    def renewed(page: Any) -> Any:
        begun.set()
        held.wait(20)
        return page

    prefetcher.renew(renewed)
    for _ in range(3):
        prefetcher.expect(0)
    assert begun.wait(20)
    assert book.asked == [0, 1, 2, 2]
    held.set()
    prefetcher.close()
    assert book.asked == [0, 1, 2, 2]


def test_designs_whose_sheets_have_passed_are_not_made_any_more() -> None:
    book, begun, held = Book(), threading.Event(), threading.Event()

    def slow(page: Any) -> Any:
        begun.set()
        held.wait(20)
        return page

    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(book, slow, depth=4, room_bytes=10**6)
    prefetcher.expect(0)
    assert begun.wait(20)
    prefetcher.expect(10)
    held.set()
    assert prefetcher.get(13)[0] == 13
    prefetcher.close()
    assert book.asked == [0, 10, 11, 12, 13]


def test_a_design_that_someone_waits_for_is_made_though_its_sheet_has_passed() -> None:
    begun, held, got = threading.Event(), threading.Event(), list[int]()

    def slow(page: Any) -> Any:
        begun.set()
        held.wait(20)
        return page

    prefetcher: DesignPrefetcher[Any] = DesignPrefetcher(Book(), slow, depth=1, room_bytes=10**6)
    prefetcher.expect(0)
    assert begun.wait(20)
    waiter = threading.Thread(target=lambda: got.append(int(prefetcher.get(1)[0])))
    waiter.start()
    while 1 not in prefetcher._cached or 1 in prefetcher._queued:
        waiter.join(0.001)
    prefetcher.expect(10)
    held.set()
    waiter.join(20)
    prefetcher.close()
    assert got == [1]


def test_thumbnails_stay_the_same_object() -> None:
    book = Book(sheets=4)
    known = ThumbnailCache(book)
    one, other = (
        Thumbnail(
            light=np.zeros((1, 1), np.uint8), width_mm=1, height_mm=1, signature=np.zeros(1, np.float32)
        )
        for _ in "ab"
    )
    assert known[2] is None
    known.add(2, one)
    known.add(2, other)
    assert known[2] is one
    assert [known[sheet] for sheet in range(1, 4)] == [None, one, None]
    with pytest.raises(IndexError):
        known[4]


def test_what_was_followed_counts_in_full(press: Press) -> None:
    adapting, name = Adapting.begin(press), f"light-{press.sensors[0].name}"
    used = np.zeros_like(adapting.level)
    used[0] = 0.01
    assert adapting.whole({name: 0.002, "gain-cyan": 0.5}, used) == {name: 0.012, "gain-cyan": 0.5}


def test_nothing_but_light_that_is_smooth_across_can_be_followed(press: Press) -> None:
    """The strongest streak 1 mm wide that six waves can hold is a tenth of what they hold of a lamp."""
    adapting = Adapting.begin(press)
    assert all(name.startswith(("light-", "lamp-")) for name in adapting.names)
    level = np.zeros(len(adapting.names))
    level[-1] = 0.01
    ratio = followed(press, adapting.names, level).sensors[0].column_gain / press.sensors[0].column_gain - 1
    columns_a_mm = round(1 / press.geometry.pixel_pitch_mm)
    nearby = np.convolve(ratio, np.ones(columns_a_mm) / columns_a_mm, mode="valid")
    assert np.abs(np.diff(nearby, n=1)).max() < 0.01 * 0.1


def test_columns_see_a_streak_and_neither_lamp_nor_local_misprint() -> None:
    pixels, count = 400, 80
    at_mm = (np.arange(pixels) + 0.5) * 0.1
    light = np.full((8, pixels), 1000.0)
    excess = light * 0.02 * np.cos(np.pi * at_mm / 40)  # a lamp
    excess[:, (at_mm > 15) & (at_mm < 15.5)] -= 10.0  # a streak of 1 %
    excess[2, (at_mm > 25) & (at_mm < 30)] -= 500.0  # content missing in one part of eight
    found = columns(excess, light, at_mm, count)
    assert found[round(15 / COLUMN_MM)] == pytest.approx(-0.01, abs=0.0015)
    others = np.delete(found, round(15 / COLUMN_MM))
    assert np.abs(others[4:-4]).max() < 0.0015


def test_columns_beside_the_page_are_unknown() -> None:
    at_mm = (np.arange(100) + 0.5) * 0.1
    light = np.where(at_mm < 5, 100.0, 0.0) * np.ones((8, 1))
    found = columns(0 * light, light, at_mm, 20)
    assert np.isfinite(found).tolist() == [True] * 10 + [False] * 10


def test_a_paper_that_is_darker_is_seen_as_light(press: Press, page: Page) -> None:
    inspector = Inspector.of(press, "chi-square")
    laid = press.geometry.lay(page)
    expected = predict(laid, sensors=press.sensors, geometry=press.geometry)
    scan = ideal_scan(expected, press, np.random.default_rng(1))
    offset = press.sensors[0].column_offset_dn
    darker = np.rint(offset + 0.97 * (scan - offset)).clip(0).astype(np.uint16)
    values = []
    for one in (scan, darker):
        inspection = inspector.inspect(inspector.prepare(laid), one, scan_name="scan")
        evidence = run_evidence(inspection, press, page_width_mm=laid.width_mm)
        values.append(evidence.values[f"light-{press.sensors[0].name}"])
        assert evidence.columns is not None
        assert evidence.columns.size == columns_mm(press).size
    assert values[0] == pytest.approx(0, abs=1e-3)
    assert values[1] == pytest.approx(-0.03, abs=3e-3)


def test_the_terminal_says_where_an_alarm_is_and_keeps_one_line() -> None:
    seen = SeenPage(scan=np.zeros((1, 1, 1), np.uint16), first_line=0, last_line_time_s=0.0, job_page=3)
    region = Region(x_mm=80, y_mm=0, width_mm=6, height_mm=297, score=9.0, kind="streak")
    alarm = Verdict(page="p0004", verdict="misprint", kind="streak", regions=(region,))
    (line,) = alarm_lines(outcome(3, seen, alarm))
    assert line.plain == (
        "sheet 3, p0004: Streak in print direction: in a streak 6 mm wide, 83 mm from the left edge"
    )
    assert list(alarm_lines(outcome(3, seen, Verdict(page="p0004", verdict="good")))) == []
    tally = Tally(overloaded=True)
    tally.count("misprints", by=2)
    status = tally.snapshot(queue_depth=2, ahead=4, journalled=3, elapsed_s=1.0)
    line = run_line(status, deadline_s=0.5, sheets="1 sheet whole")
    assert line.plain.startswith(" WAITING   inspection cannot keep up: 0 sheets not inspected;")
    for expected in ("2 misprints", "1 sheet whole", "of 500 ms"):
        assert expected in line.plain
    assert "\n" not in line.plain


def test_a_sheet_with_a_deadline_takes_all_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    assert threads_a_sheet(Settings(source_waits=False, inspectors=2)) == 8
    assert threads_a_sheet(Settings(source_waits=True, inspectors=2)) == 4
    assert threads_a_sheet(Settings(source_waits=True, inspectors=16)) == 1


def test_values_that_are_not_finite_are_left_out_of_the_run_and_said() -> None:
    seen = SeenPage(scan=np.zeros((1, 1, 1), np.uint16), first_line=0, last_line_time_s=0.0, job_page=3)
    evidence = PageEvidence(values={"gain-cyan": 0.03, "light-mono": np.nan, "lamp-1": np.inf})
    done = outcome(3, seen, Verdict(page="p0004", verdict="good"), evidence=evidence)
    assert done.evidence.values == done.record.nuisance == {"gain-cyan": 0.03}
    assert done.record.notes == (
        "not a number that a page can have: light-mono, lamp-1; left out of the run",
    )
    plain = outcome(3, seen, Verdict(page="p0004", verdict="good"))
    assert plain.record.notes == ()


@pytest.mark.parametrize("sign", [-1, 1])
def test_amounts_are_followed_slowly_either_way_up_to_their_bound(press: Press, sign: int) -> None:
    adapting = Adapting.begin(press)
    names = adapting.names
    adapting.see({names[0]: sign * 0.004, names[1]: sign * 100.0, names[2]: np.nan})
    want = np.zeros(len(names))
    want[:2] = PACE * 0.004, PACE * MOST_SDS * adapting.sd[1]  # a misprint counts as the worst good page
    assert adapting.level == pytest.approx(sign * want)
    told: list[tuple[str, float]] = []
    for _ in range(2000):
        told += adapting.see({names[0]: sign * 0.2})
    assert told == [(names[0], pytest.approx(sign * BOUND_SDS * adapting.sd[0]))]


def test_what_good_presses_do_is_the_light_of_each_sensor_and_a_smooth_lamp(press: Press) -> None:
    """A field of Gaussian correlation: its waves' variances fall as exp(-(pi length k)^2 / 4), and make the lamp's."""
    adapting, known = Adapting.begin(press), PrintPrior()
    assert adapting.sd[0] == pytest.approx(np.sqrt(known.white**2 + known.common**2))
    waves = adapting.sd[1:] ** 2
    falls = np.exp(-((np.pi * known.lamp_length * np.arange(7)) ** 2) / 4)
    assert waves / waves[0] == pytest.approx(falls[1:] / falls[1])
    level = waves[0] / falls[1]  # of the wave that is even across; each wave's mean square is a half
    assert (level + waves.sum()) / 2 == pytest.approx(known.lamp**2)


def test_what_is_followed_is_in_the_columns_gains(press: Press) -> None:
    adapting = Adapting.begin(press)
    level = 1e-3 * np.arange(1, len(adapting.names) + 1)
    level[-1] = -0.02
    changed = followed(press, adapting.names, level).sensors[0].column_gain / press.sensors[0].column_gain
    u = (np.arange(press.geometry.pixels) + 0.5) / press.geometry.pixels
    waves = sum(amount * np.cos(np.pi * k * u) for k, amount in enumerate(level[1:], start=1))
    assert changed == pytest.approx(1 + level[0] + waves, abs=1e-6)


def test_designs_are_predicted_anew_by_two_fifths_of_a_deviation_and_every_fifty_pages(press: Press) -> None:
    adapting = Adapting.begin(press)
    adapting.level[1] = -0.39 * adapting.sd[1]
    assert adapting.renewed(press, 0) is None
    adapting.level[1] = -0.41 * adapting.sd[1]
    assert adapting.renewed(press, 0) is not None
    assert adapting.used == pytest.approx(adapting.level)
    assert adapting.renewed(press, 100) is None  # it is what designs are predicted with
    adapting.level[1] = 0.0
    assert adapting.used[1] < 0
    assert adapting.renewed(press, 49) is None
    assert adapting.renewed(press, 50) is not None
