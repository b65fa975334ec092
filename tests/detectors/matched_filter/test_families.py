"""Statistics of sums that are drawn, on a map of 96 x 64 tiles: what is put in is said, where it is, as its sort."""

from __future__ import annotations

import numpy as np
import pytest

from prooflight.detectors.matched_filter.naming import kind_of
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    LINE_MODES,
    MODES,
    SEGMENTS,
    Scatter,
    Sums,
)
from prooflight.detectors.matched_filter.statistics.located import (
    of_boxes,
    of_energy,
    of_ghosts,
    of_streaks,
    of_waves,
    waves_of,
)
from prooflight.detectors.matched_filter.statistics.page_scale import extremes_of, flat_part, swapped_planes
from prooflight.detectors.matched_filter.statistics.statistic import (
    FLAT_AREAS,
    GOOD_PRINTS,
    OWN_PAGE,
    Reference,
)

ROWS, COLUMNS, TILE_MM = 96, 64, 0.5
PIXELS = 2 * COLUMNS
POWER = 40.0


def drawn(seed: int, *, of_edges: float = 0.0) -> Sums:
    """Nothing but noise: every tile has the same information of every mode, a share of it from edges."""
    rng = np.random.default_rng(seed)
    modes = len(MODES) + 1
    tiles = np.zeros((4, modes, ROWS, COLUMNS), np.float32)
    tiles[0] = rng.standard_normal((modes, ROWS, COLUMNS)) * np.sqrt(POWER)
    tiles[1] = POWER
    tiles[3] = of_edges * POWER
    tiles[0, -1] = rng.chisquare(4, (ROWS, COLUMNS))
    tiles[1, -1] = 4
    columns = np.zeros((4, LINE_MODES, SEGMENTS, PIXELS), np.float32)
    columns[0] = rng.standard_normal((LINE_MODES, SEGMENTS, PIXELS)) * np.sqrt(POWER)
    columns[1] = POWER
    return Sums(
        tiles=tiles,
        columns=columns,
        flat_columns=columns.copy(),
        cover=rng.random((4, ROWS, COLUMNS)).astype(np.float32),
        shifts=np.zeros((4, 4)),
        tile_mm=TILE_MM,
        pixel_mm=TILE_MM / 2,
        left_mm=-1.0,
        top_mm=-2.0,
    )


def test_a_spot_is_said_where_it_is() -> None:
    sums = drawn(1)
    k = MODES.index("add-K")
    sums.tiles[0, k, 40:44, 20:24] += 8 * np.sqrt(POWER)
    best = max(of_boxes(flat_part(sums), Scatter.white(), FLAT_AREAS), key=lambda one: one.value)
    assert best.statistic[:4] == ("box", "add", "K", "+")
    assert best.statistic.reference is FLAT_AREAS
    assert kind_of(best.statistic) == "spots-voids"
    x, y, width, height = best.box
    middle = (22 * TILE_MM - 1.0, 42 * TILE_MM - 2.0)
    assert (x + width / 2, y + height / 2) == pytest.approx(middle, abs=1.0)


def test_edges_are_left_out_of_what_is_flat() -> None:
    sums = drawn(2)
    sums.tiles[3, :, :, :32] = 0.5 * POWER
    sums.tiles[0, :, 40:44, 10:14] += 30 * np.sqrt(POWER)
    flat = flat_part(sums)
    assert not flat.tiles[..., :32].any()
    assert max(one.value for one in of_boxes(flat, Scatter.white(), FLAT_AREAS)) < 7  # of 10^5 normal numbers
    assert max(one.value for one in of_boxes(sums, Scatter.white(), GOOD_PRINTS)) > 30


def test_a_page_is_judged_by_its_own_scatter() -> None:
    rng = np.random.default_rng(3)
    own = (5 * rng.standard_normal((200, 200)) * np.sqrt(POWER)).astype(np.float32)
    own[100, 70] = 100 * np.sqrt(POWER)
    maps = np.stack([own, np.full_like(own, POWER), np.zeros_like(own)])
    found = extremes_of(maps[:, None], np.array([[1.0, 1.0, 0.0]]), overlap=1)[0]
    assert found.high == pytest.approx(100, rel=1e-3)
    assert found.own_high == pytest.approx(20, rel=0.1)  # the scatter is known by bins of a tenth
    assert found.places[0].tolist() == found.places[2].tolist() == [100, 70]
    assert found.own_low == pytest.approx(-own[own < 0].std(), abs=20)
    assert 3 < -found.own_low < 6


def test_nothing_informed_says_nothing() -> None:
    none = np.zeros((3, 10, 10), np.float32)
    found = extremes_of(none[:, None], np.array([[1.0, 1.0, 0.0]]), overlap=4)[0]
    assert (found.high, found.low, found.own_high, found.own_low, found.energy) == (0, 0, 0, 0, 0)


@pytest.mark.parametrize("reference", [GOOD_PRINTS, OWN_PAGE])
def test_a_streak_is_said_where_it_is(reference: Reference) -> None:
    sums = drawn(4)
    sums.columns[0, MODES.index("add-C"), :, 60:62] += 9 * np.sqrt(POWER)
    statistics = list(of_streaks(sums, Scatter.white(), GOOD_PRINTS, OWN_PAGE))
    best = max((one for one in statistics if one.statistic.reference is reference), key=lambda one: one.value)
    assert (best.statistic.mode, best.statistic.ink) == ("add", "C")
    assert kind_of(best.statistic) == "streak"
    assert best.box[0] + best.box[2] / 2 == pytest.approx(61 * TILE_MM / 2 - 1.0, abs=0.5)
    assert best.box[3] == pytest.approx(ROWS * TILE_MM)


def test_waves_rise_above_their_neighbours() -> None:
    sums = drawn(5)
    wave = 2.0 * np.sqrt(POWER) * np.sin(2 * np.pi * np.arange(ROWS) * TILE_MM / 6.0)
    sums.tiles[0, MODES.index("gain-all")] += wave[:, None].astype(np.float32)
    statistics = {one.statistic.key: one for one in of_waves(waves_of(sums, Scatter.white()), OWN_PAGE)}
    best = max(statistics.values(), key=lambda one: one.value)
    assert best.statistic.mode == "gain-all"
    assert kind_of(best.statistic) == "banding"
    assert best.value > 5 * statistics["wave/void/one"].value


def test_an_echo_of_the_page_is_said() -> None:
    sums = drawn(6)
    detail = sums.cover[0] - sums.cover[0].mean()
    sums.tiles[0, MODES.index("add-C"), 20:] += 0.6 * POWER * detail[:-20]
    scatters = Scatter.white().ghosts
    statistics = list(of_ghosts(sums, scatters, GOOD_PRINTS, OWN_PAGE))
    for reference in (GOOD_PRINTS, OWN_PAGE):
        best = max(
            (one for one in statistics if one.statistic.reference is reference), key=lambda one: one.value
        )
        assert best.statistic.ink == "C"
        assert kind_of(best.statistic) == "ghost-smear"
        assert best.value > 8


def test_stray_energy_is_said_where_it_is() -> None:
    sums = drawn(7)
    sums.tiles[0, -1, 64:72, 16:24] += 12
    statistics = {one.statistic.key: one for one in of_energy(sums)}
    best = statistics["excess/8"]
    assert best.value > 8
    assert best.box == pytest.approx((16 * TILE_MM - 1.0, 64 * TILE_MM - 2.0, 4.0, 4.0))


def test_swapped_inks_show_in_their_pair_alone() -> None:
    sums = drawn(8)
    step = sums.cover[1] - sums.cover[0]
    for ink, sign in ((0, 1), (1, -1)):
        for mode in (1 + ink, 5 + ink):
            sums.tiles[0, mode] += sign * 0.1 * step * POWER
    t = np.abs(swapped_planes(sums))
    assert t[0] > 5
    assert t[0] > 2 * t[5]  # yellow and black
