"""How a job lies on its sheets: words, order of sides, and the way of each page onto its place and back."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.errors import JobError, RequestError
from prooflight.pages.layout.imposing import imposed, places_on, side_size
from prooflight.pages.layout.layout import Layout, backs_at
from prooflight.pages.layout.plan import SheetPlan
from prooflight.pages.raster import Page, turned

if TYPE_CHECKING:
    from collections.abc import Callable

DPI = 254.0
"""Ten pixels a millimetre."""


@st.composite
def layouts(draw: Callable[[Any], Any]) -> Layout:
    sides, columns, rows = draw(st.integers(1, 2)), draw(st.integers(1, 3)), draw(st.integers(1, 3))
    repeat = draw(st.booleans())
    a_sheet = sides * (1 if repeat else columns * rows)
    places: tuple[int, ...] = ()
    if not repeat and draw(st.booleans()):
        places = tuple(draw(st.permutations(range(1, a_sheet + 1))))
    return Layout(
        sides=sides,
        order=draw(st.sampled_from(["alternate", "batch", "loop"])) if sides == 2 else "alternate",
        depth=draw(st.integers(1, 5)) if sides == 2 else 1,
        backs=draw(st.sampled_from(["upright", "turned"])) if sides == 2 else "upright",
        columns=columns,
        rows=rows,
        places=places,
        repeat=repeat,
        gutter_mm=(float(draw(st.integers(0, 3))), float(draw(st.integers(0, 3)))),
        rotate=draw(st.sampled_from([0, 90, 180, 270])),
        pages_a_set=draw(st.one_of(st.none(), st.integers(1, 4).map(lambda sets: sets * a_sheet))),
    )


def job_page(number: int, size: tuple[int, int]) -> Page:
    """A page of which no two pixels of any two pages are alike."""
    rows, columns = size[1], size[0]
    at = np.arange(rows * columns, dtype=np.uint32) + 1 + number * 100_000
    cmyk = at.view(np.uint8).reshape(rows, columns, 4)
    return Page(cmyk=np.ascontiguousarray(cmyk), dpi=DPI, name=f"p{number:04d}", number=number)


@given(layouts())
def test_what_is_said_is_read_again(layout: Layout) -> None:
    again = Layout.parse(layout.text)
    assert again == (layout if layout.order != "alternate" else replace(layout, depth=1))


@given(layouts(), st.integers(1, 40))
def test_every_side_passes_once_and_no_back_before_its_front(layout: Layout, sheets: int) -> None:
    total = sheets * layout.sides
    passing = [layout.side_at(at, sheets) for at in range(total)]
    assert sorted(passing) == list(range(total))
    assert [layout.position_of(side, sheets) for side in passing] == list(range(total))
    if layout.sides == 2:
        assert all(passing.index(2 * sheet) < passing.index(2 * sheet + 1) for sheet in range(sheets))


@pytest.mark.parametrize(
    ("words", "passing"),
    [
        ("sides=2", "f0 b0 f1 b1 f2 b2 f3 b3 f4 b4"),
        ("sides=2,order=batch:2", "f0 f1 b0 b1 f2 f3 b2 b3 f4 b4"),
        ("sides=2,order=batch:9", "f0 f1 f2 f3 f4 b0 b1 b2 b3 b4"),
        ("sides=2,order=loop:1", "f0 b0 f1 b1 f2 b2 f3 b3 f4 b4"),
        ("sides=2,order=loop:3", "f0 f1 f2 b0 f3 b1 f4 b2 b3 b4"),
        ("sides=2,order=loop:9", "f0 f1 f2 f3 f4 b0 b1 b2 b3 b4"),
    ],
)
def test_the_orders_in_which_one_camera_sees_both_sides(words: str, passing: str) -> None:
    layout = Layout.parse(words)
    seen = [divmod(layout.side_at(at, 5), 2) for at in range(10)]
    assert " ".join(f"{'fb'[back]}{sheet}" for sheet, back in seen) == passing


@given(layouts(), st.integers(1, 60))
def test_every_page_of_the_job_lies_on_one_side_and_only_the_last_sheet_has_blank_places(
    layout: Layout, pages: int
) -> None:
    layout = replace(layout, pages_a_set=None).of(pages)
    sides = layout.sides_of(pages)
    shown = [page for side in range(1, sides + 1) for page in dict.fromkeys(layout.pages_on(side))]
    assert sorted(page for page in shown if page is not None) == list(range(1, pages + 1))
    assert all(len(layout.pages_on(side)) == layout.places_a_side for side in range(1, sides + 1))
    blank = {(side - 1) // layout.sides for side in range(1, sides + 1) if None in layout.pages_on(side)}
    assert blank == ({sides // layout.sides - 1} if layout.blank_places else set())
    assert layout.blank_places < layout.pages_a_sheet
    names = [layout.side_name(side) for side in range(1, sides + 1)]
    assert len(set(names)) == sides


@pytest.mark.parametrize(
    ("words", "pages", "last"),
    [
        ("sides=2,n-up=2x1", 5, [("s0002-front", (5, None)), ("s0002-back", (None, None))]),
        ("sides=2,n-up=2x1", 7, [("s0002-front", (5, 6)), ("s0002-back", (7, None))]),
        ("sides=2,n-up=2x1,places=4-1-2-3", 6, [("s0002-front", (None, 5)), ("s0002-back", (6, None))]),
        ("sides=2", 5, [("p0005", (5,)), ("s0003-back", (None,))]),
        ("sides=2,places=2-1", 5, [("s0003-front", (None,)), ("p0005", (5,))]),
        ("sides=2,n-up=2x1,repeat=yes", 3, [("p0003", (3, 3)), ("s0002-back", (None, None))]),
        ("n-up=2x2", 1, [("s0001", (1, None, None, None))]),
    ],
)
def test_what_the_pages_leave_of_the_last_sheet_stays_blank(
    words: str, pages: int, last: list[tuple[str, tuple[int | None, ...]]]
) -> None:
    layout = Layout.parse(words).of(pages)
    sides = range(layout.sides_of(pages) - len(last) + 1, layout.sides_of(pages) + 1)
    assert [(layout.side_name(side), layout.pages_on(side)) for side in sides] == last


@given(layouts(), st.integers(4, 12), st.integers(4, 12), st.data())
def test_a_pixel_of_a_page_lies_where_its_place_says_and_comes_back(
    layout: Layout, width: int, height: int, data: st.DataObject
) -> None:
    """Closed form: the pixel with its middle at (x, y) of the page is the one with its middle at on_side(x, y)."""
    number = data.draw(st.integers(1, 2 * layout.sides))
    pages = [job_page(page, (width, height)) for page in layout.pages_on(number)]
    side = imposed(pages, layout, number)
    rows, columns = side.cmyk.shape[:2]
    gutter = round(10 * layout.gutter_mm[0]), round(10 * layout.gutter_mm[1])
    back = layout.sides == 2 and number % 2 == 0
    places = places_on((width, height), (columns, rows), gutter, layout, back=back)
    for page, place in zip(pages, places, strict=True):
        column, row = data.draw(st.integers(0, width - 1)), data.draw(st.integers(0, height - 1))
        x, y = place.on_side(column + 0.5, row + 0.5)
        assert np.array_equal(side.cmyk[int(y), int(x)], page.cmyk[row, column])
        assert place.on_page(x, y) == (column + 0.5, row + 0.5)
    assert np.count_nonzero(side.packed) == width * height * layout.places_a_side
    expected = side_size((width / 10, height / 10), layout)
    assert (side.width_mm, side.height_mm) == pytest.approx(expected)
    laid = turned(side)
    moved = [place.turned(columns, rows) for place in places]
    x, y = moved[0].on_side(0.5, 0.5)
    assert np.array_equal(laid.cmyk[int(y), int(x)], pages[0].cmyk[0, 0])


@given(layouts(), st.floats(0, 4), st.floats(0, 4), st.floats(0.1, 3), st.floats(0.1, 3))
def test_a_zone_of_a_page_lands_on_its_place_and_on_no_other(
    layout: Layout, x: float, y: float, width: float, height: float
) -> None:
    page = 8.0, 9.0
    side = side_size(page, layout)
    places = places_on(page, side, layout.gutter_mm, layout, back=layout.sides == 2)
    for place in places:
        corners = place.on_side(x, y), place.on_side(x + width, y + height)
        assert place.on_page(*corners[0]) == pytest.approx((x, y))
        (left, right), (top, bottom) = (sorted(both) for both in zip(*corners, strict=True))
        inside = 1e-6
        inner = left + inside, top + inside, right - left - 2 * inside, bottom - top - 2 * inside
        assert [other for other in places if other.meets(inner)] == [place]


def test_pages_lie_in_the_middle_of_a_larger_sheet() -> None:
    layout = Layout.parse("n-up=2x1,gutter=2,sheet=10x4")
    side = imposed([job_page(number, (30, 20)) for number in (1, 2)], layout, 1)
    assert side.cmyk.shape == (40, 100, 4)
    ink = np.argwhere(side.packed)
    assert (ink.min(0).tolist(), ink.max(0).tolist()) == ([10, 10], [29, 89])
    assert not side.packed[:, 40:60].any()
    assert side.name == "s0001"


@pytest.mark.parametrize(
    ("across", "along", "edge", "backs"),
    [
        (210, 297, "long-edge", "turned"),
        (210, 297, "short-edge", "upright"),
        (297, 210, "long-edge", "upright"),
        (297, 210, "short-edge", "turned"),
        (297, 210, "turned", "turned"),
    ],
)
def test_backs_by_the_edge_at_which_a_reader_turns_the_sheet(
    across: float, along: float, edge: Any, backs: str
) -> None:
    assert backs_at(edge, across_mm=across, along_mm=along) == backs


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("sides=3", "sides is '3'"),
        ("duplex=yes", "'duplex=yes' is none of sides"),
        ("", "'' is none of"),
        ("sides=2,sides=2", "given twice"),
        ("n-up=2", "n-up is '2'"),
        ("n-up=2x99", "n-up is '2x99'"),
        ("sides=2,order=loop", "order is 'loop'"),
        ("order=batch:5", "two sides"),
        ("backs=turned", "two sides"),
        ("n-up=2x1,places=1-3", "places is 1-3"),
        ("n-up=2x1,repeat=yes,places=1", "repeat"),
        ("sides=2,pages-a-set=5", "a set takes 5 pages, and a sheet 2"),
        ("gutter=-3", "gutter is '-3'"),
        ("sheet=0x10", "sheet is '0x10'"),
        ("rotate=45", "rotate is '45'"),
    ],
)
def test_words_that_are_none_are_refused_in_one_line(words: str, said: str) -> None:
    with pytest.raises(RequestError) as error:
        Layout.parse(words)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_sets_that_do_not_fit_and_too_large_pages_are_refused() -> None:
    with pytest.raises(
        RequestError,
        match="the 5 pages of the job fill 3 sheets, and a set takes 2 sheets; give pages-a-set=2 or 6, so",
    ):
        Layout.parse("sides=2,pages-a-set=4").of(5)
    with pytest.raises(RequestError, match=r"need 420.0 x 297.0 mm, and the sheet has 320 x 450 mm"):
        side_size((210, 297), Layout.parse("n-up=2x1,sheet=320x450"))
    with pytest.raises(JobError, match="on the same sheet"):
        imposed([job_page(1, (30, 20)), job_page(2, (40, 20))], Layout.parse("n-up=2x1"), 1)


def test_a_plan_travels_as_json() -> None:
    plan = SheetPlan(layout=Layout.parse("sides=2,n-up=2x1"), sides=4, sheets=6, page_mm=(210.0, 297.0))
    assert SheetPlan.of(plan.facts) == plan
    filled_in_part = replace(plan, layout=plan.layout.of(5))
    assert SheetPlan.of(filled_in_part.facts) == filled_in_part
    earlier = {name: value for name, value in plan.facts.items() if name != "job_pages"}
    assert SheetPlan.of(earlier) == plan
    for damaged in (None, [], {}, plan.facts | {"words": "sides=9"}, plan.facts | {"sides": 0}):
        assert SheetPlan.of(damaged) is None


def test_a_copy_of_the_job_begins_anew() -> None:
    plan = SheetPlan(layout=Layout.parse("sides=2,n-up=2x1,pages-a-set=8"), sides=4, sheets=6)
    assert [plan.number_at(at) for at in range(8)] == [1, 2, 3, 4, 1, 2, 3, 4]
    assert [plan.pages(sheet) for sheet in (0, 1, 2)] == [(1, 2, 3, 4), (5, 6, 7, 8), (1, 2, 3, 4)]
    assert [plan.set_of(sheet) for sheet in range(6)] == [0, 0, 1, 1, 2, 2]
