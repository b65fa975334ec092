"""Misprints at a place of the page, and pages off their place: amounts and shapes in closed form."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prooflight.pages.raster import Page
from prooflight.scans.placement import IN_PLACE
from prooflight.simulation.misprints.kinds import Drawn, draw_misprint

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

SEVERITY = pytest.mark.parametrize("severity", [0.0, 0.5, 1.0])
FEW = settings(max_examples=30)
DPI = 254.0  # 0.1 mm a pixel


def tint(*levels: int, rows: int = 900, columns: int = 700) -> Page:
    cmyk = np.tile(np.array(levels, np.uint8), (rows, columns, 1))
    return Page(cmyk=cmyk, dpi=DPI, name="p0001", number=1)


def noise_page(number: int, *, rows: int = 120, columns: int = 90, dpi: float = 50.8) -> Page:
    cmyk = np.random.default_rng(number).integers(1, 256, (rows, columns, 4)).astype(np.uint8)
    return Page(cmyk=cmyk, dpi=dpi, name=f"p{number:04}", number=number)


def fetch(number: int) -> Page:
    return noise_page(number, rows=90 + 7 * number, columns=60 + 9 * number)


def drawn(page: Page, kind: str, severity: float, seed: int, others: tuple[int, ...] = ()) -> Drawn:
    return draw_misprint(page, kind, severity, others=others, fetch=fetch, rng=np.random.default_rng(seed))


def draws(
    page: Page, kind: str, severity: float, says: str, *, seeds: int = 60, others: tuple[int, ...] = ()
) -> Iterator[Drawn]:
    """Those of many draws whose detail says something; at least one."""
    every = (drawn(page, kind, severity, seed, others) for seed in range(seeds))
    found = [one for one in every if says in one.misprint.detail]
    assert found
    yield from found


def box(page: Page, region_mm: tuple[float, float, float, float]) -> tuple[slice, slice]:
    x, y, width, height = (round(v / page.pixel_mm) for v in region_mm)
    return slice(y, y + height), slice(x, x + width)


def change_of(page: Page, one: Drawn) -> NDArray[np.float64]:
    return one.page.cmyk.astype(float) - page.cmyk


# --- streaks ---


@SEVERITY
def test_a_streak_is_as_wide_and_as_strong_as_asked_for(severity: float) -> None:
    page = tint(100, 100, 100, 100)
    share, width_mm = 0.02 * 30**severity, 0.15 * (2 / 0.15) ** severity
    for says, full in (("more", 155 * share), ("starved", -100 * share), ("scratch", -100 * share)):
        one = next(draws(page, "streak", severity, says))
        rows, columns = box(page, one.misprint.region_mm)
        middle = slice(rows.start + 70, rows.stop - 70)  # soft ends of 6 mm
        change = change_of(page, one)[middle, columns].mean(axis=0)
        inks = np.flatnonzero(np.abs(change).max(axis=0) > 0.1)
        assert len(inks) == (4 if says == "scratch" else 1)
        noise = 5 * 0.5 / np.sqrt(middle.stop - middle.start)
        # flanks are symmetric about half height, so the integral is width x full height
        integral_mm = change[:, inks].sum(axis=0) * page.pixel_mm
        assert integral_mm == pytest.approx(full * width_mm, abs=noise * page.pixel_mm * len(change))
        if width_mm > 0.5:
            assert np.abs(change[:, inks]).max() == pytest.approx(abs(full), abs=noise)


def test_a_streak_runs_along_the_travel() -> None:
    page = tint(100, 0, 0, 0)
    heights = []
    for seed in range(30):
        one = drawn(page, "streak", 0.7, seed)
        _, _, width, height = one.misprint.region_mm
        heights.append(height / page.height_mm)
        assert width < 3.2
    assert min(heights) >= 0.25 - 1e-3
    assert 0.2 < np.mean(np.isclose(heights, 1)) < 0.9


# --- spots, voids, hickeys, scum ---


@SEVERITY
@pytest.mark.parametrize("way", ["spot", "void", "hickey"])
def test_spots_have_the_contrast_and_the_size_asked_for(severity: float, way: str) -> None:
    page = tint(100, 100, 100, 100)
    contrast, diameter_mm = 0.1 * 10**severity, 0.6 * 10**severity
    full = (155 if way == "spot" else -100) * contrast
    counts = set()
    for one in draws(page, "spots-voids", severity, way):
        regions = one.misprint.regions_mm or (one.misprint.region_mm,)
        counts.add(len(regions))
        assert one.misprint.detail.startswith(f"{len(regions)} {way}")
        assert len(regions) <= 12
        change = change_of(page, one)
        extreme = change.max() if way == "spot" else change.min()
        if len(regions) == 1:
            assert extreme == pytest.approx(full, abs=1)
            ink = np.abs(change).max(axis=(0, 1)).argmax()
            # the disc's area, give or take its uneven outline and, at the paper's edge, what is cut off
            area = (np.abs(change[..., ink]) > abs(full) / 2).sum() * page.pixel_mm**2
            whole = np.pi / 4 * diameter_mm**2 * (0.75 if way == "hickey" else 1)
            assert area < 1.25 * whole
            inside = box(page, regions[0])
            if inside[0].start > 0 and inside[1].start > 0 and inside[0].stop < 900 and inside[1].stop < 700:
                assert area > 0.75 * whole
    assert len(counts) > 2


@SEVERITY
def test_scum_is_ink_on_bare_paper_up_to_the_amount_asked_for(severity: float) -> None:
    page = tint(0, 0, 80, 0)
    page.cmyk[:, 350:, 2] = 255  # where there is the same ink already, nothing shows
    share = 0.015 * (0.2 / 0.015) ** severity
    peaks = []
    for seed in range(6):
        one = drawn(page, "scum", severity, seed)
        change = change_of(page, one)
        assert not change[..., [0, 1, 3]].any()
        assert not change[:, 350:].any()
        added = change[..., 2] / 175
        smooth = added[:900, :350].reshape(90, 10, 35, 10).mean(axis=(1, 3))
        peaks.append(smooth.max())
        rows, columns = box(page, one.misprint.region_mm)
        for edge in (added[rows.start], added[rows.stop - 1], added[rows, columns.start]):
            assert edge.mean() < 0.2 * share + 0.02  # soft edges
    assert max(peaks) <= share + 5 * 0.5 / 175 / 10
    assert max(peaks) >= 0.7 * share  # some cloud lies wholly on the tint


# --- what the page shows ---


@SEVERITY
def test_a_ghost_is_an_echo_of_the_page_further_along_the_travel(severity: float) -> None:
    page = tint(0, 0, 0, 0)
    page.cmyk[100:140, 200:500] = (200, 0, 0, 255)
    strength = 0.03 * (0.4 / 0.03) ** severity
    for seed in range(6):
        one = drawn(page, "ghost-smear", severity, seed)
        change = change_of(page, one)
        assert change.min() >= 0
        offset = round(float(one.misprint.detail.split()[-4]) / page.pixel_mm)
        assert 30 <= offset <= 600
        below = change[140:]  # where there was bare paper
        hit = np.flatnonzero(below.max(axis=(1, 2))) + 140
        assert hit.min() >= 100 + offset
        assert hit.max() < 140 + offset
        rows, columns = box(page, one.misprint.region_mm)
        if offset < 60 or columns.stop - columns.start < 300:
            continue
        echo = change[100 + offset : 140 + offset, 300:400].mean(axis=(0, 1))
        if (
            rows.start + 20 < 100 + offset
            and rows.stop - 20 > 140 + offset
            and columns.start < 280
            and (columns.stop > 420)
        ):
            inks = np.flatnonzero(echo)
            assert echo[inks] == pytest.approx(np.array([200.0, 0, 0, 255])[inks] * strength, abs=0.1)


@SEVERITY
def test_a_blurred_edge_has_the_sigma_asked_for(severity: float) -> None:
    page = tint(0, 0, 0, 0)
    page.cmyk[:, 350:, 3] = 240
    sigma_mm = 0.15 * (1 / 0.15) ** severity
    for seed in range(3):
        one = drawn(page, "local-blur", severity, seed)
        rows, columns = box(page, one.misprint.region_mm)
        assert columns.start < 350 < columns.stop
        across = (columns.stop - columns.start) * page.pixel_mm
        if across < 30 or min(350 - columns.start, columns.stop - 350) < (columns.stop - columns.start) / 2.5:
            continue
        height = rows.stop - rows.start
        middle = slice(rows.start + height // 3, rows.stop - height // 3)
        edge = one.page.cmyk[middle, columns, 3].mean(axis=0) / 240
        slope = np.diff(edge) / page.pixel_mm
        x = (np.arange(len(slope)) + 1) * page.pixel_mm
        mean = (x * slope).sum() / slope.sum()
        sd = np.sqrt(((x - mean) ** 2 * slope).sum() / slope.sum())
        assert sd == pytest.approx(sigma_mm, rel=0.06)
        assert mean == pytest.approx((350 - columns.start) * page.pixel_mm, abs=0.06)


def test_a_blur_keeps_the_ink_of_an_even_tint() -> None:
    page = tint(77, 3, 0, 255)
    for severity in (0.0, 1.0):
        np.testing.assert_array_equal(drawn(page, "local-blur", severity, 2).page.cmyk, page.cmyk)


@FEW
@given(seed=st.integers(0, 2**32), severity=st.floats(0, 1))
def test_missing_content_leaves_paper(seed: int, severity: float) -> None:
    page = noise_page(1, rows=300, columns=300)
    one = drawn(page, "missing-content", severity, seed)
    place = box(page, one.misprint.region_mm)
    assert not one.page.cmyk[place].any()
    size_mm = 4 * 20**severity
    _, _, width, height = one.misprint.region_mm
    tolerance = page.pixel_mm * (width + height) / 2 + 1e-6  # sides to the nearest pixel
    assert width * height == pytest.approx(size_mm**2, abs=tolerance)
    assert 0.5 - 0.2 < width / height < 2 + 0.3


# --- the wrong page, the right page off its place ---


def test_another_page_is_printed_from_the_same_corner() -> None:
    page = noise_page(1)
    one = next(draws(page, "wrong-page", 0.5, "instead", others=(2, 3)))
    other = fetch(int(one.misprint.detail.split()[1])).cmyk
    rows, columns = (min(a, b) for a, b in zip(page.cmyk.shape[:2], other.shape[:2], strict=True))
    np.testing.assert_array_equal(one.page.cmyk[:rows, :columns], other[:rows, :columns])
    assert not one.page.cmyk[rows:].any()
    assert not one.page.cmyk[:, columns:].any()
    assert one.misprint.region_mm == pytest.approx((0, 0, page.width_mm, page.height_mm), abs=0.001)


def test_another_page_of_another_resolution_keeps_its_size() -> None:
    page = Page(cmyk=np.zeros((100, 100, 4), np.uint8), dpi=50.8, name="p0001", number=1)
    cmyk = np.zeros((400, 400, 4), np.uint8)
    cmyk[40:80, 120:200, 1] = 255
    other = Page(cmyk=cmyk, dpi=203.2, name="p0002", number=2)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        one = draw_misprint(page, "wrong-page", 1.0, others=(2,), fetch=lambda _: other, rng=rng)
        if "instead" in one.misprint.detail:
            np.testing.assert_array_equal(one.page.cmyk, cmyk[2::4, 2::4])
            return
    raise AssertionError


@SEVERITY
def test_a_block_of_another_page_stands_where_it_stands_there(severity: float) -> None:
    page = noise_page(1)
    one = next(draws(page, "wrong-page", severity, "block of page", others=(2, 3)))
    other = np.zeros_like(page.cmyk)
    whole = fetch(int(one.misprint.detail.split()[-1])).cmyk[: len(page.cmyk), : page.cmyk.shape[1]]
    other[: len(whole), : whole.shape[1]] = whole
    place = box(page, one.misprint.region_mm)
    np.testing.assert_array_equal(one.page.cmyk[place], other[place])
    share = 1 / 6 + severity / 2
    assert one.misprint.region_mm[2] == pytest.approx(share * page.width_mm, abs=page.pixel_mm)


@SEVERITY
def test_a_page_off_its_place_is_printed_right(severity: float) -> None:
    page = noise_page(1)
    ways = set()
    for seed in range(12):
        one = drawn(page, "wrong-page", severity, seed)
        assert one.page.cmyk is page.cmyk
        assert one.placement is not IN_PLACE
        turned = "turned" in one.misprint.detail
        ways.add(turned)
        distance_mm = 1.8 * (12 / 1.8) ** severity
        if turned:
            assert abs(one.placement.skew_deg) == pytest.approx(0.3 * distance_mm / 1.8)
            assert one.placement.shift_mm == (0, 0)
        else:
            assert one.placement.skew_deg == 0
            assert np.hypot(*one.placement.shift_mm) == pytest.approx(distance_mm)
    assert ways == {True, False}
