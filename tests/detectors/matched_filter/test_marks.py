"""Small windows by class of place: their sums, classes, spread, and the floor."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.detectors.matched_filter.statistics.marks import (
    BORDER_MM,
    FLOOR_AREA_MM2,
    PLACE_CLASSES,
    REACH,
    classify,
    measure_marks,
)
from prooflight.kernels.statistics.marks import (
    CLASSES,
    LEAST_T,
    NOT_INSPECTED,
    SIZES,
    WINDOWS,
    window_extremes,
)
from prooflight.scans.geometry import ScanGeometry

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.detectors.matched_filter.statistics.marks import Marks

PIXEL_MM = 0.25
WHITE = 1000.0
SHAPE = 210, 200


def geometry() -> ScanGeometry:
    return ScanGeometry(
        pixels=SHAPE[1], pixel_pitch_mm=PIXEL_MM, line_pitch_mm=PIXEL_MM, lead_in_mm=0.0, lead_out_mm=0.0
    )


def measured(
    left: NDArray[np.float32],
    *,
    light: NDArray[np.float32] | None = None,
    sd: float = 10.0,
    inside: NDArray[np.bool_] | None = None,
    floor_share: float = 0.1,
    specks: NDArray[np.float32] | None = None,
    threads: int = 1,
) -> Marks:
    """What windows of residuals (sensors, lines, pixels) [DN] of so much noise say, of a blank page unless told."""
    sensors, *shape = left.shape
    inside = np.ones(shape, bool) if inside is None else inside
    light = np.full(left.shape, WHITE, np.float32) if light is None else light
    weight = np.where(inside, np.float32(1 / sd**2), 0).astype(np.float32) * np.ones_like(left)
    one = SimpleNamespace(white_dn=WHITE, column_gain=np.ones(shape[1]))
    alike: Any = [one] * sensors
    return measure_marks(
        alike,
        inside,
        light,
        left,
        weight,
        geometry=geometry(),
        page_width_mm=SHAPE[1] * PIXEL_MM,
        tolerance=0.003,
        specks=np.zeros(SIZES, np.float32) if specks is None else specks,
        floor_share=floor_share,
        threads=threads,
    )


def noise(seed: int, sensors: int = 1, sd: float = 10.0) -> NDArray[np.float32]:
    return np.random.default_rng(seed).normal(0, sd, (sensors, *SHAPE)).astype(np.float32)


def brute_force(
    left: NDArray[np.float32], weight: NDArray[np.float32], light: NDArray[np.float32], tolerance: float
) -> NDArray[np.float64]:
    """Greatest T of both signs over all windows of each size, (sizes, 2)."""
    push, power = (one.astype(np.float64) for one in (left * weight * light, weight * light**2))
    if len(left) > 1:
        push, power = (np.concatenate([one, one.sum(axis=0)[None]]) for one in (push, power))
    found = []
    for side in WINDOWS:
        n, d = (
            np.lib.stride_tricks.sliding_window_view(one, (side, side), axis=(1, 2)).sum(axis=(-2, -1))
            for one in (push, power)
        )
        t = n / np.sqrt(d + (tolerance * d) ** 2)
        found.append([t.max(), -t.min()])
    return np.array(found)


@pytest.mark.parametrize("sensors", [1, 2, 3])
def test_windows_are_what_sums_over_squares_give(sensors: int) -> None:
    rng = np.random.default_rng(sensors)
    left = rng.normal(0, 10, (sensors, 160, 60)).astype(np.float32)
    weight = rng.uniform(0.005, 0.02, left.shape).astype(np.float32)
    light = rng.uniform(300, 1000, left.shape).astype(np.float32)
    places, specks = np.zeros((SIZES, 160, 60), np.uint8), np.zeros(SIZES, np.float32)
    for parts in ([(0, 160)], [(0, 64), (64, 128), (128, 160)]):
        most = np.zeros((len(parts), CLASSES, SIZES, 2))
        at = np.zeros((len(parts), CLASSES, SIZES, 2, 2), np.int64)
        beyond = np.zeros((len(parts), CLASSES, SIZES), np.int64)
        for n, part in enumerate(parts):
            window_extremes(
                left, weight, light, places, np.float32(0.003**2), specks, *part, most[n], at[n], beyond[n]
            )
        asked = brute_force(left, weight, light, 0.003)
        found = np.sqrt(most.max(axis=0)[0])
        seen = asked >= LEAST_T
        np.testing.assert_allclose(found[seen], asked[seen], rtol=1e-3)
        assert (found[~seen] == 0).all()


def test_a_window_that_is_lighter_has_the_t_of_its_amount() -> None:
    """A relative change a over k x k pixels of relative noise s has T = a k / sqrt(s^2 + t^2 k^2)."""
    left = np.zeros((1, *SHAPE), np.float32)
    left[0, 80:84, 100:104] = 0.05 * WHITE
    marks = measured(left, floor_share=0.0)
    bare, size = PLACE_CLASSES.index("bare"), WINDOWS.index(4)
    expected = 0.05 * 4 / np.sqrt(0.01**2 + (0.003 * 4) ** 2)
    assert marks.greatest[bare, size, 0] == pytest.approx(expected, rel=1e-4)
    assert marks.at[bare, size, 0].tolist() == [80, 100]
    observed = {one.statistic.key: one for one in marks.statistics()}
    assert observed["mark/bare+/4"].box == pytest.approx(
        (100 * PIXEL_MM, 80 * PIXEL_MM, 4 * PIXEL_MM, 4 * PIXEL_MM)
    )
    assert observed["mark/bare-/4"].value < observed["mark/bare+/4"].value


def test_threads_change_nothing() -> None:
    left = noise(5, sensors=2)
    one, several = measured(left), measured(left, threads=3)
    np.testing.assert_array_equal(one.greatest, several.greatest)
    np.testing.assert_array_equal(one.at, several.at)


def half_solid() -> NDArray[np.float32]:
    """A page whose right half is dark."""
    light = np.full((1, *SHAPE), WHITE, np.float32)
    light[:, :, 100:] = 0.2 * WHITE
    return light


def test_places_have_the_class_that_the_prediction_gives_them() -> None:
    light = half_solid()
    white = np.full((1, SHAPE[1]), WHITE, np.float32)
    inside = np.ones(SHAPE, bool)
    inside[:, :10] = False
    places = classify(light, white, inside, pixel_mm=PIXEL_MM)
    small, large = places.of_windows[0], places.of_windows[SIZES - 1]
    middle = SHAPE[0] // 2
    border = round(BORDER_MM / PIXEL_MM)
    assert small[middle, 5] == NOT_INSPECTED
    assert small[middle, 10 + border - 1] == PLACE_CLASSES.index("border")
    assert small[middle, 10 + border] == PLACE_CLASSES.index("bare")
    # The slope is seen from the pixels beside the step, as far as REACH and half a window away.
    assert small[middle, 99 - REACH] == PLACE_CLASSES.index("text")
    assert small[middle, 98 - REACH] == PLACE_CLASSES.index("bare")
    assert large[middle, 99 - REACH - 4] == PLACE_CLASSES.index("text")
    assert small[middle, 140] == PLACE_CLASSES.index("flat")
    assert places.flat[middle, 98 - REACH] == 1
    assert places.flat[middle, 99 - REACH] == 0
    assert places.areas.sum() == SIZES * inside.sum()


def test_edges_of_a_design_are_edges_in_the_border_too_where_asked() -> None:
    """The sheet's own edge, at which light falls to the backing outside, is none of the design's."""
    light, white = half_solid(), np.full((1, SHAPE[1]), WHITE, np.float32)
    light[:, :, :8] = 0
    inside = np.ones(SHAPE, bool)
    inside[:, :10] = False
    text, border = PLACE_CLASSES.index("text"), PLACE_CLASSES.index("border")
    usual, asked = (
        classify(light, white, inside, pixel_mm=PIXEL_MM, edges_in_border=asked).of_windows[0]
        for asked in (False, True)
    )
    assert usual[1, 99] == border
    assert asked[1, 99] == text
    assert asked[1, 50] == asked[SHAPE[0] // 2, 11] == border
    np.testing.assert_array_equal(usual[50:-50, 50:-50], asked[50:-50, 50:-50])


def test_what_edges_do_does_not_hide_what_lies_on_bare_paper() -> None:
    """Edges that are off ten times as much as stated widen their own class alone (seed 7)."""
    light, left = half_solid(), noise(7)
    left[:, :, 97:103] *= 10
    left[0, 60:62, 40:42] -= 0.1 * WHITE
    marks = measured(left, light=light, floor_share=0.0)
    bare, text = PLACE_CLASSES.index("bare"), PLACE_CLASSES.index("text")
    assert marks.spread[bare].max() < 1.05
    assert marks.spread[text, 0] > 3
    observed = {one.statistic.key: one.value for one in marks.statistics()}
    assert observed["mark/bare-/2"] > 15
    assert observed["mark/text-/1"] < 10


def test_few_places_are_not_expected_to_deviate_as_far_as_many() -> None:
    """The same T says more where fewer windows could have had it."""
    left = np.zeros((1, *SHAPE), np.float32)
    left[0, 80, 100] = 0.06 * WHITE
    few = np.zeros(SHAPE, bool)
    few[60:100, 80:120] = True
    many = {one.statistic.key: one.value for one in measured(left).statistics()}["mark/bare+/1"]
    fewer = {one.statistic.key: one.value for one in measured(left, inside=few).statistics()}["mark/bare+/1"]
    assert fewer > many + 0.5


def spot(pixels: int, share: float, at: tuple[int, int] = (80, 40)) -> NDArray[np.float32]:
    left = np.zeros((1, *SHAPE), np.float32)
    left[0, at[0], at[1] : at[1] + pixels] = -share * WHITE
    return left


@pytest.mark.parametrize(
    ("pixels", "share", "alarms"), [(3, 0.11, True), (2, 0.9, False), (40, 0.09, False), (3, -0.11, True)]
)
def test_the_floor_is_a_share_of_white_over_an_area(pixels: int, share: float, alarms: bool) -> None:
    """Two pixels of 0.25 mm are 0.125 mm2; one more is asked for, lest their outline be smaller than 0.1 mm2."""
    assert 2 * PIXEL_MM**2 >= FLOOR_AREA_MM2 > PIXEL_MM**2
    floor = measured(spot(pixels, share)).floor
    assert floor.alarms is alarms
    if alarms:
        assert floor.box == pytest.approx((40 * PIXEL_MM, 80 * PIXEL_MM, pixels * PIXEL_MM, PIXEL_MM))
        assert floor.darker is (share > 0)


def test_the_floor_leaves_edges_and_noise_alone() -> None:
    assert measured(spot(6, 0.5, at=(80, 97)), light=half_solid()).floor.area_mm2 == 0
    assert measured(spot(6, 0.5, at=(80, 80)), light=half_solid()).floor.alarms
    assert measured(noise(11, sd=60.0), sd=60.0).floor.area_mm2 == 0  # 10 % is 1.7 sigma of this camera
    assert not measured(spot(6, 0.5), floor_share=0.0).floor.alarms


def test_what_is_not_inspected_says_nothing() -> None:
    inside = np.ones(SHAPE, bool)
    inside[70:90, 30:60] = False
    marks = measured(spot(6, 0.9), inside=inside)
    assert marks.floor.area_mm2 == 0
    assert marks.greatest.max() == LEAST_T


def test_lines_that_nobody_saw_have_no_windows_by_rounding() -> None:
    """Every window that reaches into seen lines deviates, and none that does not, whatever sliding sums leave."""
    lines, pixels, seen = 120, 90, 41
    rng = np.random.default_rng(8)
    residual = rng.uniform(300, 500, (2, lines, pixels)).astype(np.float32)
    light = rng.uniform(1000, 3000, (2, lines, pixels)).astype(np.float32)
    weight = np.full((2, lines, pixels), 1 / 200, np.float32)
    weight[:, seen:] = 0
    places = np.ones((SIZES, lines, pixels), np.uint8)
    most, at = np.zeros((CLASSES, SIZES, 2)), np.zeros((CLASSES, SIZES, 2, 2), np.int64)
    beyond = np.zeros((CLASSES, SIZES), np.int64)
    window_extremes(
        residual,
        weight,
        light,
        places,
        np.float32(0),
        np.zeros(SIZES, np.float32),
        0,
        lines,
        most,
        at,
        beyond,
    )
    for size, side in enumerate(WINDOWS):
        assert beyond[1, size] == 3 * seen * (pixels - side + 1)  # of two sensors, and of both together
    assert (at[1, :, 0, 0] < seen).all()


def test_a_darker_window_counts_by_what_exceeds_a_speck() -> None:
    """A window that is darker by 5 % has the T of 3 % where specks may take 2 %; a lighter one keeps its own."""
    specks = np.zeros(SIZES, np.float32)
    size = WINDOWS.index(4)
    specks[size] = 0.02
    bare, deviations = PLACE_CLASSES.index("bare"), []
    for share in (-0.05, -0.03, 0.05):
        left = np.zeros((1, *SHAPE), np.float32)
        left[0, 80:84, 100:104] = share * WHITE
        sign = 0 if share > 0 else 1
        asked = measured(left, floor_share=0.0, specks=specks if share in (-0.05, 0.05) else None)
        deviations.append(asked.greatest[bare, size, sign])
    assert deviations[0] == pytest.approx(deviations[1], rel=1e-4)
    assert deviations[2] == pytest.approx(deviations[1] * 5 / 3, rel=1e-4)


def test_the_spread_of_a_page_does_not_depend_on_specks() -> None:
    """What good noise does is counted as it is (seed 4)."""
    specks = np.full(SIZES, 0.05, np.float32)
    left = noise(4)
    np.testing.assert_array_equal(measured(left, specks=specks).spread, measured(left).spread)


@pytest.mark.parametrize(("pixels", "share", "alarms"), [(3, 0.15, False), (3, 0.25, True), (9, 0.15, True)])
def test_no_speck_reaches_the_floor(pixels: int, share: float, alarms: bool) -> None:
    """Specks take up to 20 % of 0.2 mm2, four pixels of 0.25 mm: darker is a misprint, and so is larger."""
    specks = np.array(
        [0.2, *(0.2 * min(0.2 / (side * PIXEL_MM) ** 2, 1) for side in WINDOWS[1:])], np.float32
    )
    assert measured(spot(pixels, share), specks=specks).floor.alarms is alarms
    assert measured(spot(3, -0.15), specks=specks).floor.alarms


def test_columns_of_different_gain_make_no_edge() -> None:
    """The light of bare paper and of a tint, seen by columns that differ by 2 %, is flat (seed 3)."""
    gain = np.random.default_rng(3).normal(1, 0.02, SHAPE[1]).astype(np.float32)
    white = WHITE * gain[None]
    light = np.tile(0.6 * white[:, None], (1, SHAPE[0], 1)).astype(np.float32)
    places = classify(light, white, np.ones(SHAPE, bool), pixel_mm=PIXEL_MM)
    assert set(np.unique(places.of_windows)) == {PLACE_CLASSES.index("flat"), PLACE_CLASSES.index("border")}


def test_a_light_tint_is_compared_with_bare_paper() -> None:
    white = np.full((1, SHAPE[1]), WHITE, np.float32)
    middle = SHAPE[0] // 2, SHAPE[1] // 2
    for share, place in ((0.95, "bare"), (0.86, "bare"), (0.8, "flat")):
        light = np.full((1, *SHAPE), share * WHITE, np.float32)
        places = classify(light, white, np.ones(SHAPE, bool), pixel_mm=PIXEL_MM)
        assert PLACE_CLASSES[places.of_windows[0][middle]] == place


def test_edges_that_do_not_show_in_the_light_are_edges() -> None:
    white, light = np.full((1, SHAPE[1]), WHITE, np.float32), np.full((1, *SHAPE), 0.5 * WHITE, np.float32)
    hidden = np.zeros((1, *SHAPE), np.float32)
    hidden[0, :, 100] = (0.2 * WHITE) ** 2
    places = classify(light, white, np.ones(SHAPE, bool), pixel_mm=PIXEL_MM, hidden=hidden)
    middle = SHAPE[0] // 2
    assert PLACE_CLASSES[places.of_windows[0][middle, 100]] == "text"
    assert PLACE_CLASSES[places.of_windows[0][middle, 103 + REACH]] == "flat"
    assert places.flat[middle, 100] == 0
