"""Prediction against a plain NumPy reference: sixteen corners, dense weights, double precision."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.lib.stride_tricks import sliding_window_view

from prooflight.kernels.prediction.lookup import NODE_STEP, NODES
from prooflight.pages.lens_correction import LensCorrection
from prooflight.pages.raster import Page
from prooflight.prediction.predict import expected_light, predict
from prooflight.prediction.printed import PrintedPage
from prooflight.prediction.quantised_table import quantised_table
from prooflight.prediction.raster_light import FlatGroups, raster_light
from prooflight.scans.placement import IN_PLACE, Placement, Warp

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.prediction.tables import SensorModel
    from prooflight.press.artefact import Press
    from prooflight.scans.geometry import ScanGeometry

SINGLE_PRECISION_DN = 3e-3
"""A few hundred additions of up to 4000 DN in single precision, each good to 2e-4 DN, rounded at random."""
NEAREST_PHASE_DN = 1.2
"""Weights of the nearest phase err by up to 0.012 % of a step, and several may meet, 4500 DN in tables of random
tables (``sampling_grid.PHASES``)."""


@pytest.fixture(scope="module")
def odd_sensor(press: Press) -> SensorModel:
    """A sensor whose tables, columns and backing are all different and random."""
    rng = np.random.default_rng(3)
    shape = (NODES,) * 4
    return replace(
        press.sensors[0],
        mean_dn=rng.uniform(0, 3000, shape).astype(np.float32),
        variance_dn2=rng.uniform(5, 60, shape).astype(np.float32),
        column_offset_dn=rng.normal(3, 2, 400).astype(np.float32),
        column_gain=rng.normal(1, 0.05, 400).astype(np.float32),
        dark_variance_dn2=1.7,
        backing_dn=222.0,
        backing_variance_dn2=3.3,
        correction=LensCorrection.none(),
    )


@pytest.fixture(scope="module")
def even_sensor(press: Press) -> SensorModel:
    """The press's sensor with all columns alike, and its footprint all there is."""
    return replace(
        press.sensors[0],
        correction=LensCorrection.none(),
        column_offset_dn=np.zeros(400, np.float32),
        column_gain=np.ones(400, np.float32),
    )


def straight_warp() -> Warp:
    """A warp of the press world's size and slope, without a kink between its four nodes around the page."""
    nodes = np.random.default_rng(8).normal(0, 0.035, (2, 2, 2)).astype(np.float32)
    return Warp(nodes_mm=nodes, pitch_mm=40.0, first_mm=(-5.0, -15.0))


def page_of(cmyk: np.ndarray, dpi: float) -> Page:
    return Page(cmyk=np.ascontiguousarray(cmyk, np.uint8), dpi=dpi, name="p0001", number=1)


def flat_page(recipe: tuple[int, int, int, int], *, width_mm: float = 20.0, height_mm: float = 5.0) -> Page:
    rows, columns = round(height_mm * 300 / 25.4), round(width_mm * 300 / 25.4)
    return page_of(np.broadcast_to(np.array(recipe, np.uint8), (rows, columns, 4)), 300.0)


def sixteen_corners(table: np.ndarray, cmyk: np.ndarray) -> np.ndarray:
    """What the quantised table says of each recipe, in whole numbers but for the last step."""
    quantised = quantised_table(table)
    bits = quantised.bits.astype(np.int64)
    cell, fraction = np.divmod(cmyk.astype(np.int64), 256 >> bits)
    place = np.zeros(cmyk.shape[:-1], np.int64)
    for ink in (3, 2, 1, 0):
        place = (place << bits[ink]) + cell[..., ink]
    total = np.zeros_like(place)
    for corner in product((0, 1), repeat=4):
        weight = np.prod(np.where(np.array(corner) == 1, fraction, (256 >> bits) - fraction), axis=-1)
        c, m, y, k = corner
        total += weight * quantised.codes[place, 8 * k + 4 * y + 2 * m + c]
    return float(quantised.unit) * total.astype(np.float64) ** 2 - float(quantised.offset)


def dense_weights(
    cumulative: np.ndarray, reach_mm: float, centres_mm: np.ndarray, raster_mm: float, count: int
) -> np.ndarray:
    offsets = np.linspace(-reach_mm, reach_mm, cumulative.size)
    edges = np.arange(count + 1) * raster_mm
    return np.diff(np.interp(edges - centres_mm[:, None], offsets, cumulative), axis=1)


def reference(
    page: Page, sensor: SensorModel, geometry: ScanGeometry, placement: Placement
) -> tuple[np.ndarray, np.ndarray]:
    """The rows that each line sees at every raster column, then these across, all weights in double precision."""
    lines = geometry.lines(page.height_mm)
    rows, columns = page.cmyk.shape[:2]
    size = {"page_width_mm": page.width_mm, "page_height_mm": page.height_mm}
    y = geometry.centres_y_mm(lines)
    y_columns, column_mm = np.meshgrid(y, (np.arange(columns) + 0.5) * page.pixel_mm, indexing="ij")
    x = column_mm.copy()
    for _ in range(6):
        x += column_mm - placement.seen_mm(x, y_columns, **size)[0]
    seen_y = placement.seen_mm(x, y_columns, **size)[1]
    y_lines, x_lines = np.meshgrid(y, geometry.centres_x_mm(page.width_mm), indexing="ij")
    seen_x = placement.seen_mm(x_lines, y_lines, **size)[0]
    foot = sensor.footprint
    light = sixteen_corners(sensor.mean_dn, page.cmyk) - sensor.backing_dn
    noise = sixteen_corners(sensor.variance_dn2, page.cmyk) - sensor.backing_variance_dn2
    filtered = np.empty((2, lines, columns))
    for column in range(columns):
        along = dense_weights(foot.along, foot.reach_mm, seen_y[:, column], page.pixel_mm, rows)
        filtered[:, :, column] = along @ light[:, column], along @ noise[:, column]
    result = np.empty((2, lines, seen_x.shape[1]))
    for line in range(lines):
        across = dense_weights(foot.across, foot.reach_mm, seen_x[line], page.pixel_mm, columns)
        result[:, line] = filtered[:, line] @ across.T
    mean = result[0] + sensor.backing_dn
    variance = result[1] + sensor.backing_variance_dn2
    expected = np.clip(sensor.column_offset_dn + sensor.column_gain * mean, 0, sensor.top_code_dn)
    return expected, sensor.dark_variance_dn2 + sensor.column_gain * (variance - sensor.dark_variance_dn2)


def noise_page(dpi: float, *, width_mm: float = 30.0, height_mm: float = 12.0) -> Page:
    """The hardest page: every raster pixel another colour, and a black corner."""
    shape = (round(height_mm * dpi / 25.4), round(width_mm * dpi / 25.4), 4)
    cmyk = np.random.default_rng(4).integers(0, 256, shape)
    cmyk[: shape[0] // 2, : shape[1] // 2] = (0, 0, 0, 255)  # and runs of equal pixels
    return page_of(cmyk, dpi)


def assert_as_the_reference(
    page: Page, press: Press, sensor: SensorModel, placement: Placement, *, threads: int = 2
) -> None:
    got = predict(page, sensors=[sensor], geometry=press.geometry, placement=placement, threads=threads)
    expected, variance = reference(page, sensor, press.geometry, placement)
    assert got.expected_dn.shape == (1, *expected.shape)
    np.testing.assert_allclose(got.expected_dn[0], expected, atol=NEAREST_PHASE_DN)
    np.testing.assert_allclose(got.variance_dn2[0], variance, atol=NEAREST_PHASE_DN / 50)


@pytest.mark.parametrize("dpi", [72.0, 240.9, 300.0, 481.8, 700.0])
@pytest.mark.parametrize("shift_mm", [(0.0, 0.0), (0.37, -1.31)])
def test_against_the_reference(
    press: Press, odd_sensor: SensorModel, dpi: float, shift_mm: tuple[float, float]
) -> None:
    page = noise_page(dpi)
    assert press.geometry.lines(page.height_mm) > 128  # more than one band of lines
    assert_as_the_reference(page, press, odd_sensor, Placement(shift_mm=shift_mm))


@pytest.mark.parametrize("supersampling", [1, 2, 3])
def test_in_place_at_the_press_resolution_nothing_is_approximated(
    press: Press, odd_sensor: SensorModel, supersampling: int
) -> None:
    page = noise_page(press.geometry.raster_dpi(supersampling))
    expected, variance = reference(page, odd_sensor, press.geometry, IN_PLACE)
    got = predict(page, sensors=[odd_sensor], geometry=press.geometry)
    np.testing.assert_allclose(got.expected_dn[0], expected, atol=SINGLE_PRECISION_DN)
    np.testing.assert_allclose(got.variance_dn2[0], variance, atol=SINGLE_PRECISION_DN)


@pytest.mark.parametrize("dpi", [240.984, 300.0, 481.968])
@pytest.mark.parametrize(
    "placement",
    [
        Placement(skew_deg=0.1),
        Placement(skew_deg=-1.0, shift_mm=(0.5, -0.8)),
        Placement(stretch_percent=(0.05, -0.04), shift_mm=(-0.2, 0.1)),
        Placement(skew_deg=0.05, stretch_percent=(-0.3, 0.2)),
        Placement(skew_deg=0.03, warp=straight_warp()),
    ],
    ids=["skew", "a degree", "stretch", "skew and stretch", "warp"],
)
def test_a_page_off_its_place_against_the_reference(
    press: Press, odd_sensor: SensorModel, dpi: float, placement: Placement
) -> None:
    assert_as_the_reference(noise_page(dpi), press, odd_sensor, placement)


@settings(max_examples=15)
@given(
    seed=st.integers(0, 10**6),
    rows=st.integers(1, 40),
    columns=st.integers(1, 40),
    dpi=st.floats(30, 900),
    shift_mm=st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
    skew_deg=st.sampled_from([0.0, 0.2, -1.5]),
    stretch_percent=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
)
def test_against_the_reference_on_any_page(
    press: Press,
    odd_sensor: SensorModel,
    seed: int,
    rows: int,
    columns: int,
    dpi: float,
    shift_mm: tuple[float, float],
    skew_deg: float,
    stretch_percent: tuple[float, float],
) -> None:
    cmyk = np.random.default_rng(seed).integers(0, 256, (rows, columns, 4))
    placement = Placement(shift_mm=shift_mm, skew_deg=skew_deg, stretch_percent=stretch_percent)
    assert_as_the_reference(page_of(cmyk, dpi), press, odd_sensor, placement, threads=1)


@pytest.mark.parametrize("moved", [(3, 0), (0, 5), (-7, 4)])
def test_a_shift_by_raster_pixels_is_the_raster_moved(
    press: Press, even_sensor: SensorModel, moved: tuple[int, int]
) -> None:
    dpi = press.geometry.raster_dpi(2)
    cmyk = np.zeros((300, 500, 4), np.uint8)
    cmyk[60:-60, 60:-60] = np.random.default_rng(5).integers(0, 256, (180, 380, 4))
    page = page_of(cmyk, dpi)
    there = page_of(np.roll(cmyk, (moved[1], moved[0]), axis=(0, 1)), dpi)
    shift = Placement(shift_mm=(moved[0] * page.pixel_mm, moved[1] * page.pixel_mm))
    by_placement = predict(page, sensors=[even_sensor], geometry=press.geometry, placement=shift)
    by_raster = predict(there, sensors=[even_sensor], geometry=press.geometry)
    lines, columns = press.geometry.on_page(page.width_mm, page.height_mm)
    inside = (0, slice(lines.start + 12, lines.stop - 12), slice(columns.start + 12, columns.stop - 12))
    np.testing.assert_allclose(
        by_placement.expected_dn[inside], by_raster.expected_dn[inside], atol=SINGLE_PRECISION_DN
    )


@pytest.mark.parametrize("placement", [Placement(shift_mm=(0.1, -0.2)), Placement(skew_deg=0.2)])
@pytest.mark.parametrize(
    "planes",
    [[(1, -2), (0, 0), (-3, 1), (0, 2)], [(0, 30), (0, 0), (-25, 0), (0, 0)]],
    ids=["near", "beyond"],
)
def test_planes_that_lie_apart_are_predicted_as_of_the_raster_composed(
    press: Press, odd_sensor: SensorModel, placement: Placement, planes: list[tuple[int, int]]
) -> None:
    cmyk = np.random.default_rng(6).integers(0, 256, (24, 21, 4))
    cmyk[10:15] = cmyk[:2] = cmyk[10]  # rows that are alike, which are looked up once
    printed = PrintedPage(page=page_of(cmyk, 300.0), planes=np.array(planes))
    how = {"sensors": [odd_sensor], "geometry": press.geometry, "placement": placement, "threads": 1}
    by_rows = predict(printed, **how)
    composed = predict(printed.composed(), **how)
    np.testing.assert_array_equal(by_rows.expected_dn, composed.expected_dn)
    np.testing.assert_array_equal(by_rows.variance_dn2, composed.variance_dn2)
    assert (composed.expected_dn != predict(printed.page, **how).expected_dn).any()


def blocks_page() -> Page:
    """Return a page with large areas of one recipe, some up to its edges, and a last group that is not whole."""
    cmyk = np.zeros((90, 150, 4), np.uint8)
    cmyk[20:70, 30:100] = (0, 120, 40, 0)
    cmyk[50:, 64:140, 3] = 200
    cmyk[:9, :60, 0] = 255
    return page_of(cmyk, 300.0)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("planes", [[[0, 0], [2, -1], [-2, 2], [1, 0]], [[0, 4], [0, 0], [0, 0], [0, 0]]])
def test_flat_areas_are_predicted_as_all_others(
    press: Press, odd_sensor: SensorModel, planes: list[list[int]], threads: int
) -> None:
    """Planes that are displaced further than the flat groups' reach are among them."""
    page = blocks_page()
    flat = FlatGroups.of(page, 2)
    assert 0 < flat.flat.mean() < 1
    printed, sensors = PrintedPage(page=page, planes=np.array(planes)), [odd_sensor]
    raster = raster_light(printed, sensors=sensors, flat=flat)
    for placement in (Placement(skew_deg=0.3), Placement(skew_deg=-1.0, shift_mm=(-0.4, 0.3))):
        by_groups, composed = (
            predict(
                seen,
                sensors=sensors,
                geometry=press.geometry,
                placement=placement,
                raster=light,
                threads=threads,
            )
            for seen, light in ((printed, raster), (printed.composed(), None))
        )
        np.testing.assert_allclose(by_groups.expected_dn, composed.expected_dn, atol=SINGLE_PRECISION_DN)
        np.testing.assert_allclose(by_groups.variance_dn2, composed.variance_dn2, atol=SINGLE_PRECISION_DN)


@pytest.mark.parametrize("reach", [1, 3, 20])
def test_groups_are_flat_where_no_other_recipe_is_near(reach: int) -> None:
    """One row further, some that might be flat are not, since changes along rows and down are marked together."""
    page = blocks_page()

    def alike(within: int) -> NDArray[np.bool_]:
        around = np.pad(page.packed, within)  # beyond the page is no ink
        near = sliding_window_view(around, (2 * within + 1, 16 + 2 * within))[:, ::16]
        return np.asarray((near == near[..., :1, :1]).all(axis=(2, 3)))

    flat = FlatGroups.of(page, reach).flat
    assert not (flat & ~alike(reach)).any()
    assert not (alike(reach + 1) & ~flat).any()


def test_a_line_on_a_turned_page_is_seen_where_the_placement_says(
    press: Press, even_sensor: SensorModel
) -> None:
    """A closed form apart from prediction's own two passes: the centre of gravity of a thin line, along the travel."""
    page = flat_page((0, 0, 0, 0), width_mm=30.0, height_mm=20.0)
    row = 100
    ink = page.cmyk.copy()
    ink[row] = (0, 0, 0, 255)
    placement = Placement(skew_deg=0.7, shift_mm=(0.03, -0.21), stretch_percent=(0.02, -0.1))
    bare, lined = (
        predict(replace(page, cmyk=cmyk), sensors=[even_sensor], geometry=press.geometry, placement=placement)
        for cmyk in (page.cmyk, ink)
    )
    missing = (bare.expected_dn - lined.expected_dn)[0].astype(np.float64)
    y = press.geometry.centres_y_mm(missing.shape[0])
    x = press.geometry.centres_x_mm(page.width_mm)
    columns = np.flatnonzero((x > 2) & (x < page.width_mm - 2))
    seen = (y @ missing)[columns] / missing.sum(axis=0)[columns]
    on_page = placement.seen_mm(x[columns], seen, page_width_mm=page.width_mm, page_height_mm=page.height_mm)[
        1
    ]
    # the raster's own pixels are 0.8 of the camera's: within its aperture a line's weight changes a little
    np.testing.assert_allclose(
        on_page, (row + 0.5) * page.pixel_mm, atol=0.02 * press.geometry.pixel_pitch_mm
    )


def test_threads_do_not_change_a_bit(page: Page, two_sensor_press: Press) -> None:
    one, three = (
        predict(page, sensors=two_sensor_press.sensors, geometry=two_sensor_press.geometry, threads=n)
        for n in (1, 3)
    )
    np.testing.assert_array_equal(one.expected_dn, three.expected_dn)
    np.testing.assert_array_equal(one.variance_dn2, three.variance_dn2)


def test_each_sensor_is_predicted_from_its_own_tables(page: Page, two_sensor_press: Press) -> None:
    both = predict(page, sensors=two_sensor_press.sensors, geometry=two_sensor_press.geometry)
    for index, sensor in enumerate(two_sensor_press.sensors):
        alone = predict(page, sensors=[sensor], geometry=two_sensor_press.geometry)
        np.testing.assert_array_equal(both.expected_dn[index], alone.expected_dn[0])
    assert (both.expected_dn[0] != both.expected_dn[1]).any()


def at_solids(table: np.ndarray, solid: tuple[bool, ...]) -> float:
    """The table where each ink is bare or solid, 255, which lies an eighth before its last node."""
    for one in solid:
        table = table[-1] + (table[-2] - table[-1]) / 8 if one else table[0]
    return float(table)


@given(st.tuples(*[st.booleans()] * 4))
def test_bare_and_solid_inks_give_the_table_itself(
    press: Press, odd_sensor: SensorModel, solid: tuple[bool, bool, bool, bool]
) -> None:
    """To half a code of a root: 3000 DN 1.5 / 32767, if fitted nodes reach 1.5 times as high as the table."""
    cyan, magenta, yellow, black = (255 * ink for ink in solid)
    page = flat_page((cyan, magenta, yellow, black))
    got = predict(page, sensors=[odd_sensor], geometry=press.geometry)
    inside = (slice(25, 60), slice(120, 280))
    gain, offset = odd_sensor.column_gain[120:280], odd_sensor.column_offset_dn[120:280]
    want = np.clip(offset + gain * at_solids(odd_sensor.mean_dn, solid), 0, 4095)
    np.testing.assert_allclose(got.expected_dn[0][inside], np.broadcast_to(want, (35, 160)), atol=0.15)
    dark = odd_sensor.dark_variance_dn2
    want = dark + gain * (at_solids(odd_sensor.variance_dn2, solid) - dark)
    np.testing.assert_allclose(got.variance_dn2[0][inside], np.broadcast_to(want, (35, 160)), atol=0.01)


@pytest.mark.parametrize("ink", range(4))
def test_every_ink_is_looked_up_on_its_own_axis(press: Press, even_sensor: SensorModel, ink: int) -> None:
    # a table that depends on one ink only: 100 DN a node
    axis = [1, 1, 1, 1]
    axis[ink] = NODES
    ramp = np.broadcast_to(np.arange(NODES).reshape(axis) * 100.0, (NODES,) * 4).astype(np.float32)
    sensor = replace(even_sensor, mean_dn=ramp)
    recipe = [7, 99, 201, 50]
    recipe[ink] = 120
    got = predict(
        flat_page((recipe[0], recipe[1], recipe[2], recipe[3])), sensors=[sensor], geometry=press.geometry
    )
    # its root is not straight: within a cell of 8 to 32 bytes it errs by a few DN
    assert got.expected_dn[0, 40, 200] == pytest.approx(120 / NODE_STEP * 100, abs=5)


def test_an_edge_is_a_mean_of_signals_and_not_the_signal_of_half_the_ink(
    press: Press, even_sensor: SensorModel
) -> None:
    # 802 raster pixels of a quarter camera pixel, centred in 400: the page starts at 99.75 camera pixels,
    # and black at 200.5, the centre of camera pixel 200
    cmyk = np.zeros((200, 802, 4))
    cmyk[:, 403:, 3] = 255
    page = page_of(cmyk, 25.4 * 4 / press.geometry.pixel_pitch_mm)
    row = predict(page, sensors=[even_sensor], geometry=press.geometry).expected_dn[0, 45]
    white, black = row[150], row[250]
    assert row[200] == pytest.approx((white + black) / 2, abs=SINGLE_PRECISION_DN)
    assert row[199] + row[201] == pytest.approx(white + black, abs=SINGLE_PRECISION_DN)
    half_ink = predict(flat_page((0, 0, 0, 128)), sensors=[even_sensor], geometry=press.geometry)
    assert abs(row[200] - half_ink.expected_dn[0, 40, 200]) > 300  # far from each other in this press


@pytest.mark.parametrize("steps", [(1, 0), (0, 1), (-3, 2), (5, -7)])
def test_a_shift_by_whole_camera_pixels_shifts_the_prediction(
    press: Press, even_sensor: SensorModel, page: Page, steps: tuple[int, int]
) -> None:
    geometry = press.geometry
    shift_mm = (steps[0] * geometry.pixel_pitch_mm, steps[1] * geometry.line_pitch_mm)
    still, moved = (
        predict(
            page, sensors=[even_sensor], geometry=geometry, placement=Placement(shift_mm=shift)
        ).expected_dn[0]
        for shift in ((0.0, 0.0), shift_mm)
    )
    margin = 8
    lines, pixels = still.shape
    core = still[margin : lines - margin, margin : pixels - margin]
    rows = slice(margin + steps[1], lines - margin + steps[1])
    columns = slice(margin + steps[0], pixels - margin + steps[0])
    # weights are differences of places on the page, good to 1e-7 of a pixel in single precision
    np.testing.assert_allclose(moved[rows, columns], core, atol=0.01)


def test_a_positive_shift_moves_the_page_right_and_down(press: Press, even_sensor: SensorModel) -> None:
    page = flat_page((0, 0, 0, 0), width_mm=10.0, height_mm=5.0)
    still, moved = (
        predict(
            page, sensors=[even_sensor], geometry=press.geometry, placement=Placement(shift_mm=shift)
        ).expected_dn[0]
        for shift in ((0.0, 0.0), (1.0, 0.5))
    )

    def middle(image: np.ndarray) -> np.ndarray:
        paper = np.argwhere(image > 1500)
        return (paper.min(axis=0) + paper.max(axis=0)) / 2

    down, right = (middle(moved) - middle(still)) * press.geometry.pixel_pitch_mm
    assert right == pytest.approx(1.0, abs=0.06)  # half a camera pixel
    assert down == pytest.approx(0.5, abs=0.06)


def test_beyond_the_page_is_backing(press: Press, odd_sensor: SensorModel) -> None:
    page = flat_page((200, 10, 30, 90), width_mm=10.0, height_mm=5.0)
    got = predict(page, sensors=[odd_sensor], geometry=press.geometry)
    geometry = press.geometry
    x, y = geometry.centres_x_mm(page.width_mm), geometry.centres_y_mm(got.expected_dn.shape[1])
    reach = odd_sensor.footprint.reach_mm
    beyond = (x < -reach) | (x > page.width_mm + reach)
    above = (y < -reach) | (y > page.height_mm + reach)
    assert beyond.any()
    assert above.any()
    backing = odd_sensor.column_offset_dn + odd_sensor.column_gain * np.float32(222.0)
    np.testing.assert_allclose(
        got.expected_dn[0][:, beyond],
        np.broadcast_to(backing[beyond], (y.size, beyond.sum())),
        atol=SINGLE_PRECISION_DN,
    )
    np.testing.assert_allclose(
        got.expected_dn[0][above], np.broadcast_to(backing, (above.sum(), 400)), atol=SINGLE_PRECISION_DN
    )


def test_expected_numbers_stay_within_the_converters_codes(press: Press, odd_sensor: SensorModel) -> None:
    bright = replace(odd_sensor, column_gain=np.linspace(0.2, 9, 400).astype(np.float32), top_code_dn=1023)
    dark = replace(odd_sensor, column_offset_dn=np.full(400, -9000, np.float32))
    for sensor, limit in ((bright, 1023), (dark, 0)):
        got = predict(flat_page((40, 0, 0, 0)), sensors=[sensor], geometry=press.geometry)
        assert got.expected_dn.min() >= 0
        assert got.expected_dn.max() <= 1023
        assert (got.expected_dn == limit).any()


def test_the_page_is_not_changed(press: Press, make_page: Callable[..., Page]) -> None:
    page = make_page(9, width_mm=10, height_mm=6)
    kept = page.cmyk.copy()
    predict(page, sensors=press.sensors, geometry=press.geometry)
    np.testing.assert_array_equal(page.cmyk, kept)


def test_recipes_are_looked_up_above_the_backing(even_sensor: SensorModel) -> None:
    """Shot noise: the variance lies on a line over the mean, and so does the backing's; at nodes both are exact."""
    mean = even_sensor.mean_dn
    shot = replace(
        even_sensor,
        variance_dn2=(np.float32(4) + np.float32(0.5) * mean).astype(np.float32),
        backing_dn=300.0,
        backing_variance_dn2=4 + 0.5 * 300,
    )
    recipes = np.array([[0, 0, 0, 0], [8, 64, 128, 200], [248, 0, 16, 0]], np.uint8)
    nodes = tuple((recipes // NODE_STEP).T)
    for sensor in (
        shot,
        replace(shot, variance_dn2=np.sqrt(mean) + 1),
    ):  # the other is no line: it is looked up
        found, variance = expected_light(recipes, sensor)
        assert found == pytest.approx(sensor.mean_dn[nodes], rel=2e-3)
        assert variance == pytest.approx(sensor.variance_dn2[nodes], rel=2e-3)
