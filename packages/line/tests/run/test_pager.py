from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prooflight.errors import ScanError
from prooflight.inspection.lost_lines import unseen_share
from prooflight.pages.raster import turned
from prooflight.prediction.predict import predict
from prooflight.rng import stream
from prooflight.scans.lines import LineBlock, LineFault, Unseen
from prooflight.simulation.drum import LINE_FAULTS, Drum, DrumFault, turns
from prooflight.simulation.misprints.kinds import KINDS
from prooflight.simulation.scans import MisprintRequest, scan_page
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import Amounts
from prooflight_line.run.pager import SLIP_MM, Pager, TriggerCount
from prooflight_line.run.sheets.fitting import is_blank
from prooflight_line.run.sheets.following import Following
from prooflight_line.run.sheets.records import MissingPage, SeenPage
from prooflight_line.run.sheets.store import LineStore
from prooflight_line.run.sheets.thumbnails import thumbnail_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from prooflight.pages.raster import Page
    from prooflight.press.artefact import Press
    from prooflight_line.run.pager import PageStart
    from prooflight_line.run.sheets.following import Match
    from prooflight_line.run.sheets.records import Fault
    from prooflight_line.run.sheets.thumbnails import Thumbnail

WHOLE, FORMS = 5, 3
"""Pages of their own, and forms of one template."""
PAGES = WHOLE + FORMS


def repeated(designs: Sequence[Thumbnail | None], sheets: int) -> tuple[Thumbnail | None, ...]:
    """A job's thumbnails for so many sheets, from its first again after its last."""
    return tuple(designs[sheet % len(designs)] for sheet in range(sheets))


@dataclass(frozen=True)
class Job:
    press: Press
    session: Session
    pages: tuple[Page, ...]
    thumbnails: tuple[Thumbnail, ...]
    scans: tuple[np.ndarray, ...]
    blank: np.ndarray
    foreign: np.ndarray

    def scan(self, page: Page, seed: int, misprint: str | None = None) -> np.ndarray:
        """A print in the press world."""
        request = None if misprint is None else MisprintRequest(kind=misprint, severity=0.7)
        return scan_page(
            page,
            press=self.press,
            request=request,
            others=(1, 2),
            fetch=lambda number: self.pages[number - 1],
            rng=stream(5, "print", seed),
            session=self.session,
        ).dn

    def play(
        self,
        faults: dict[int, DrumFault],
        *,
        sheets: int = 2 * PAGES,
        block_lines: int = 64,
        start: PageStart | None = None,
        **drum: Any,
    ) -> list[SeenPage | MissingPage]:
        source = Drum(
            self.scans,
            press=self.press,
            passing=turns(sheets, faults),
            blank=self.blank,
            foreign=self.foreign,
            block_lines=block_lines,
            **drum,
        )
        return self.paged(source.blocks(), sheets=sheets, start=start)

    def paged(
        self, blocks: Iterable[LineBlock], *, sheets: int = PAGES, start: PageStart | None = None
    ) -> list[SeenPage | MissingPage]:
        pager = Pager(self.press, expected=repeated(self.thumbnails, sheets), start=start)
        found = [page for block in blocks for page in pager.push(block)]
        return found + pager.flush()


def worded(page: Page, seed: int) -> Page:
    """A form with three words of bars of its own."""
    cmyk = page.cmyk.copy()
    rng = np.random.default_rng(seed)
    stem = round(0.4 * page.dpi / 25.4)
    for top, left in ((100, 60), (330, 300), (600, 150)):
        letters = np.repeat(rng.random(16) < 0.5, stem)
        cmyk[top : top + 6 * stem, left : left + letters.size] = 0
        cmyk[top : top + 6 * stem, left : left + letters.size, 3] = np.where(letters, 255, 0)
    return replace(page, cmyk=cmyk)


@pytest.fixture(scope="module")
def job(press: Press, make_page: Callable[..., Page]) -> Job:
    whole = [make_page(100 + n, number=n + 1) for n in range(WHOLE)]
    form = make_page(150)
    pages = [*whole, *(worded(form, n) for n in range(FORMS))]
    thumbnails = [
        thumbnail_of(page, predict(page, sensors=press.sensors, geometry=press.geometry, threads=1), press)
        for page in pages
    ]
    session = Session.draw(Amounts.stated(), press, np.random.default_rng(3))
    empty = Job(press, session, tuple(pages), tuple(thumbnails), (), np.empty(0), np.empty(0))
    blank = replace(pages[0], cmyk=np.zeros_like(pages[0].cmyk))
    return replace(
        empty,
        scans=tuple(empty.scan(page, n) for n, page in enumerate(pages)),
        blank=empty.scan(blank, 90),
        foreign=empty.scan(turned(turned(make_page(199))), 91),
    )


def pages_of(found: list[SeenPage | MissingPage]) -> list[int | None]:
    return [page.job_page for page in found if isinstance(page, SeenPage)]


def missing_of(found: list[SeenPage | MissingPage]) -> list[int]:
    return [page.job_page for page in found if isinstance(page, MissingPage)]


def faults_of(found: list[SeenPage | MissingPage]) -> list[Fault]:
    return [fault for page in found if isinstance(page, SeenPage) for fault in page.faults]


def test_good_prints_are_paged_in_order_and_nothing_is_said_of_them(job: Job) -> None:
    found = job.play({}, sheets=3 * PAGES)
    assert pages_of(found) == list(range(3 * PAGES))
    assert len(found) == 3 * PAGES
    assert faults_of(found) == []
    geometry = job.press.geometry
    for page in found:
        assert isinstance(page, SeenPage)
        assert page.scan.shape == (1, geometry.lines(job.pages[0].height_mm), geometry.pixels)


def test_a_rehearsal_leaves_no_trace(job: Job) -> None:
    pager = Pager(job.press, expected=repeated(job.thumbnails, PAGES))
    pager.warm_up()
    drum = Drum(job.scans, press=job.press, passing=turns(PAGES, {}))
    found = [page for block in drum.blocks() for page in pager.push(block)] + pager.flush()
    for one, other in zip(found, job.play({}, sheets=PAGES), strict=True):
        assert isinstance(one, SeenPage)
        assert isinstance(other, SeenPage)
        assert (one.job_page, one.first_line, one.faults) == (other.job_page, other.first_line, other.faults)
        assert (one.scan == other.scan).all()


def test_the_rehearsed_sheet_is_identified(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that the comparison of two pages is rehearsed as well."""
    matches: list[Match] = []
    identify = Following.identify

    def recorded(following: Following, *arguments: Any, **named: Any) -> Match:
        matches.append(identify(following, *arguments, **named))
        return matches[-1]

    monkeypatch.setattr(Following, "identify", recorded)
    Pager(job.press, expected=repeated(job.thumbnails, PAGES)).warm_up()
    assert [match.job_page for match in matches] == [0]


def test_a_scan_is_the_lines_from_lead_in_above_the_sheet(job: Job) -> None:
    """The sheet in each scan is the very lines that the drum played, wherever the print put it."""
    whole = np.concatenate(job.scans, axis=1)
    for page in job.play({}, sheets=PAGES)[1:-1]:
        assert isinstance(page, SeenPage)
        lines = page.scan.shape[1]
        lead_in = round(job.press.geometry.lead_in_mm / job.press.geometry.line_pitch_mm)
        inner = slice(lead_in, lines - lead_in)
        np.testing.assert_array_equal(
            page.scan[:, inner], whole[:, page.first_line : page.first_line + lines][:, inner]
        )
        light = page.scan[0, :, 180:220].mean(axis=1)
        backing = float(job.press.sensors[0].backing_dn)
        assert np.abs(light[: lead_in - 4] - backing).max() < 0.1 * backing


FAULTS = {
    1: DrumFault(kind="lost-lines", amount=30, at=0.4),
    4: DrumFault(kind="missing", amount=1),
    9: DrumFault(kind="stretch", amount=0.9),
    12: DrumFault(kind="repeated"),
}


@settings(max_examples=6)
@given(sizes=st.lists(st.integers(1, 700), min_size=1, max_size=6))
def test_pages_do_not_depend_on_how_lines_come_in_blocks(job: Job, sizes: list[int]) -> None:
    drum = Drum(job.scans, press=job.press, passing=turns(2 * PAGES, FAULTS), block_lines=10**6)
    cut, turn = [], 0
    for whole in drum.blocks():
        start = 0
        while start < whole.lines.shape[1]:
            size = sizes[turn % len(sizes)]
            part = whole.lines[:, start : start + size]
            cut.append(LineBlock(first_line=whole.first_line + start, lines=part, time_s=0.0))
            start, turn = start + size, turn + 1
    found, usual = job.paged(cut, sheets=2 * PAGES), job.play(FAULTS)
    assert len(found) == len(usual)
    for a, b in zip(found, usual, strict=True):
        assert (type(a), a.job_page, a.faults) == (type(b), b.job_page, b.faults)
        if isinstance(a, SeenPage) and isinstance(b, SeenPage):
            assert a.first_line == b.first_line
            np.testing.assert_array_equal(a.scan, b.scan)


ORDERS: list[tuple[DrumFault, list[int | None], list[int]]] = [
    (DrumFault(kind="blank"), [0, 1, 2, None, 4, 5, 6, 7], [3]),
    (DrumFault(kind="unknown"), [0, 1, 2, None, 4, 5, 6, 7], [3]),
    (DrumFault(kind="repeated"), [0, 1, 2, 3, 3, 4, 5, 6, 7], []),
    (DrumFault(kind="missing", amount=0), [0, 1, 2, 4, 5, 6, 7], [3]),
    (DrumFault(kind="missing", amount=1), [0, 1, 2, 4, 5, 6, 7], [3]),
    (DrumFault(kind="out-of-order"), [0, 1, 2, 4, 3, 5, 6, 7], []),
]


@pytest.mark.parametrize(("fault", "pages", "missing"), ORDERS)
def test_faults_of_order_are_named_and_the_run_stays_in_step(
    job: Job, fault: DrumFault, pages: list[int | None], missing: list[int]
) -> None:
    found = job.play({3: fault}, sheets=PAGES)
    assert pages_of(found) == pages
    assert missing_of(found) == missing
    kinds = {said.kind for said in faults_of(found)}
    allowed = {fault.kind, "missing"} if fault.kind == "out-of-order" else {fault.kind}
    assert fault.kind in kinds
    assert kinds <= allowed


@pytest.mark.parametrize("sheet", range(WHOLE, PAGES - 1))
@pytest.mark.parametrize("kind", ["repeated", "missing", "out-of-order"])
def test_forms_of_one_template_are_told_apart(job: Job, kind: Any, sheet: int) -> None:
    found = job.play({sheet: DrumFault(kind=kind)}, sheets=PAGES)
    order = list(range(PAGES))
    if kind == "repeated":
        order.insert(sheet, sheet)
    elif kind == "missing":
        order.remove(sheet)
    else:
        order[sheet : sheet + 2] = [sheet + 1, sheet]
    assert pages_of(found) == order


@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("kind", LINE_FAULTS)
def test_faults_of_lines_are_named_on_their_sheet_alone(job: Job, kind: Any, counted: bool) -> None:
    amount = {"slip": 6.0, "stretch": 1.0, "splice": 14.0}.get(kind, 25.0)
    found = job.play({4: DrumFault(kind=kind, amount=amount, at=0.55, counted=counted)}, sheets=PAGES)
    assert pages_of(found) == list(range(PAGES))
    said = [
        (page.job_page, fault.kind) for page in found if isinstance(page, SeenPage) for fault in page.faults
    ]
    assert said == [(4, kind)]


def test_lines_that_the_camera_lost_are_made_up_for(job: Job) -> None:
    """A hole of known length: what lies behind it is where it was."""
    whole = job.play({}, sheets=PAGES)[4]
    holed = job.play({4: DrumFault(kind="lost-lines", amount=30, at=0.4)}, sheets=PAGES)[4]
    assert isinstance(whole, SeenPage)
    assert isinstance(holed, SeenPage)
    assert holed.first_line == whole.first_line
    differs = np.flatnonzero((holed.scan != whole.scan).any(axis=(0, 2)))
    assert 0 < differs.size <= 30
    assert np.ptp(differs) < 30


def test_lines_that_came_twice_are_left_out(job: Job) -> None:
    usual = job.play({}, sheets=PAGES)
    found = job.play({4: DrumFault(kind="extra-lines", amount=30, at=0.4)}, sheets=PAGES)
    for a, b in zip(found, usual, strict=True):
        assert isinstance(a, SeenPage)
        assert isinstance(b, SeenPage)
        np.testing.assert_array_equal(a.scan, b.scan)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("wrong-page", "missing-plane")])
def test_a_misprinted_page_is_still_that_page(job: Job, kind: str) -> None:
    """The kinds left out may leave no page of the job, or none at all."""
    scans = list(job.scans)
    scans[2] = job.scan(job.pages[2], 40, misprint=kind)
    found = replace(job, scans=tuple(scans)).play({}, sheets=PAGES)
    assert pages_of(found) == list(range(PAGES))


def test_a_camera_that_counts_anew_costs_the_sheet_it_did_it_in(job: Job) -> None:
    blocks = list(Drum(job.scans, press=job.press, passing=turns(PAGES, {})).blocks())
    middle = next(n for n, block in enumerate(blocks) if block.first_line > 3.4 * job.scans[0].shape[1])
    anew = blocks[middle].first_line
    shifted = [
        block if n < middle else replace(block, first_line=block.first_line - anew)
        for n, block in enumerate(blocks)
    ]
    found = job.paged(shifted)
    assert [page for page in pages_of(found) if page is not None and page not in (3,)] == [
        0,
        1,
        2,
        4,
        5,
        6,
        7,
    ]
    assert any("counts 0 after" in fault.detail for fault in faults_of(found))
    last = found[-1]
    assert isinstance(last, SeenPage)
    assert last.faults == ()
    assert last.first_line < len(blocks) * 64 - anew


def test_sheets_without_a_gap_between_them_are_parted(job: Job) -> None:
    lead = round(job.press.geometry.lead_in_mm / job.press.geometry.line_pitch_mm) + 9
    scans = list(job.scans)
    scans[2], scans[3] = scans[2][:, :-lead], scans[3][:, lead:]
    found = replace(job, scans=tuple(scans)).play({}, sheets=PAGES)
    assert pages_of(found)[:2] + pages_of(found)[4:] == [0, 1, 4, 5, 6, 7]
    assert pages_of(found)[2] == 2


def test_a_torn_sheet_is_no_page_and_the_next_is_in_step(job: Job) -> None:
    scans = list(job.scans)
    gap = np.array(job.scans[0][:, -12:])
    scans[2] = np.concatenate([scans[2][:, :160], gap, gap], axis=1)
    found = replace(job, scans=tuple(scans)).play({}, sheets=PAGES)
    assert pages_of(found)[3:] == [3, 4, 5, 6, 7]
    torn = found[2]
    assert isinstance(torn, SeenPage)
    assert {fault.kind for fault in torn.faults} & {"unknown", "lost-lines"}


def test_pages_of_different_sizes_share_a_job(job: Job, make_page: Callable[..., Page]) -> None:
    short = make_page(170, width_mm=30.0, height_mm=30.0)
    thumbnail = thumbnail_of(
        short, predict(short, sensors=job.press.sensors, geometry=job.press.geometry, threads=1), job.press
    )
    mixed = replace(
        job,
        thumbnails=(*job.thumbnails[:2], thumbnail, *job.thumbnails[3:]),
        scans=(*job.scans[:2], job.scan(short, 41), *job.scans[3:]),
    )
    found = mixed.play({3: DrumFault(kind="missing")}, sheets=PAGES)
    assert pages_of(found) == [0, 1, 2, 4, 5, 6, 7]
    assert isinstance(found[2], SeenPage)
    assert found[2].scan.shape[1] == job.press.geometry.lines(short.height_mm)
    assert {fault.kind for fault in faults_of(found)} == {"missing"}


def banded(job: Job, page: Page, rows: slice) -> tuple[Page, Thumbnail]:
    """A page with a band of the one tint that the camera cannot tell from the backing, from edge to edge."""
    sensor = job.press.sensors[0]
    grey = int(np.argmin(np.abs(sensor.mean_dn[0, 0, 0] - sensor.backing_dn))) * 8
    exact = np.interp(
        sensor.backing_dn, sensor.mean_dn[0, 0, 0][::-1], np.arange(32, -1, -1, dtype=np.float64) * 8
    )
    assert abs(exact - grey) < 8
    cmyk = page.cmyk.copy()
    cmyk[rows] = 0
    cmyk[rows, :, 3] = round(float(exact))
    dark = replace(page, cmyk=cmyk)
    expected = predict(dark, sensors=job.press.sensors, geometry=job.press.geometry, threads=1)
    return dark, thumbnail_of(dark, expected, job.press)


def test_a_sheet_whose_top_looks_like_backing_is_cut_at_its_edge(job: Job) -> None:
    dark, thumbnail = banded(job, job.pages[2], slice(0, 110))
    scans = (*job.scans[:2], job.scan(dark, 42), *job.scans[3:])
    usual = job.play({}, sheets=PAGES)[3]
    thumbnails = (*job.thumbnails[:2], thumbnail, *job.thumbnails[3:])
    found = replace(job, scans=scans, thumbnails=thumbnails).play({}, sheets=PAGES)
    assert pages_of(found) == list(range(PAGES))
    first, second = found[2], found[3]
    assert isinstance(first, SeenPage)
    assert isinstance(second, SeenPage)
    assert isinstance(usual, SeenPage)
    np.testing.assert_array_equal(second.scan[:, 30:], usual.scan[:, 30:])
    due = 2 * job.scans[0].shape[1]
    most_shift = round(0.9 / job.press.geometry.line_pitch_mm)
    assert abs(first.first_line - due) <= most_shift + 4  # thumbnails tell to half a pixel of 8 lines


def test_a_trigger_cuts_where_it_counts_and_says_who_slipped(job: Job) -> None:
    pitch = job.scans[0].shape[1]
    start = TriggerCount(lines=pitch)
    found = job.play({}, sheets=PAGES, start=start)
    assert [page.first_line for page in found if isinstance(page, SeenPage)] == [
        pitch * n for n in range(PAGES)
    ]
    np.testing.assert_array_equal(found[3].scan[:, 19:430], job.scans[3][:, 19:430])  # type: ignore[union-attr]
    moved = list(job.scans)
    moved[3] = np.roll(moved[3], 26, axis=1)
    late = replace(job, scans=tuple(moved)).play({}, sheets=PAGES, start=start)
    assert pages_of(late) == list(range(PAGES))
    said = [(page.job_page, [f.kind for f in page.faults]) for page in late if isinstance(page, SeenPage)]
    assert said[3] == (3, ["slip"])
    assert all(kinds == [] for page, kinds in said if page != 3)


def test_a_sheet_alone_off_its_place_is_the_only_one_that_slipped(job: Job) -> None:
    """Gap behind it is as much too small as that before it was too large; drums of one sheet a turn do that."""
    gap = np.repeat(np.median(job.scans[0][:, :8], axis=1, keepdims=True), 40, axis=1).astype(np.uint16)
    late, early = np.concatenate([gap, gap], axis=1), gap[:, :0]
    spaced = [np.concatenate([gap, scan], axis=1) for scan in job.scans]
    spaced[5] = np.concatenate([late, job.scans[5]], axis=1)
    spaced[6] = np.concatenate([early, job.scans[6]], axis=1)
    found = replace(job, scans=tuple(spaced)).play({}, sheets=PAGES)
    said = [(page.job_page, [f.kind for f in page.faults]) for page in found if isinstance(page, SeenPage)]
    assert [entry for entry in said if entry[1]] == [(5, ["slip"])]


def test_a_page_that_is_not_known_yet_is_not_guessed(job: Job) -> None:
    unknown: list[Thumbnail | None] = [*job.thumbnails[:3], None, *job.thumbnails[4:]]
    pager = Pager(job.press, expected=unknown)
    drum = Drum(job.scans, press=job.press, passing=turns(PAGES, {}))
    found = [page for block in drum.blocks() for page in pager.push(block)] + pager.flush()
    assert pages_of(found) == [0, 1, 2, None, 4, 5, 6, 7]
    sheets = [page for page in found if isinstance(page, SeenPage)]
    assert [page.taken_for for page in sheets] == [None, None, None, 3, None, None, None, None]
    assert [page.faults for page in sheets] == [()] * 8  # nothing is said against what nobody knows
    assert (pager.to_come, pager.missing) == (PAGES - 8, 0)


@dataclass
class KnownInTime:
    """Thumbnails of pages that were due at one time or another; what is made ready ahead is no more."""

    thumbnails: tuple[Thumbnail, ...]
    due: int = 0

    def __len__(self) -> int:
        return len(self.thumbnails)

    def __getitem__(self, job_page: int) -> Thumbnail | None:
        return self.thumbnails[job_page] if job_page <= self.due else None


def test_a_run_stays_in_step_behind_strange_sheets_though_pages_are_known_when_due(job: Job) -> None:
    """Pages 2 and 3 are printed as others; nobody knew page 4 until it was due in spite of them."""
    expected, scans = KnownInTime(job.thumbnails), list(job.scans)
    scans[1] = scans[2] = job.foreign
    pager, found = Pager(job.press, expected=expected), list[SeenPage | MissingPage]()
    for block in Drum(scans, press=job.press, passing=turns(PAGES, {})).blocks():
        found += pager.push(block)
        expected.due = max(expected.due, pager.next_page)
    found += pager.flush()
    assert pages_of(found) == [0, None, None, 3, 4, 5, 6, 7]
    assert missing_of(found) == [1, 2]


@pytest.mark.parametrize("wrong", [5, 7])
def test_a_wrong_page_that_shows_a_later_one_does_not_move_the_run_to_there(job: Job, wrong: int) -> None:
    """The last page known, and one before it, is printed in place of page 3; what comes behind is known as itself."""
    expected, scans = KnownInTime(job.thumbnails, due=wrong), list(job.scans)
    scans[2] = job.scans[wrong]
    pager, found = Pager(job.press, expected=expected), list[SeenPage | MissingPage]()
    due = list[int]()
    for block in Drum(scans, press=job.press, passing=turns(PAGES, {})).blocks():
        pages = pager.push(block)
        due += [pager.next_page for page in pages if isinstance(page, SeenPage)]
        expected.due, found = max(expected.due, pager.next_page), found + pages
    found += pager.flush()
    assert pages_of(found) == [0, 1, wrong, 3, 4, 5, 6, 7]
    assert due == list(range(1, len(due) + 1))
    assert missing_of(found) == [2]
    assert [fault.detail for page in found if isinstance(page, MissingPage) for fault in page.faults] == [
        f"a sheet that shows page {wrong + 1} came instead of the page"
    ]


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_sheet_within_which_the_lines_end_is_said_to_be_cut_short(job: Job, share: float) -> None:
    pager, whole = Pager(job.press, expected=list(job.thumbnails)), job.scans[0].shape[1]
    lines = np.concatenate([job.scans[0], job.scans[1][:, : round(share * whole)]], axis=1)
    found = pager.push(LineBlock(first_line=0, lines=lines, time_s=0.0)) + pager.flush()
    assert [page.cut_short for page in found if isinstance(page, SeenPage)] == [False, True]


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_a_sheet_within_which_the_lines_begin_is_torn_and_the_next_is_in_step(job: Job, share: float) -> None:
    """A camera is started while a sheet passes under it: nobody saw where that sheet began."""
    first = round(share * job.scans[0].shape[1])
    scans = [job.scans[0][:, first:], *job.scans[1:4]]
    block = LineBlock(first_line=0, lines=np.concatenate(scans, axis=1), time_s=0.0)
    found = [page for page in job.paged([block]) if isinstance(page, SeenPage)]
    assert (
        [page.torn for page in found] == [page.begun_within for page in found] == [True, False, False, False]
    )
    assert pages_of(list(found)) == [None, 1, 2, 3]


def test_sheets_whose_gap_was_lost_are_parted_all_the_same(job: Job) -> None:
    """What stands in place of the lost gap shows the sheet before it."""
    lines = np.concatenate(job.scans[:6], axis=1)
    end = sum(scan.shape[1] for scan in job.scans[:3])
    lost = slice(end - 45, end + 45)
    blocks = [
        LineBlock(first_line=0, lines=lines[:, : lost.start], time_s=0.0),
        LineBlock(first_line=lost.stop, lines=lines[:, lost.stop :], time_s=0.0),
    ]
    found = [page for page in job.paged(blocks) if isinstance(page, SeenPage)]
    assert pages_of(list(found)) == list(range(6))
    assert not any(page.torn for page in found)


def test_pages_that_did_not_come_are_counted_when_the_lines_have_ended(job: Job) -> None:
    """Page 3 is left out, page 5 comes behind page 6; the lines end two sheets too early."""
    faults = {2: DrumFault(kind="missing", amount=1), 4: DrumFault(kind="out-of-order")}
    pager = Pager(job.press, expected=repeated(job.thumbnails, PAGES + 2))
    for block in Drum(job.scans, press=job.press, passing=turns(PAGES, faults)).blocks():
        pager.push(block)
    pager.flush()
    assert (pager.to_come, pager.missing) == (2, 1)


def test_repeated_designs_are_counted_through(job: Job) -> None:
    found = job.play({9: DrumFault(kind="missing", amount=1)}, sheets=3 * PAGES)
    assert pages_of(found) == [n for n in range(3 * PAGES) if n != 9]
    assert missing_of(found) == [9]


def test_lines_are_let_go(job: Job) -> None:
    store = LineStore(job.press, longest=500)
    pager = Pager(job.press, expected=repeated(job.thumbnails, 5 * PAGES))
    pager._store = pager._finder._store = store
    most = 0
    for block in Drum(job.scans, press=job.press, passing=turns(5 * PAGES, {})).blocks():
        pager.push(block)
        most = max(most, sum(lines.shape[1] for _, lines, _ in store._parts))
    assert most < 1.5 * job.scans[0].shape[1]
    assert len(store._backing) * 8 < 1.5 * job.scans[0].shape[1]


def test_lines_of_another_camera_are_refused(job: Job) -> None:
    pager = Pager(job.press, expected=list(job.thumbnails))
    with pytest.raises(ScanError, match=r"line 0.*400 pixels"):
        pager.push(LineBlock(first_line=0, lines=np.zeros((1, 5, 399), np.uint16), time_s=0.0))


def test_nothing_but_backing_is_no_page(job: Job) -> None:
    backing = np.full((1, 3000, job.press.geometry.pixels), job.press.sensors[0].backing_dn, np.uint16)
    assert job.paged([LineBlock(first_line=0, lines=backing, time_s=0.0)]) == []
    assert job.paged([]) == []


def test_two_sensors_are_paged_as_one(two_sensor_press: Press, make_page: Callable[..., Page]) -> None:
    pages = [make_page(n) for n in (1, 2, 3)]
    session = Session.draw(Amounts.stated(), two_sensor_press, np.random.default_rng(0))
    scans, thumbnails = [], []
    for n, page in enumerate(pages):
        good = predict(page, sensors=two_sensor_press.sensors, geometry=two_sensor_press.geometry, threads=1)
        thumbnails.append(thumbnail_of(page, good, two_sensor_press))
        made = scan_page(
            page,
            press=two_sensor_press,
            request=None,
            others=(),
            fetch=lambda _: pages[0],
            rng=stream(1, "print", n),
            session=session,
        )
        scans.append(made.dn)
    drum = Drum(scans, press=two_sensor_press, passing=turns(9, {4: DrumFault(kind="repeated")}))
    pager = Pager(two_sensor_press, expected=repeated(thumbnails, 9))
    found = [page for block in drum.blocks() for page in pager.push(block)] + pager.flush()
    assert pages_of(found) == [0, 1, 2, 3, 4, 4, 5, 6, 7, 8]


def test_lines_that_one_sensor_did_not_see_are_its_alone_and_sheets_are_found_by_the_other(
    two_sensor_press: Press, make_page: Callable[..., Page]
) -> None:
    """The second camera is away for three sheets."""
    page, press = make_page(100), two_sensor_press
    expected = predict(page, sensors=press.sensors, geometry=press.geometry, threads=1)
    scan = np.rint(expected.expected_dn).clip(0, 65535).astype(np.uint16)
    page_lines, kept = scan.shape[1], []
    for block in Drum([scan], press=press, passing=turns(6, {})).blocks():
        if 1.5 * page_lines <= block.first_line < 4.5 * page_lines:
            lost = LineFault(
                kind="camera-away",
                first_line=block.first_line,
                lines=block.lines.shape[1],
                detail="camera B, sensor 2: the camera sends no lines",
                sensor=1,
            )
            lines = block.lines.copy()
            lines[1] = 0
            block = replace(block, lines=lines, faults=(lost,))
        kept.append(block)
    known = thumbnail_of(page, expected, press)
    pager = Pager(press, expected=repeated([known], 6))
    found = [one for block in kept for one in pager.push(block)] + pager.flush()
    assert pages_of(found) == list(range(6))
    assert not missing_of(found)
    for number, sheet in enumerate(found):
        assert isinstance(sheet, SeenPage)
        assert not sheet.torn
        share = unseen_share(sheet.unseen, sheet.scan.shape[1])
        assert {run.sensor for run in sheet.unseen} == ({1} if 1 <= number <= 4 else set())
        assert (share > 0.99) == (number in (2, 3))
        details = {fault.detail for fault in sheet.faults}
        assert details == ({"camera B, sensor 2: the camera sends no lines"} if 1 <= number <= 4 else set())
        assert len(sheet.faults) <= 1


def away(job: Job, first: float, last: float, *, restart: int = 0) -> list[LineBlock]:
    """The job's lines where the camera gave none between two places, in sheets; it then counts on by about as many."""
    blocks = list(Drum(job.scans, press=job.press, passing=turns(PAGES, {}), block_lines=8).blocks())
    page_lines = job.scans[0].shape[1]
    kept = [block for block in blocks if not first * page_lines < block.first_line < last * page_lines]
    back = next(n for n, block in enumerate(kept) if block.first_line >= last * page_lines)
    before, due = kept[back - 1], kept[back].first_line + restart
    lost = LineFault(
        kind="camera-away",
        first_line=before.next_line,
        lines=due - before.next_line,
        detail="the camera was disconnected",
    )
    moved = [replace(block, first_line=block.first_line + restart) for block in kept[back:]]
    return [*kept[:back], replace(moved[0], faults=(lost,)), *moved[1:]]


@pytest.mark.parametrize("restart", [0, 37])
def test_sheets_that_pass_while_the_camera_is_away_are_named_and_no_other(job: Job, restart: int) -> None:
    found = job.paged(away(job, 2.4, 5.3, restart=restart))
    came = [page for page in found if isinstance(page, SeenPage)]
    assert [(page.job_page, page.torn, page.taken_for) for page in came] == [
        (0, False, None),
        (1, False, None),
        (None, True, 2),
        (None, True, None),
        (6, False, None),
        (7, False, None),
    ]
    assert [page.job_page for page in found if isinstance(page, MissingPage)] == [3, 4, 5]
    assert {fault.detail for page in found if isinstance(page, MissingPage) for fault in page.faults} == {
        "the camera delivered no lines while the sheet passed"
    }
    assert {fault.kind for page in came for fault in page.faults} == {"lost-lines"}
    assert all(page.unseen == () for page in came if not page.torn)


@pytest.mark.parametrize("last", [5.0, 5.3])
def test_behind_an_absence_triggers_are_counted_from_a_sheets_edge(job: Job, last: float) -> None:
    """The camera's count is 60 lines off when it is back, and with it the triggers: 6 mm, which are not the sheets'.

    It comes back within a sheet, or so near before one that the lines above that one's edge are lost.
    """
    start = TriggerCount(lines=job.scans[0].shape[1])
    usual = {page.job_page: page for page in job.play({}, sheets=PAGES, start=start)}
    found = [
        page for page in job.paged(away(job, 2.4, last, restart=60), start=start) if page.job_page in (6, 7)
    ]
    assert len(found) == 2
    for page in found:
        other = usual[page.job_page]
        assert isinstance(page, SeenPage)
        assert isinstance(other, SeenPage)
        assert page.faults == ()
        assert abs(page.first_line - 60 - other.first_line) <= SLIP_MM / job.press.geometry.line_pitch_mm


@pytest.mark.parametrize("triggered", [False, True])
@pytest.mark.parametrize("last", [5.12, 4.96])
def test_pieces_of_a_sheet_behind_an_absence_are_torn_and_no_strangers(
    job: Job, last: float, triggered: bool
) -> None:
    """A band that looks like backing parts a sheet where nobody knows which page to expect.

    The camera is back within that sheet, above the band, or at the end of the one before, so that all of it is seen.
    """
    dark, thumbnail = banded(job, job.pages[5], slice(350, 450))
    scans = (*job.scans[:5], job.scan(dark, 44), *job.scans[6:])
    thumbnails = (*job.thumbnails[:5], thumbnail, *job.thumbnails[6:])
    parted = replace(job, scans=scans, thumbnails=thumbnails)
    start = TriggerCount(lines=job.scans[0].shape[1]) if triggered else None
    found = [
        page for page in parted.paged(away(parted, 1.4, last), start=start) if isinstance(page, SeenPage)
    ]
    assert pages_of(list(found)) == [0, None, None, None, 6, 7]
    assert [page.torn for page in found] == [False, True, True, True, False, False]
    assert [page.taken_for for page in found] == [None, 1, None, None, None, None]
    assert found[4].faults == found[5].faults == ()


@pytest.mark.parametrize("triggered", [False, True])
def test_a_whole_stranger_behind_an_absence_is_no_piece(job: Job, triggered: bool) -> None:
    """Neither is it where triggers are counted from."""
    scans = (*job.scans[:5], job.foreign, *job.scans[6:])
    start = TriggerCount(lines=job.scans[0].shape[1]) if triggered else None
    strange = replace(job, scans=scans)
    found = [
        page for page in strange.paged(away(strange, 1.4, 5.0), start=start) if isinstance(page, SeenPage)
    ]
    assert pages_of(list(found)) == [0, None, None, 6, 7]
    assert [page.torn for page in found] == [False, True, False, False, False]
    assert {fault.kind for fault in found[2].faults} >= {"unknown"}
    assert found[3].faults == found[4].faults == ()


def test_a_camera_that_is_away_between_sheets_tears_none(job: Job) -> None:
    scans = [np.concatenate([job.scans[0][:, :0], scan], axis=1) for scan in job.scans]
    gap = np.repeat(job.scans[0][:, -1:], 300, axis=1)
    scans[3] = np.concatenate([scans[3], gap], axis=1)
    blocks = list(Drum(scans, press=job.press, passing=turns(PAGES, {})).blocks())
    between = sum(scan.shape[1] for scan in scans[:4]) - 150
    back = next(n for n, block in enumerate(blocks) if block.first_line >= between)
    lost = LineFault(
        kind="camera-away", first_line=blocks[back].first_line, lines=5, detail="the camera was disconnected"
    )
    anew = [replace(block, first_line=block.first_line + 5) for block in blocks[back:]]
    found = job.paged([*blocks[:back], replace(anew[0], faults=(lost,)), *anew[1:]])
    assert pages_of(found) == list(range(PAGES))
    assert not any(page.torn for page in found if isinstance(page, SeenPage))


def test_lost_lines_are_told_where_they_lie_in_the_sheet(job: Job) -> None:
    """By the camera's own word, or by its count alone."""
    blocks = list(Drum(job.scans, press=job.press, passing=turns(PAGES, {})).blocks())
    middle = next(n for n, block in enumerate(blocks) if block.first_line > 3.4 * job.scans[0].shape[1])
    block = blocks[middle]
    head, tail = (
        replace(block, lines=block.lines[:, :10]),
        replace(block, first_line=block.first_line + 13, lines=block.lines[:, 13:]),
    )
    lost = LineFault(kind="lost-packets", first_line=block.first_line + 10, lines=3, detail="three lost")
    for said, detail in (
        ((lost,), "three lost"),
        ((), f"lines {block.first_line + 10} to {block.first_line + 12} "),
    ):
        found = job.paged([*blocks[:middle], head, replace(tail, faults=said), *blocks[middle + 1 :]])
        assert pages_of(found) == list(range(PAGES))
        sheet = found[3]
        assert isinstance(sheet, SeenPage)
        first = block.first_line + 10 - sheet.first_line
        assert sheet.unseen == (Unseen(first, first + 3),)
        (fault,) = sheet.faults
        assert fault.kind == "lost-lines"
        assert fault.detail.startswith(detail)
        assert not any(page.unseen for page in found if isinstance(page, SeenPage) and page is not sheet)


def test_lines_that_came_too_late_are_lost_once_and_said_twice(job: Job) -> None:
    blocks = list(Drum(job.scans, press=job.press, passing=turns(PAGES, {})).blocks())
    middle = next(n for n, block in enumerate(blocks) if block.first_line > 3.4 * job.scans[0].shape[1])
    gone, after = blocks[middle], blocks[middle + 1]
    lost = LineFault(kind="lost-blocks", first_line=gone.first_line, lines=64, detail="a block did not come")
    late = LineFault(kind="late-lines", first_line=gone.first_line, lines=64, detail="it came too late")
    found = job.paged([*blocks[:middle], replace(after, faults=(lost, late)), *blocks[middle + 2 :]])
    assert pages_of(found) == list(range(PAGES))
    sheet = found[3]
    assert isinstance(sheet, SeenPage)
    assert [(fault.kind, fault.detail) for fault in sheet.faults] == [
        ("lost-lines", "a block did not come"),
        ("extra-lines", "it came too late"),
    ]
    assert [end - first for first, end, _ in sheet.unseen] == [64]


def test_ink_across_a_page_is_no_backing_between_bare_parts() -> None:
    """Ink a little darker than paper, without detail, as one sensor sees a solid orange: the sheet is not blank."""
    rows = np.arange(176)[:, None]
    paper = np.full((176, 124), 0.7, np.float32)
    band = (paper - 0.15 * np.exp(-(((rows - 88) / 30) ** 2))).astype(np.float32)
    small = np.full_like(paper, 0.05)
    small[20:150, 10:100] = 0.7
    whole = (0, 176, 0, 124)
    assert is_blank(paper, whole)
    assert is_blank(small, whole)
    assert not is_blank(band, whole)
