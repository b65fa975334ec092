"""Statistics of sums that are drawn, on a map of 96 x 64 tiles: what is put in is said, where it is, as its sort."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from prooflight.cmyk import INK_LETTERS
from prooflight.detectors.matched_filter.fit.beat import RowBeats
from prooflight.detectors.matched_filter.naming import kind_of
from prooflight.detectors.matched_filter.statistics.boxes import smallest_cells
from prooflight.detectors.matched_filter.statistics.local_evidence import (
    LINE_MODES,
    MODES,
    SEGMENTS,
    UNEVEN_MM,
    Scatter,
    Sums,
    rows,
)
from prooflight.detectors.matched_filter.statistics.located import (
    of_boxes,
    of_energy,
    of_ghosts,
    of_steps,
    of_streaks,
    of_waves,
    waves_of,
)
from prooflight.detectors.matched_filter.statistics.page_scale import (
    BLOCK_TILES,
    extremes_of,
    flat_part,
    gain_steps,
    swapped_planes,
)
from prooflight.detectors.matched_filter.statistics.statistic import (
    FLAT_AREAS,
    GOOD_PRINTS,
    OWN_PAGE,
    Observed,
    Reference,
)
from prooflight.detectors.print_prior import PrintPrior

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
    columns = np.zeros((4, len(LINE_MODES), SEGMENTS, PIXELS), np.float32)
    columns[0] = rng.standard_normal((len(LINE_MODES), SEGMENTS, PIXELS)) * np.sqrt(POWER)
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
        prior=PrintPrior(),
        column_gains=np.zeros((1, PIXELS), np.float32),
    )


def boxes_of(sums: Sums, reference: Reference) -> list[Observed]:
    scatter = Scatter.white()
    return list(of_boxes(sums, smallest_cells(sums, scatter.light), scatter, reference))


def test_a_spot_is_said_where_it_is() -> None:
    sums = drawn(1)
    k = MODES.index("add-K")
    sums.tiles[0, k, 40:44, 20:24] += 8 * np.sqrt(POWER)
    best = max(boxes_of(flat_part(sums), FLAT_AREAS), key=lambda one: one.value)
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
    assert max(one.value for one in boxes_of(flat, FLAT_AREAS)) < 7  # of 10^5 normal numbers
    assert max(one.value for one in boxes_of(sums, GOOD_PRINTS)) > 30


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


LIGHT_POWER, INK_POWER = 1e6, 1e4
"""Of paper, and of what little ink there is: a tenth of paper's signal, wherever it stands."""


def lit_columns(ink_in: slice, brighter: slice, by: float) -> Sums:
    """No noise: ink in some segments of every column, and light that is ``by`` brighter in some of one column."""
    sums = drawn(9)
    void = LINE_MODES.index("void")
    sums.columns[:] = 0
    sums.columns[1, 0] = LIGHT_POWER
    sums.columns[1, void, ink_in] = INK_POWER
    sums.columns[2, void, ink_in] = np.sqrt(LIGHT_POWER * INK_POWER)
    sums.columns[0, 0, brighter, 60] = by * LIGHT_POWER
    sums.columns[0, void, brighter, 60] = by * sums.columns[2, void, brighter, 60]
    return sums


def greatest_void(sums: Sums) -> float:
    found = [one for one in of_streaks(sums, Scatter.white(), GOOD_PRINTS) if one.statistic.mode == "void"]
    return max(one.value for one in found if one.statistic.part == "full")


def test_ink_that_stands_where_paper_is_brighter_is_not_gone() -> None:
    """In one segment alone, so that taking out what light does in the whole column leaves most of it."""
    sums, place = lit_columns(slice(2, 3), slice(2, 3), by := 2 * PrintPrior().place), PrintPrior().place
    apart = 1 - 1 / SEGMENTS
    noise = by * apart * np.sqrt(LIGHT_POWER)  # T, were light even
    uneven = noise / np.sqrt(1 + place**2 * apart**2 * LIGHT_POWER)
    assert noise > 4
    assert greatest_void(sums) == pytest.approx(uneven, rel=0.1)
    assert uneven < 2


def test_ink_that_is_gone_all_down_a_column_still_is_where_paper_is_even() -> None:
    sums, void = lit_columns(slice(0, SEGMENTS), slice(0, 0), 0.0), LINE_MODES.index("void")
    sums.columns[2, void] = 0  # and beside light, not instead of it
    sums.columns[0, void, :, 60] = 0.1 * INK_POWER
    assert greatest_void(sums) == pytest.approx(0.1 * np.sqrt(SEGMENTS * INK_POWER), rel=0.1)


def test_rows_of_little_ink_say_little_where_light_differs_along_them() -> None:
    sums, void, place = drawn(9), MODES.index("void"), PrintPrior().place
    sums.tiles[:] = 0
    sums.tiles[1, 0] = LIGHT_POWER
    sums.tiles[1, void, :, :4] = INK_POWER
    sums.tiles[2, void, :, :4] = np.sqrt(LIGHT_POWER * INK_POWER)
    parts = [round(UNEVEN_MM / TILE_MM), COLUMNS - round(UNEVEN_MM / TILE_MM)]  # ink is in the first
    shared, light = 4 * np.sqrt(LIGHT_POWER * INK_POWER), COLUMNS * LIGHT_POWER
    power = 4 * INK_POWER - shared**2 / light
    uneven = 2 * (place * shared * parts[1] / COLUMNS) ** 2  # as much more in the one as less in the other
    np.testing.assert_allclose(rows(sums)[1, void], power**2 / (power + uneven), rtol=5e-3)
    assert uneven > 8 * power
    sums.tiles[1, void] = INK_POWER
    sums.tiles[2, void] = 0
    np.testing.assert_allclose(rows(sums)[1, void], COLUMNS * INK_POWER, rtol=1e-4)


def test_waves_rise_above_their_neighbours() -> None:
    sums = drawn(5)
    wave = 2.0 * np.sqrt(POWER) * np.sin(2 * np.pi * np.arange(ROWS) * TILE_MM / 6.0)
    sums.tiles[0, MODES.index("gain-all")] += wave[:, None].astype(np.float32)
    statistics = {one.statistic.key: one for one in of_waves(waves_of(sums, Scatter.white()), OWN_PAGE)}
    best = max(statistics.values(), key=lambda one: one.value)
    assert best.statistic.mode == "gain-all"
    assert kind_of(best.statistic) == "banding"
    assert best.value > 5 * statistics["wave/void/one"].value


def test_a_screens_own_wave_is_expected_and_a_stronger_one_is_not() -> None:
    """A tint's light waves by 5 %: as much is no banding where the screen is known, ten times as much is."""
    void, beat = MODES.index("void"), 0.05
    tint = np.full((1, 4), 0.5, np.float32)
    known = RowBeats(tints=tint, wave=np.array([beat], np.float32), sd=np.array([beat / 2**0.5], np.float32))

    def greatest(times: float, of: RowBeats | None) -> float:
        sums = drawn(5)
        sums.tiles[2, void], sums.cover[:] = 0.5 * POWER, 0.5
        sums.tiles[1, 0] = 1.0  # so little that light as a whole takes nothing of it
        wave = times * beat * np.sin(2 * np.pi * np.arange(ROWS) * TILE_MM / 6.0)
        sums.tiles[0, void] += 0.5 * POWER * wave[:, None].astype(np.float32)
        waves = waves_of(replace(sums, row_beats=of), Scatter.white())
        return max(float(one.waves.max()) for one in waves if one.mode == "void")

    alone = greatest(0.0, None)
    assert greatest(1.0, None) > 5 * alone
    assert greatest(1.0, known) < alone
    assert greatest(10.0, known) > 5 * alone


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


# --- inks off in a part of the page: 6 x 4 blocks of 256 tiles, so that a block knows a gain to 1 % ---

OF_A_BLOCK = BLOCK_TILES**2 * POWER


def stepped(ink: str, by: float, *, rows: int = ROWS, columns: int = COLUMNS) -> Sums:
    """No noise: the ink's gain is ``by`` in the first rows and columns, and 0 in the others."""
    sums = drawn(9)
    sums.tiles[0] = 0
    sums.tiles[0, MODES.index(f"gain-{ink}"), :rows, :columns] = by * POWER
    return sums


@pytest.mark.parametrize(
    ("by", "columns", "blocks"), [(0.01, 32, 12), (0.04, 32, 12), (-0.04, 16, 6), (0.04, 48, 18)]
)
def test_a_gain_that_differs_between_two_parts_is_so_many_deviations(
    by: float, columns: int, blocks: int
) -> None:
    """By its own formula: blocks scatter about the page's mean by the step itself, and good pages by 1 %."""
    across, along = gain_steps(stepped("M", by, columns=columns))[INK_LETTERS.index("M")]
    mean = by * blocks / 24
    squares = np.repeat([(by - mean) ** 2, mean**2], [blocks, 24 - blocks]) * OF_A_BLOCK
    doubt = max(np.median(squares) / 0.455, 1)
    variance = doubt * (1 / blocks + 1 / (24 - blocks)) / OF_A_BLOCK + 0.01**2
    assert across.t == pytest.approx(abs(by) / np.sqrt(variance), rel=1e-4)
    assert across.at == columns / COLUMNS
    assert along.t == pytest.approx(0, abs=1e-3)


def test_a_page_whose_inks_are_even_has_no_step() -> None:
    """Every ink 5 % off all over; and noise alone, seed 9: the greatest of 16 looks at what is normal of 1 or less."""
    even = drawn(9)
    even.tiles[0] = 0.05 * POWER
    assert np.array([step.t for both in gain_steps(even) for step in both]) == pytest.approx(
        np.zeros(8), abs=1e-3
    )
    assert max(step.t for both in gain_steps(drawn(9)) for step in both) < 3.5


def test_light_that_differs_between_two_parts_is_no_inks_step() -> None:
    """An ink's gain looks by 0.8 like a change of light, which is 4 % brighter on the left: taken out with it.

    Blocks know of the light a thousand times what they do above, so that they know it, and not good pages, say what it
    does.
    """
    sums, light, power = drawn(9), 0.04, 1000 * POWER
    sums.tiles[0] = 0
    sums.tiles[1] = power
    for mode in (MODES.index(f"gain-{ink}") for ink in INK_LETTERS):
        sums.tiles[2, mode] = 0.8 * power
        sums.tiles[0, mode, :, :32] = 0.8 * light * power
    without = max(across.t for across, _ in gain_steps(sums))
    sums.tiles[0, 0, :, :32] = light * power
    found = max(across.t for across, _ in gain_steps(sums))
    assert without > 2
    assert found < 0.1 * without


def test_of_a_page_of_few_tiles_or_little_ink_nothing_is_said_of_parts() -> None:
    small = stepped("C", 0.1, columns=16)
    tiles = small.tiles[..., : 2 * BLOCK_TILES - 1]
    for sums in (replace(small, tiles=tiles), replace(small, tiles=small.tiles * 0)):
        assert [(across.t, along.t) for across, along in gain_steps(sums)] == [(0, 0)] * 4


@pytest.mark.parametrize(
    ("rows", "columns", "part", "box"),
    [
        (ROWS, 32, "across", (-1.0, -2.0, 16.0, 48.0)),
        (ROWS, 48, "across", (23.0, -2.0, 8.0, 48.0)),
        (16, COLUMNS, "along", (-1.0, -2.0, 32.0, 8.0)),
        (64, COLUMNS, "along", (-1.0, 30.0, 32.0, 16.0)),
    ],
)
def test_a_step_is_said_of_the_smaller_part(
    rows: int, columns: int, part: str, box: tuple[float, ...]
) -> None:
    found = {
        (one.statistic.ink, one.statistic.part): one
        for one in of_steps(stepped("K", -0.05, rows=rows, columns=columns))
    }
    assert set(found) == {(ink, way) for ink in INK_LETTERS for way in ("across", "along")}
    best = max(found.values(), key=lambda one: one.value)
    assert best is found["K", part]
    assert best.statistic[:3] == ("step", "gain", "K")
    assert best.box == pytest.approx(box)
    assert kind_of(best.statistic) == "density"
