"""Nuisances for judging: each does what it says to a print that is otherwise the same, to the last bit."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.camera.camera import respond
from prooflight.pages.raster import Page
from prooflight.prediction.sampling_grid import sampling_grid
from prooflight.rng import stream
from prooflight.scans.geometry import ScanGeometry
from prooflight.scans.placement import IN_PLACE, Placement, Warp
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.worlds import Amounts
from prooflight_studies.stress.nuisances import (
    AgeingLamp,
    DeadColumn,
    Dust,
    Formation,
    LightRipple,
    LooserPress,
    Nuisance,
    Passing,
    PatchyTables,
    SheetTexture,
    ShowThrough,
    WebWobble,
    finer,
    multiplied,
    tilted,
)
from prooflight_studies.stress.rows import stressed

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.press.artefact import Press
    from prooflight.press.press_file import PressFile

NOTHING = [
    Formation(what="", rms_percent=0.0, grain_mm=2.0, where="sheet"),
    LightRipple(what="", amplitude_percent=0.0, period_lines=20.0),
    WebWobble(what="", amplitude_mm=0.0, period_mm=20.0),
    ShowThrough(what="", amplitude_percent=0.0, blur_mm=1.0),
    Dust(what="", columns=2, loss_percent=0.0),
    DeadColumn(what="", columns=1, loss_percent=0.0),
    LooserPress(what="", times=1.0),
    PatchyTables(what="", times=1.0),
    AgeingLamp(what="", tilt_percent=0.0),
]
OF_LIGHT = [
    Formation(what="", rms_percent=2.0, grain_mm=2.0, where="sheet"),
    LightRipple(what="", amplitude_percent=2.0, period_lines=20.0),
    ShowThrough(what="", amplitude_percent=3.0, blur_mm=1.0),
    Dust(what="", columns=2, loss_percent=3.0),
    DeadColumn(what="", columns=1, loss_percent=40.0),
]


def kind(nuisance: Nuisance) -> str:
    return type(nuisance).__name__


@pytest.fixture(scope="module")
def pages(make_page: Callable[..., Page]) -> list[Page]:
    return [make_page(20 + number, number=1 + number, height_mm=24.0) for number in range(2)]


@pytest.fixture(scope="module")
def day(two_sensor_press: Press) -> SimulatedDay:
    return SimulatedDay.begin("press", two_sensor_press, stream(1, "session"))


@pytest.fixture
def under(day: SimulatedDay, pages: list[Page], two_sensor_file: PressFile) -> Callable[..., SimulatedDay]:
    def make(nuisance: Nuisance, seed: int = 1) -> SimulatedDay:
        return stressed(
            day,
            nuisance,
            rng=stream(seed, "stress-day", 1, 0),
            others=(0, 1),
            fetch=pages.__getitem__,
            press_file=two_sensor_file,
        )

    return make


def scanned(day: SimulatedDay, page: Page) -> NDArray[np.uint16]:
    rng = stream(3, "print", 0)
    return day.recorded(day.seen(day.good(page), rng), rng)


@pytest.mark.parametrize("nuisance", NOTHING, ids=kind)
def test_a_nuisance_of_nothing_leaves_every_bit(
    nuisance: Nuisance, day: SimulatedDay, under: Callable[..., SimulatedDay], pages: list[Page]
) -> None:
    assert np.array_equal(scanned(under(nuisance), pages[0]), scanned(day, pages[0]))


@pytest.mark.parametrize("nuisance", OF_LIGHT, ids=kind)
def test_light_takes_a_factor_and_all_else_stays(
    nuisance: Nuisance, day: SimulatedDay, under: Callable[..., SimulatedDay], pages: list[Page]
) -> None:
    """Light and variance without rounding's go by one factor; the print's generator ends where it always does."""
    seen, rngs = [], []
    for each in (day, under(nuisance)):
        rng = stream(3, "print", 0)
        seen.append(each.seen(each.good(pages[0]), rng))
        rngs.append(rng.bit_generator.state)
    before, after = seen
    assert rngs[0] == rngs[1]
    offset = np.stack([sensor.column_offset_dn for sensor in day.press.sensors])[:, None]
    factor = (after.expected_dn - offset) / (before.expected_dn - offset)
    of_variance = (after.variance_dn2 - 1 / 12) / (before.variance_dn2 - 1 / 12)
    assert np.abs(factor - 1).max() > 0.01
    assert np.abs(factor - of_variance).max() < 2e-3
    assert np.array_equal(after.expected_dn == before.expected_dn, factor == 1)


def test_two_prints_and_two_days_have_draws_of_their_own(
    under: Callable[..., SimulatedDay], day: SimulatedDay, pages: list[Page]
) -> None:
    def factor(nuisance: Nuisance, seed: int, of_print: int) -> NDArray[np.float32]:
        seen = []
        for each in (day, under(nuisance, seed)):
            seen.append(each.seen(each.good(pages[0]), stream(3, "print", of_print)).expected_dn)
        return seen[1] / seen[0]

    ripple, dust = OF_LIGHT[1], OF_LIGHT[3]
    assert not np.allclose(factor(ripple, 1, 0), factor(ripple, 1, 1), atol=1e-3)
    columns = [
        np.flatnonzero((factor(dust, *each)[0] < 0.99).all(axis=0)) for each in ((1, 0), (1, 1), (2, 0))
    ]
    assert columns[0].size == 2
    assert np.array_equal(columns[0], columns[1])
    assert not np.array_equal(columns[0], columns[2])


def blank(width_mm: float, height_mm: float, number: int = 1) -> Page:
    rows, columns = (round(extent * 200 / 25.4) for extent in (height_mm, width_mm))
    return Page(cmyk=np.zeros((rows, columns, 4), np.uint8), dpi=200, name=f"p{number}", number=number)


def passing(press: Press, page: Page, **more: object) -> Passing:
    facts = {"placement": IN_PLACE, "place": (0.3, 0.7), "others": (), "fetch": None}
    return Passing(press=press, page=page, **(facts | more))  # type: ignore[arg-type]


def test_texture_has_the_deviation_and_the_grain() -> None:
    """Seed 1, 120 x 150 mm: deviation to 2 %, correlation to 0.03 of 1/2 at half a grain, and gone at two."""
    texture = SheetTexture.draw(blank(120, 150), 2.0, stream(1, "stress-nuisance"))
    x_mm, y_mm = np.meshgrid(np.arange(0, 120, 0.25), np.arange(0, 150, 0.25))
    field = texture.at(x_mm, y_mm)
    assert field.std() == pytest.approx(1.0, rel=0.02)
    assert abs(field.mean()) < 0.03
    for moved in (field[4:] * field[:-4], field[:, 4:] * field[:, :-4]):
        assert moved.mean() == pytest.approx(0.5, abs=0.03)
    assert abs(np.mean(field[16:] * field[:-16])) < 0.03


def test_formation_moves_with_the_sheet_and_not_beyond_it(press: Press) -> None:
    nuisance, page = Formation(what="", rms_percent=1.5, grain_mm=2.0, where="sheet"), blank(30, 30)
    pitch = press.geometry.pixel_pitch_mm
    still, moved = (
        nuisance.light_change(
            passing(press, page, placement=Placement(shift_mm=shift)), stream(1, "stress-nuisance")
        )
        for shift in ((0.0, 0.0), (7 * pitch, 0.0))
    )
    lines, columns = press.geometry.on_page(page.width_mm, page.height_mm)
    assert np.abs(moved[:, 7:] - still[:, :-7]).max() < 1e-5
    assert still[lines, columns].std() == pytest.approx(0.015, rel=0.1)
    assert still[: lines.start - 1].size
    assert not still[: lines.start - 1].any()
    assert not still[:, : columns.start - 1].any()


def test_ripple_is_a_sine_of_lines(press: Press) -> None:
    """Amplitude and period from a fit; seed 1. Its phase is another one on another sheet."""
    nuisance = LightRipple(what="", amplitude_percent=0.7, period_lines=23.3)
    change = nuisance.light_change(passing(press, blank(30, 60)), stream(1, "stress-nuisance"))
    turns = 2 * np.pi * np.arange(change.shape[0]) / 23.3
    waves = np.stack([np.sin(turns), np.cos(turns)], axis=1)
    found, left, _, _ = np.linalg.lstsq(waves, change[:, 0], rcond=None)
    assert change.shape[1] == 1
    assert np.hypot(*found) == pytest.approx(0.007)
    assert left < 1e-20
    phases = [
        nuisance.light_change(passing(press, blank(30, 60)), stream(seed, "stress-nuisance"))[0, 0] / 0.007
        for seed in range(200)
    ]
    assert np.mean(phases) == pytest.approx(0, abs=0.2)
    assert np.std(phases) == pytest.approx(np.sqrt(0.5), abs=0.1)


@pytest.mark.parametrize("pitch_mm", [0.106, 0.254])
def test_wobble_moves_what_is_seen_by_a_sine(pitch_mm: float) -> None:
    """Where the scan's own nodes look: amplitude to 2 %, on top of the print's own warp.

    Single nodes lie up to 14 % further out, for lines between them cut the sine's tops. Across, the print's own warp
    (slopes of 0.02) is seen 0.09 mm further on: 2 um.
    """
    geometry = ScanGeometry(
        pixels=100, pixel_pitch_mm=pitch_mm, line_pitch_mm=pitch_mm, lead_in_mm=3, lead_out_mm=3
    )
    page, nuisance = blank(20, 150), WebWobble(what="", amplitude_mm=0.08, period_mm=21.0)
    nodes = np.random.default_rng(5).normal(0, 0.02, (62, 10, 2)).astype(np.float32)
    before = Placement(shift_mm=(0.3, -0.2), skew_deg=0.02, warp=Warp(nodes_mm=nodes, pitch_mm=2.5))
    after = nuisance.moved(before, page, geometry, stream(1, "stress-nuisance"))
    grids = [sampling_grid(page, geometry, each) for each in (before, after)]
    lines = np.arange(geometry.lines(page.height_mm))
    seen = []
    for grid in grids:
        at = np.arange(len(grid.along.places)) * grid.along.pitch
        seen.append(np.interp(lines, at, grid.along.places[:, 0]) * page.pixel_mm)
    y_mm = geometry.centres_y_mm(lines.size)
    inside = (y_mm > 5) & (y_mm < 145)
    turns = 2 * np.pi * y_mm[inside] / 21.0
    waves = np.stack([np.sin(turns), np.cos(turns), np.ones(turns.size)], axis=1)
    found = np.linalg.lstsq(waves, (seen[1] - seen[0])[inside], rcond=None)[0]
    assert np.hypot(*found[:2]) == pytest.approx(0.08, rel=0.02)
    assert abs(found[2]) < 1e-3
    assert np.abs(seen[1] - seen[0])[inside].max() < 0.08 * 1.15
    assert np.abs(grids[1].across.places - grids[0].across.places).max() * page.pixel_mm < 4e-3


def test_a_finer_warp_is_the_same_warp() -> None:
    nodes = np.random.default_rng(6).normal(0, 0.05, (9, 7, 2)).astype(np.float32)
    warp = Warp(nodes_mm=nodes, pitch_mm=2.5, first_mm=(-1.0, 0.5))
    made = finer(warp, blank(10, 20), 0.6)
    x_mm, y_mm = np.random.default_rng(7).uniform(-3, 25, (2, 500))
    assert made.pitch_mm == pytest.approx(0.5)
    assert np.allclose(warp.at(x_mm, y_mm), made.at(x_mm, y_mm), atol=1e-6)


def test_the_other_side_shows_mirrored(press: Press) -> None:
    """Ink in the left third of the back takes its share of light in the right third of the front, none elsewhere."""
    front, back = blank(36, 30, number=1), blank(36, 30, number=2)
    back.cmyk[:, : back.cmyk.shape[1] // 3, 3] = 255
    nuisance = ShowThrough(what="", amplitude_percent=4.0, blur_mm=0.5)
    more = {"others": (0, 1), "fetch": [front, back].__getitem__}
    (change,) = nuisance.light_change(passing(press, front, **more), stream(1, "stress-nuisance"))
    black = press.sensors[0].mean_dn[0, 0, 0, 32] / press.sensors[0].mean_dn[0, 0, 0, 0]
    lines, columns = press.geometry.on_page(36, 30)
    inner = change[lines, columns][30:-30, 30:-30]
    third = inner.shape[1] // 3
    assert inner[:, -third + 30 :] == pytest.approx(-0.04 * (1 - black), rel=0.03)
    assert np.abs(inner[:, : 2 * third - 30]).max() < 1e-3
    edge = np.argmin(np.abs(inner.mean(axis=0) - inner.min() / 2))
    at_mm = (edge + 30 + columns.start + 0.5) * press.geometry.pixel_pitch_mm - press.geometry.left_mm(36)
    assert at_mm == pytest.approx(24, abs=0.2)


def test_the_other_side_is_another_design(press: Press) -> None:
    nuisance, page = ShowThrough(what="", amplitude_percent=4.0, blur_mm=0.5), blank(36, 30)
    for more, why in (
        ({}, "needs other designs"),
        ({"others": (0,), "fetch": [page].__getitem__}, "page 1 itself"),
    ):
        with pytest.raises(ValueError, match=why):
            nuisance.light_change(passing(press, page, **more), stream(1, "stress-nuisance"))


def test_bad_columns_are_few_and_off_the_edges(two_sensor_press: Press) -> None:
    page, pixels = blank(30, 30), two_sensor_press.geometry.pixels
    for place in ((0.0, 0.0), (0.999, 0.999), (0.4, 0.6)):
        passed = passing(two_sensor_press, page, place=place)
        dust = Dust(what="", columns=2, loss_percent=3.0).light_change(passed, stream(1, "stress-nuisance"))
        dead = DeadColumn(what="", columns=1, loss_percent=40.0).light_change(
            passed, stream(1, "stress-nuisance")
        )
        assert np.unique(dust).tolist() == [-0.03, 0.0]
        where = np.flatnonzero(dust[0])
        assert where.size == 2
        assert np.diff(where).tolist() == [1]
        assert 0.29 * pixels < where[0] < 0.71 * pixels
        assert np.argwhere(dead).tolist() == [[int(place[1] * 2), 0, where[0]]]
        assert dead.min() == -0.4


def test_a_looser_press_is_the_same_day_further_apart(
    day: SimulatedDay, under: Callable[..., SimulatedDay]
) -> None:
    before, after = day.session, under(LooserPress(what="", times=2.0)).session
    assert before is not None
    assert after is not None
    assert after.amounts == Amounts.stated({"all_times": 2.0}) == multiplied(before.amounts, 2.0)
    assert np.allclose(after.ink_gain, 2 * before.ink_gain)
    assert np.allclose(after.lamp - 1, 2 * (before.lamp - 1))
    for one, other in zip(before.sensors, after.sensors, strict=True):
        assert other.sigma_error == pytest.approx(one.sigma_error**2)
        assert other.table_gain - 1 == pytest.approx(2 * (one.table_gain - 1))
        assert other.table_shape_sd == 2 * one.table_shape_sd
        assert other.table_shape is one.table_shape
        assert np.allclose(other.column_gain - 1, 2 * (one.column_gain - 1))


def test_patches_alone_grow(day: SimulatedDay, under: Callable[..., SimulatedDay]) -> None:
    before, after = day.session, under(PatchyTables(what="", times=2.5)).session
    assert before is not None
    assert after is not None
    for one, other in zip(before.sensors, after.sensors, strict=True):
        assert replace(other, table_shape_sd=one.table_shape_sd).table_gain == one.table_gain
        assert other.table_shape_sd == 2.5 * one.table_shape_sd
        assert other.table_shape is one.table_shape
    assert after.ink_gain is before.ink_gain


def test_the_lamp_tilts_and_keeps_its_mean(prototype: PressFile) -> None:
    light = prototype.camera().light
    aged = tilted(light, 4.0)
    change = aged.radiance_w / light.radiance_w
    assert aged.radiance_w.sum() == pytest.approx(light.radiance_w.sum())
    wave = np.arange(380, 731, 10)
    assert np.all(change[wave <= 400] == pytest.approx(change[0]))
    assert np.diff(change[(wave >= 400) & (wave <= 700)]) == pytest.approx(
        (change[wave == 700] - change[wave == 400])[0] / 30
    )
    assert (change[wave == 700] / change[wave == 400])[0] == pytest.approx(1.02 / 0.98)


def test_an_aged_lamp_changes_what_sensors_see_of_colours(
    day: SimulatedDay, under: Callable[..., SimulatedDay], two_sensor_file: PressFile
) -> None:
    """Against the camera's own answer to three colours under that lamp; the tables that predict stay."""
    aged = under(AgeingLamp(what="", tilt_percent=4.0))
    camera, inks = two_sensor_file.camera(), two_sensor_file.inks()
    recipes = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0]], float)
    new = replace(camera, light=tilted(camera.light, 4.0))
    answers = [respond(each, inks.reflectance(recipes)) for each in (camera, new)]
    assert aged.press is day.press
    changes = []
    for index, (true, taken_for) in enumerate(zip(aged.true_press.sensors, day.press.sensors, strict=True)):
        change = [
            true.mean_dn[node] / taken_for.mean_dn[node]
            for node in ((0, 0, 0, 0), (32, 0, 0, 0), (0, 0, 32, 0))
        ]
        wanted = answers[1][index].electrons / answers[0][index].electrons
        assert change == pytest.approx(wanted, abs=2e-4)
        changes.append(change)
    assert changes[1][0] < changes[0][0]  # the second sees blue
    assert np.ptp(changes[0]) > 1e-3  # no gain undoes it


def test_what_a_nuisance_needs_is_asked_for(day: SimulatedDay, press: Press) -> None:
    rng = stream(1, "stress-day", 1, 0)
    with pytest.raises(ValueError, match="give `press_file`"):
        stressed(day, AgeingLamp(what="", tilt_percent=1.0), rng=rng)
    ideal = SimulatedDay.begin("ideal", press, rng)
    with pytest.raises(ValueError, match="has no session"):
        stressed(ideal, OF_LIGHT[1], rng=rng)
