"""Each misprint changes the page where it says it does, as much as it says, and nowhere else."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.pages.raster import Page
from prooflight.simulating.misprints import Misprint
from prooflight.simulating.scans import KINDS, draw_misprint
from prooflight.simulating.worlds import worlds

if TYPE_CHECKING:
    from collections.abc import Callable

SEEDS = st.integers(0, 2**32)
SEVERITIES = st.floats(0, 1)
DPI = 50.8  # half a millimetre a pixel


def random_page(seed: int, *, rows: int = 110, columns: int = 84, number: int = 1) -> Page:
    cmyk = np.random.default_rng(seed).integers(0, 256, (rows, columns, 4)).astype(np.uint8)
    return Page(cmyk=cmyk, dpi=DPI, name=f"p{number:04}", number=number)


def fetch(number: int) -> Page:
    return random_page(1000 + number, rows=90 + 7 * number, columns=60 + 9 * number, number=number)


def drawn(
    page: Page, kind: str, severity: float, seed: int, others: tuple[int, ...] = (2, 3)
) -> tuple[Page, Misprint]:
    return draw_misprint(page, kind, severity, others=others, fetch=fetch, rng=np.random.default_rng(seed))


def box(page: Page, misprint: Misprint) -> tuple[slice, slice]:
    """The region in raster pixels: rows, columns."""
    x, y, width, height = (round(v / page.pixel_mm) for v in misprint.region_mm)
    return slice(y, y + height), slice(x, x + width)


def drawn_with(accept: Callable[[Misprint], bool], kind: str, severity: float) -> tuple[Page, Page, Misprint]:
    """Page, misprint page and misprint of the first seed whose misprint is accepted."""
    page = random_page(1)
    for seed in range(200):
        printed, misprint = drawn(page, kind, severity, seed)
        if accept(misprint):
            return page, printed, misprint
    raise AssertionError


def test_the_kinds_are_named_as_in_the_file() -> None:
    assert set(KINDS) <= {entry["kind"] for entry in worlds()["misprint"]}


@pytest.mark.parametrize("kind", KINDS)
@given(seed=SEEDS, severity=SEVERITIES)
def test_a_misprint_changes_its_region_only(kind: str, seed: int, severity: float) -> None:
    page = random_page(seed)
    kept = page.cmyk.copy()
    printed, misprint = drawn(page, kind, severity, seed)
    np.testing.assert_array_equal(page.cmyk, kept)  # the page given stays good
    assert (misprint.kind, misprint.severity) == (kind, severity)
    assert misprint.detail
    assert (printed.dpi, printed.name, printed.number) == (page.dpi, page.name, page.number)
    assert printed.cmyk.shape == page.cmyk.shape
    assert printed.cmyk.flags.c_contiguous
    rows, columns = box(page, misprint)
    outside = np.ones(page.cmyk.shape[:2], bool)
    outside[rows, columns] = False
    np.testing.assert_array_equal(printed.cmyk[outside], page.cmyk[outside])
    x, y, width, height = misprint.region_mm
    assert x >= 0
    assert y >= 0
    assert x + width <= page.width_mm + 0.011  # two decimals each
    assert y + height <= page.height_mm + 0.011


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("severity", [0.0, 1.0])
@given(seed=SEEDS, rows=st.integers(1, 12), columns=st.integers(1, 12))
def test_a_page_of_any_size_can_be_misprinted(
    kind: str, severity: float, seed: int, rows: int, columns: int
) -> None:
    page = random_page(seed, rows=rows, columns=columns)
    printed, _ = drawn(page, kind, severity, seed)
    assert printed.cmyk.shape == (rows, columns, 4)


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_same_misprint(kind: str) -> None:
    page = random_page(1)
    (first, a), (again, b), (other, _) = (drawn(page, kind, 0.6, seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.cmyk, again.cmyk)
    assert a == b
    assert (first.cmyk != other.cmyk).any()


@given(seed=SEEDS, severity=SEVERITIES)
def test_a_missing_plane_is_one_ink_scaled(seed: int, severity: float) -> None:
    page = random_page(seed)
    printed, misprint = drawn(page, "missing-plane", severity, seed)
    rows, columns = box(page, misprint)
    assert columns == slice(0, page.cmyk.shape[1])
    changed = [ink for ink in range(4) if (printed.cmyk[..., ink] != page.cmyk[..., ink]).any()]
    assert len(changed) == 1
    left = 0.75 * (1 - severity)  # linear from 75 % to nothing
    want = page.cmyk[rows, :, changed[0]] * left
    np.testing.assert_allclose(printed.cmyk[rows, :, changed[0]], want, atol=0.5 + 1e-6)
    assert ("cyan", "magenta", "yellow", "black")[changed[0]] in misprint.detail


def test_a_plane_goes_missing_over_the_page_or_over_a_band() -> None:
    page, printed, misprint = drawn_with(lambda m: m.detail.endswith("page"), "missing-plane", 1.0)
    assert misprint.region_mm == pytest.approx((0, 0, page.width_mm, page.height_mm), abs=0.005)
    assert any(not printed.cmyk[..., ink].any() for ink in range(4))
    page, _, misprint = drawn_with(lambda m: m.detail.endswith("band"), "missing-plane", 1.0)
    assert page.height_mm / 4 - page.pixel_mm <= misprint.region_mm[3] < page.height_mm


@given(seed=SEEDS, severity=SEVERITIES)
def test_a_streak_is_more_of_one_ink_along_the_travel(seed: int, severity: float) -> None:
    page = random_page(seed)
    printed, misprint = drawn(page, "streak", severity, seed)
    rows, columns = box(page, misprint)
    width_mm = 0.15 * (2.0 / 0.15) ** severity
    assert misprint.region_mm[2] == pytest.approx(max(width_mm, page.pixel_mm), abs=page.pixel_mm / 2 + 0.005)
    assert misprint.region_mm[3] >= page.height_mm / 4 - page.pixel_mm
    share = 0.02 * 30.0**severity  # of the bare paper
    changed = [ink for ink in range(4) if (printed.cmyk[..., ink] != page.cmyk[..., ink]).any()]
    assert len(changed) == 1
    before = page.cmyk[rows, columns, changed[0]].astype(float)
    want = before + (255 - before) * share
    np.testing.assert_allclose(printed.cmyk[rows, columns, changed[0]], want, atol=0.5 + 1e-3)


@given(seed=SEEDS, severity=SEVERITIES)
def test_missing_content_leaves_paper(seed: int, severity: float) -> None:
    page = random_page(seed)
    printed, misprint = drawn(page, "missing-content", severity, seed)
    rows, columns = box(page, misprint)
    assert not printed.cmyk[rows, columns].any()
    size_mm = 4.0 * 20.0**severity
    _, _, width, height = misprint.region_mm
    assert width == pytest.approx(min(size_mm, page.width_mm), abs=page.pixel_mm / 2 + 0.005)
    assert height == pytest.approx(min(size_mm, page.height_mm), abs=page.pixel_mm / 2 + 0.005)


def test_another_page_is_printed_from_the_same_corner() -> None:
    page, printed, misprint = drawn_with(lambda m: "instead" in m.detail, "wrong-page", 0.5)
    number = 2 if "page 2" in misprint.detail else 3
    other = fetch(number).cmyk
    rows, columns = (min(a, b) for a, b in zip(page.cmyk.shape[:2], other.shape[:2], strict=True))
    np.testing.assert_array_equal(printed.cmyk[:rows, :columns], other[:rows, :columns])
    assert not printed.cmyk[rows:].any()
    assert not printed.cmyk[:, columns:].any()


def test_a_block_of_another_page_stands_where_it_stands_there() -> None:
    page, printed, misprint = drawn_with(lambda m: "block of page" in m.detail, "wrong-page", 0.5)
    number = 2 if "page 2" in misprint.detail else 3
    other = np.zeros_like(page.cmyk)
    whole = fetch(number).cmyk[: len(page.cmyk), : page.cmyk.shape[1]]
    other[: len(whole), : whole.shape[1]] = whole
    place = box(page, misprint)
    np.testing.assert_array_equal(printed.cmyk[place], other[place])


@given(seed=SEEDS, severity=SEVERITIES)
def test_a_page_off_its_place_is_moved_whole_and_leaves_paper(seed: int, severity: float) -> None:
    page = random_page(seed)
    page.cmyk[page.cmyk == 0] = 1  # so that paper is what was left
    printed, _ = drawn(page, "wrong-page", severity, seed, others=())
    distance_mm = 1.8 * (12.0 / 1.8) ** severity
    rows, columns = np.nonzero(printed.cmyk.any(axis=2))
    top, left = rows.min(), columns.min()
    height, width = rows.max() + 1 - top, columns.max() + 1 - left
    down = top if top else height - page.cmyk.shape[0]
    right = left if left else width - page.cmyk.shape[1]
    moved_mm = np.hypot(down, right) * page.pixel_mm
    assert moved_mm == pytest.approx(distance_mm, abs=page.pixel_mm * 0.71 + 1e-9)  # rounded both ways
    original = page.cmyk[max(0, -down) :, max(0, -right) :][:height, :width]
    np.testing.assert_array_equal(printed.cmyk[top : top + height, left : left + width], original)
