"""A defect of one amount in a rectangle has that rectangle for its extent."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from prooflight.detectors.matched_filter.extents import Extent, extended, extent_of
from prooflight.detectors.matched_filter.statistics.local_evidence import MODES, SEGMENTS, Sums
from prooflight.detectors.matched_filter.statistics.statistic import NOWHERE, Observed, Statistic
from prooflight.detectors.print_prior import PrintPrior

TILES, COLUMNS = (60, 40), 200
NO_GAINS = np.zeros((4, 3))


def sums_of(
    mode: str,
    *,
    tiles: tuple[slice, slice] | None = None,
    columns: tuple[slice, slice] | None = None,
    amount: float = 0.5,
    noise: float = 1.0,
) -> Sums:
    """Sums of a page of 20 x 30 mm, on which a mode has an amount in some tiles, or in segments of columns."""
    rng, power = np.random.default_rng(5), 100.0
    grids = np.zeros((4, len(MODES) + 1, *TILES)), np.zeros((4, 10, SEGMENTS, COLUMNS))
    for grid, place in zip(grids, (tiles, columns), strict=True):
        grid[0] = noise * np.sqrt(power) * rng.standard_normal(grid[0].shape)
        grid[1] = power
        if place is not None:
            grid[0, MODES.index(mode)][place] += amount * power
    return Sums(
        tiles=grids[0].astype(np.float32),
        columns=grids[1].astype(np.float32),
        flat_columns=grids[1].astype(np.float32),
        cover=np.zeros((4, *TILES), np.float32),
        shifts=np.zeros((4, 4)),
        tile_mm=0.5,
        pixel_mm=0.1,
        left_mm=-3.0,
        top_mm=-2.0,
        prior=PrintPrior(),
        column_gains=np.zeros((1, COLUMNS), np.float32),
    )


def extent(*arguments: Any) -> Extent:
    found = extent_of(*arguments)
    assert found is not None
    return found


@pytest.mark.parametrize("seed", [(5.0, 9.0, 1.0, 1.0), (4.0, 6.0, 8.0, 8.0), (-3.0, -2.0, 20.0, 30.0)])
def test_a_block_is_found_from_a_part_of_it_and_from_more_than_it(seed: tuple[float, ...]) -> None:
    sums = sums_of("void", tiles=(slice(20, 30), slice(14, 26)))
    found = extent("missing-content", [seed], sums, NO_GAINS)
    assert found.box == (4.0, 8.0, 6.0, 5.0)
    # The standard error of 120 cells of power 100 is 0.009.
    assert found.amount == pytest.approx(0.5, abs=0.03)


def test_gaps_that_know_nothing_end_no_block() -> None:
    sums = sums_of("void", tiles=(slice(20, 40), slice(14, 26)))
    sums.tiles[:, :, 24:28] = 0.0
    assert extent("missing-content", [(5.0, 9.0, 1.0, 1.0)], sums, NO_GAINS).box == (4.0, 8.0, 6.0, 10.0)


def test_a_streak_has_its_width_and_ends_within_a_segment() -> None:
    sums = sums_of("gain-K", columns=(slice(4, 12), slice(90, 95)), amount=-0.5)
    height_mm = 30.0 / SEGMENTS
    sums.columns[0, MODES.index("gain-K"), 3, 90:95] -= 25.0  # half of the segment before
    x, y, width, height = extent("streak", [(6.2, 9.0, 0.3, 1.0)], sums, NO_GAINS).box
    # The level about it takes 5 columns of 240 from a streak, and noise of 500 a segment is 9 % of its amount.
    assert (x, width) == pytest.approx((6.0, 0.5))
    assert y == pytest.approx(-2.0 + 3.5 * height_mm, abs=0.5)
    assert y + height == pytest.approx(-2.0 + 12 * height_mm, abs=0.5)


def test_an_ink_that_faded_on_the_whole_page_is_missing_there_although_the_fit_has_followed_it() -> None:
    gains = np.zeros((4, 3))
    gains[0, 0] = -0.4
    found = extent("missing-plane", [], sums_of("gain-C", noise=0.3), gains)
    assert found.box == (-3.0, -2.0, 20.0, 30.0)
    assert found.amount == pytest.approx(-0.4, abs=0.01)


def test_a_kind_that_only_adds_ink_has_no_place_where_ink_is_missing() -> None:
    sums = sums_of("add-C", tiles=(slice(20, 30), slice(14, 26)), amount=-0.5, noise=0.0)
    assert extent_of("scum", [(5.0, 9.0, 1.0, 1.0)], sums, NO_GAINS) is None
    assert extent_of("banding", [(5.0, 9.0, 1.0, 1.0)], sums, NO_GAINS) is None


def test_places_of_one_defect_all_have_its_extent() -> None:
    sums = sums_of("blur", tiles=(slice(20, 30), slice(14, 26)))
    mark = Observed(statistic=Statistic.parse("mark/text+/4"), value=9.0, box=(5.0, 9.0, 1.0, 1.0))
    fit = Observed(statistic=Statistic.parse("fit/gain-C"), value=7.0, box=NOWHERE)
    found = extended("local-blur", [("fit", fit), ("mark", mark), ("none", fit)], sums, NO_GAINS)
    assert [one.box for _, one in found[:2]] == [(4.0, 8.0, 6.0, 5.0)] * 2
    assert found[2][1].box is NOWHERE
    assert [one.value for _, one in found] == [7.0, 9.0, 7.0]


def test_a_streak_is_where_its_statistic_is_and_not_beside_it_where_clouds_are_more_likely() -> None:
    sums = sums_of("void", columns=(slice(0, SEGMENTS), slice(90, 92)), amount=0.5)
    sums.columns[0, MODES.index("add-K"), :, 93:120] += 60.0
    window, block = (5.9, -2.0, 0.3, 30.0), (5.0, 9.0, 1.5, 1.5)
    assert extent("streak", [window, block], sums, NO_GAINS).box[::2] == pytest.approx((6.0, 0.2))
