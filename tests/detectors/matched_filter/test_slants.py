"""Lines at every slope: sums along them are those of the lines, and a line that is drawn is found where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.detectors.matched_filter.test_families import TILE_MM, drawn

from prooflight.detectors.matched_filter.statistics.boxes import cells_of
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, Scatter, Sums
from prooflight.detectors.matched_filter.statistics.slants import (
    HEIGHTS,
    MOST,
    STEEPEST,
    lines_of,
    of_slants,
    scatter_about,
    tile_contributions,
)
from prooflight.detectors.matched_filter.statistics.statistic import OWN_PAGE, Observed, Statistic
from prooflight.detectors.print_prior import PrintPrior
from prooflight.kernels.statistics.streaks import slanted

SEED = 20261123
WHITE = np.array([1.0, 1.0, 0.0])


def columns_of(slope: int, height: int) -> list[int]:
    """How far right a dyadic line is in each of its rows: the lower half is set off by half of what it leans."""
    if height == 1:
        return [0]
    half = columns_of(slope // 2, height // 2)
    return half + [(slope + 1) // 2 + one for one in half]


@pytest.mark.parametrize("height", [2, 16, 64])
def test_a_line_is_one_pixel_a_row_and_leans_as_it_says(height: int) -> None:
    for slope in range(height):
        at = np.array(columns_of(slope, height))
        assert at[0] == 0
        assert at[-1] == slope
        # Brady (1998): no further from the straight line than log2(height) / 6 on average, and a log2 at most.
        assert np.abs(at - slope * np.arange(height) / (height - 1)).max() <= max(np.log2(height) / 2, 0.5)


def t_of(n: NDArray[np.float64], d: NDArray[np.float64], most_of_half: float) -> float:
    """T of a line from its halves' (2,) sums."""
    if n[0] * n[1] <= 0:
        return 0.0
    halves, whole = n**2 / d, n.sum() ** 2 / d.sum()
    return float(np.sign(n[0]) * np.sqrt(min(whole, most_of_half * halves.min())))


@pytest.mark.parametrize("most_of_half", [2.5, 1e9])
def test_sums_along_lines_are_those_of_the_lines(most_of_half: float) -> None:
    rng = np.random.default_rng([SEED, 1])
    push = rng.standard_normal((128, 37)).astype(np.float32)
    power = rng.uniform(0.1, 2, push.shape).astype(np.float32)
    levels, tallest = 2, 32
    values = np.empty((levels, tallest, 2), np.float32)
    places = np.empty((levels, tallest, 2, 2), np.int64)
    slanted(push, power, False, 16, np.array([4, 8]), 1e-3, most_of_half, values, places)
    for level, height in enumerate((16, 32)):
        assert (values[level, : height // 4] == 0).all()
        assert (values[level, height:] == 0).all()
        for slope in range(height // 4, height):
            at = columns_of(slope, height)
            t = {}
            for strip in range(len(push) // height):
                for x in range(push.shape[1] - slope):
                    rows = strip * height + np.arange(height)
                    n, d = (
                        one[rows, x + np.array(at)].astype(float).reshape(2, -1).sum(1)
                        for one in (push, power)
                    )
                    t[strip, x] = t_of(n, d, most_of_half)
            most, least = max(t, key=lambda one: t[one]), min(t, key=lambda one: t[one])
            assert values[level, slope] == pytest.approx([t[most], -t[least]], rel=1e-4)
            assert places[level, slope].tolist() == [list(most), list(least)]


@pytest.mark.parametrize("height", [0, 3, 24])
def test_heights_that_do_not_fit_are_refused(height: int) -> None:
    tiles, values = np.zeros((64, 8), np.float32), np.empty((2, 32, 2), np.float32)
    with pytest.raises(ValueError, match="slanted"):
        slanted(
            tiles, tiles, False, height, np.array([2, 4]), 1.0, 4.0, values, np.empty((2, 32, 2, 2), np.int64)
        )


def test_on_noise_lines_say_no_more_than_the_number_of_lines_allows() -> None:
    """The greatest of m independent normal numbers exceeds sqrt(2 ln m) + 1 hardly ever: lines here are fewer."""
    rng = np.random.default_rng([SEED, 2])
    push = rng.standard_normal((256, 200)).astype(np.float32)
    lines = lines_of(push, np.ones_like(push))
    for level, height in enumerate(HEIGHTS):
        count = 4 * (256 // height) * 256 * height
        most = lines.values[:, level].max()
        assert 3 < most < np.sqrt(2 * np.log(count)) + 1


def test_a_tile_counts_up_to_its_most_and_no_information_counts_nothing() -> None:
    rng = np.random.default_rng([SEED, 3])
    power = np.full((64, 64), 50, np.float32)
    own = (rng.standard_normal(power.shape) * np.sqrt(power)).astype(np.float32)
    own[5, 5], power[7, 7], own[7, 7] = 1e6, 0, 1e6
    push, known = tile_contributions(own, power, np.zeros_like(power), WHITE)
    assert known[5, 5] == pytest.approx(50)
    assert push[5, 5] == pytest.approx(MOST * np.sqrt(50))
    assert push[7, 7] == known[7, 7] == 0


def test_a_page_that_scatters_more_by_itself_says_so_much_less() -> None:
    rng = np.random.default_rng([SEED, 4])
    power = np.full((64, 64), 50, np.float32)
    own = (rng.standard_normal(power.shape) * np.sqrt(power)).astype(np.float32)
    once, thrice = (
        tile_contributions(times * own, power, np.zeros_like(power), WHITE)[0] for times in (1, 3)
    )
    # The scale is that below which 68 % of |t| lie, as interpolated: of 1024 numbers, the same but for rounding.
    np.testing.assert_allclose(thrice, once, rtol=1e-3)


def test_a_part_that_scatters_more_says_no_more_and_a_line_across_it_still_tells() -> None:
    """As where a photograph is: four times the scatter in a third of the page."""
    rng = np.random.default_rng([SEED, 5])
    power = np.full((192, 160), 50, np.float32)
    own = (rng.standard_normal(power.shape) * np.sqrt(power)).astype(np.float32)
    own[64:128] *= 4
    lined = own.copy()
    for row in range(64):
        lined[64 + row, 40 + row // 2] += 6 * np.sqrt(50)  # one and a half standard deviations there
    none = np.zeros_like(power)
    most, with_one = (
        lines_of(*tile_contributions(each, power, none, WHITE)).values.max() for each in (own, lined)
    )
    whole = lines_of(*tile_contributions(own[:64], power[:64], none[:64], WHITE)).values.max()
    assert most < whole + 1.5
    assert with_one > most + 3


def test_a_line_hardly_raises_the_scatter_about_it() -> None:
    rng = np.random.default_rng([SEED, 6])
    t = rng.standard_normal((128, 128)).astype(np.float32)
    known = np.ones_like(t, np.bool_)
    lined = t.copy()
    lined[np.arange(128), np.arange(128)] += 5
    assert scatter_about(t, known).mean() == pytest.approx(1.02, abs=0.03)
    assert (scatter_about(lined, known) / scatter_about(t, known)).max() < 1.3
    assert scatter_about(3 * t, known)[16:-16, 16:-16].mean() == pytest.approx(2.8, abs=0.15)
    assert (scatter_about(3 * t * 0, known & False) == 1).all()


def with_line(mode: str, amount: float, cells: list[tuple[int, int]]) -> Sums:
    """Noise, and an amount of a mode in some tiles."""
    sums = drawn(SEED)
    tiles, at = sums.tiles.copy(), MODES.index(mode)
    for row, column in cells:
        tiles[0, at, row, column] += amount * tiles[1, at, row, column]
    return replace(sums, tiles=tiles, prior=PrintPrior())


def said(sums: Sums) -> dict[Statistic, Observed]:
    scatter = Scatter.white()
    cells = next(cells_of(sums, scatter.light))
    return {one.statistic: one for one in of_slants(sums, cells, scatter)}


LEANS = {
    "right": [(16 + row, 12 + round(0.4 * row)) for row in range(32)],
    "left": [(16 + row, 40 - round(0.4 * row)) for row in range(32)],
    "right, flat": [(20 + round(0.4 * step), 16 + step) for step in range(32)],
    "left, flat": [(60 - round(0.4 * step), 16 + step) for step in range(32)],
}


@pytest.mark.parametrize(("mode", "sign"), [("void", "+"), ("add-K", "-")])
@pytest.mark.parametrize("lean", LEANS)
def test_a_line_is_found_where_it_is(mode: str, sign: str, lean: str) -> None:
    """16 tiles of 3.5 standard deviations each, of which their own part in the scatter about them takes a tenth."""
    cells = LEANS[lean]
    amount = 3.5 / np.sqrt(40.0) * (1 if sign == "+" else -1)
    found, without = said(with_line(mode, amount, cells)), said(with_line(mode, 0, cells))
    family, _, ink = mode.partition("-")
    which = Statistic("slant", family, ink, sign, 16)
    assert found[which].value > 9 > without[which].value + 3
    other = which._replace(sign="-" if sign == "+" else "+")
    assert found[other].value == pytest.approx(without[other].value, abs=1)
    assert found[which._replace(reference=OWN_PAGE)].value > 4
    rows, columns = np.array(cells).T * TILE_MM
    x, y, width, height = found[which].box
    left, top = drawn(SEED).left_mm, drawn(SEED).top_mm
    assert columns.min() - 1 <= x - left <= x - left + width <= columns.max() + 2
    assert rows.min() - 1 <= y - top <= y - top + height <= rows.max() + 2


def test_a_blank_page_says_nothing() -> None:
    sums = drawn(SEED)
    assert {one.value for one in said(replace(sums, tiles=sums.tiles * 0)).values()} == {0.0}


def test_lines_nearer_to_the_sides_are_left_to_streaks() -> None:
    nothing: NDArray[np.float32] = np.zeros((64, 64), np.float32)
    push = nothing.copy()
    push[:, 30] = 10
    lines = lines_of(push, nothing + 1)
    upright = 10 * 64 / 8
    assert lines.values.max() < upright * np.sqrt(1 / (STEEPEST * 64)) * 2
