"""Sessions and prints are drawn as ``worlds.toml`` has it (seeds fixed; tolerances: five standard errors)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.pages.raster import Page
from prooflight.rng import stream
from prooflight.scans.placement import Placement
from prooflight.simulation.prints import Print, Speck, composed, plane_pixels, speck_pixels
from prooflight.simulation.session import Session, beyond_solid, noise_curve
from prooflight.simulation.sheets import ColourWaves, smooth_field, smooth_line
from prooflight.simulation.worlds import Amounts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.press.artefact import Press

DRAWS = 250
A4 = Page(cmyk=np.zeros((297, 210, 4), np.uint8), dpi=25.4, name="p0001", number=1)


@pytest.fixture(scope="module")
def sessions(two_sensor_press: Press) -> list[Session]:
    amounts = Amounts.stated()
    return [Session.draw(amounts, two_sensor_press, stream(seed, "session")) for seed in range(DRAWS)]


@pytest.fixture(scope="module")
def prints(sessions: list[Session], two_sensor_press: Press) -> list[Print]:
    rngs = (np.random.default_rng([9, number]) for number in range(DRAWS))
    return [Print.draw(sessions[0], two_sensor_press, A4, rng) for rng in rngs]


def assert_sd(values: Any, sd: float, *, independent: int | None = None) -> None:
    """Mean 0 and that standard deviation, each within five standard errors of ``independent`` draws."""
    array = np.asarray(values, np.float64)
    n = independent or array.size
    assert array.mean() == pytest.approx(0, abs=5 * sd / np.sqrt(n))
    assert array.std() == pytest.approx(sd, rel=5 / np.sqrt(2 * n))


def test_a_session_is_drawn_as_stated(sessions: list[Session]) -> None:
    assert_sd([s.ink_gain for s in sessions], 0.012)
    assert_sd([s.lamp[::100] - 1 for s in sessions], 0.008, independent=DRAWS)
    days = [day for s in sessions for day in s.sensors]
    assert_sd([day.column_gain - 1 for day in days], 0.0015)
    assert_sd([day.table_gain - 1 for day in days], 0.01)
    assert_sd([day.shape_at(np.array([0.0, 0.3, 0.9, 1.0])) - 1 for day in days], 0.01)
    errors = np.log([day.sigma_error for day in days])
    low, high = np.log(0.67), np.log(1.5)
    assert low <= errors.min() <= errors.max() <= high
    assert_sd(errors - (low + high) / 2, (high - low) / np.sqrt(12))


def test_a_print_is_drawn_as_stated(prints: list[Print]) -> None:
    shift = np.array([p.placement.shift_mm for p in prints])
    assert np.abs(shift).max() <= 0.76
    assert_sd(shift, 0.76 / np.sqrt(3))
    assert_sd([p.placement.skew_deg for p in prints], 0.10 / np.sqrt(3))
    assert_sd([p.placement.stretch_percent for p in prints], 0.03 / np.sqrt(3))
    assert_sd([p.ink_gain for p in prints], 0.015)
    assert_sd([p.ink_tilt for p in prints], 0.008)
    assert_sd([p.dot_gain for p in prints], 0.016)
    assert_sd([p.lamp[::100] - 1 for p in prints], 0.004, independent=DRAWS)
    assert_sd([p.flicker - 1 for p in prints], 0.0015)
    assert_sd([p.cloud[40, 40] for p in prints], 0.002)
    register = np.array([p.register_mm for p in prints])
    assert np.abs(register).max() == 0.114
    clipped = np.random.default_rng(1).normal(0, 0.048, 400_000).clip(-0.114, 0.114)
    assert_sd(register, clipped.std())
    white = np.array([p.white for p in prints]) - 1
    common, own = white.mean(axis=1), (white[:, 0] - white[:, 1]) / np.sqrt(2)
    assert_sd(own, 0.005)
    assert_sd(common, np.hypot(0.008, 0.005 / np.sqrt(2)))


def test_specks_are_as_many_and_as_large_as_stated(prints: list[Print]) -> None:
    counts = [len(p.specks) for p in prints]
    assert np.mean(counts) == pytest.approx(3.0, abs=5 * np.sqrt(3 / DRAWS))
    specks = [speck for p in prints for speck in p.specks]
    for values, low, high in (
        ([s.share for s in specks], 0.02, 0.12),
        ([s.diameter_mm for s in specks], 0.1, 0.5),
        ([s.x_mm for s in specks], 0, 210),
        ([s.y_mm for s in specks], 0, 297),
    ):
        assert low <= min(values) <= max(values) <= high
        assert_sd(np.array(values) - (low + high) / 2, (high - low) / np.sqrt(12))
    assert {s.ink for s in specks} == {0, 1, 2, 3}


def test_half_of_the_webs_jitter_depends_on_the_line_alone(prints: list[Print]) -> None:
    warps = [p.placement.warp for p in prints]
    nodes = np.array([warp.nodes_mm for warp in warps if warp is not None])
    assert len(nodes) == DRAWS
    assert_sd(nodes[:, 60, 40, 0], 0.030)
    assert_sd(nodes[:, 60, 40, 1], 0.041)
    # 200 mm apart across, smooth over 25 mm: what is common to both ends is the line's
    left, right = nodes[:, 60, 0, 1], nodes[:, 60, 80, 1]
    assert np.corrcoef(left, right)[0, 1] == pytest.approx(0.5, abs=5 * 0.75 / np.sqrt(DRAWS))
    left, right = nodes[:, 60, 0, 0], nodes[:, 60, 80, 0]
    assert np.corrcoef(left, right)[0, 1] == pytest.approx(0, abs=5 / np.sqrt(DRAWS))


def test_without_amounts_nothing_varies(two_sensor_press: Press) -> None:
    none = Amounts.stated({"all_times": 0.0})
    session = Session.draw(none, two_sensor_press, stream(1, "session"))
    print_ = Print.draw(session, two_sensor_press, A4, np.random.default_rng(1))
    assert print_.placement.is_shift
    assert print_.placement.shift_mm == (0, 0)
    assert not print_.specks
    for values in (session.ink_gain, print_.register_mm, print_.ink_tilt, print_.dot_gain, print_.cloud):
        assert not np.any(values)
    for values in (session.lamp, print_.white, print_.lamp, print_.flicker):
        assert (values == 1).all()
    assert [day.sigma_error for day in session.sensors] == [1, 1]


@pytest.mark.parametrize("length_mm", [5.0, 20.0])
def test_fields_have_their_length(length_mm: float) -> None:
    rng = np.random.default_rng(4)
    lines = np.array([smooth_line(41, pitch_mm=1.25, length_mm=length_mm, rng=rng) for _ in range(DRAWS)])
    fields = np.array(
        [smooth_field(3, 41, pitch_mm=1.25, length_mm=length_mm, rng=rng)[1] for _ in range(DRAWS)]
    )
    at = round(length_mm / 1.25)
    for values in (lines, fields):
        assert_sd(values[:, 7], 1.0)
        correlation = np.mean(values[:, 7] * values[:, 7 + at])
        assert correlation == pytest.approx(np.exp(-1), abs=5 * np.sqrt(1 + np.exp(-2)) / np.sqrt(DRAWS))


def test_a_table_of_colour_waves_is_the_waves() -> None:
    waves = ColourWaves.draw(np.random.default_rng(1))
    axis = np.linspace(0, 1.1, 5)
    table = waves.on_grid(axis)
    grid = np.stack(np.meshgrid(axis, axis, axis, axis, indexing="ij"), axis=-1)
    np.testing.assert_allclose(table, waves.at(grid), atol=1e-12)


def test_more_than_a_solid_goes_on_falling_as_before() -> None:
    axis = np.arange(33) * 8 / 255
    table = np.exp(-np.add.outer(np.add.outer(axis, 2 * axis), np.add.outer(3 * axis, 0 * axis)))
    further = np.arange(37) * 8 / 255
    expected = np.exp(
        -np.add.outer(np.add.outer(further, 2 * further), np.add.outer(3 * further, 0 * further))
    )
    np.testing.assert_allclose(beyond_solid(table), expected, rtol=1e-12)


def test_the_noise_curve_is_the_tables(press: Press) -> None:
    model = press.sensors[0]
    curve = noise_curve(model, 4000.0)
    light = np.linspace(0, 4000.0, curve.size)
    slope = (model.backing_variance_dn2 - model.dark_variance_dn2) / model.backing_dn
    straight = model.dark_variance_dn2 + slope * light - 1 / 12  # shot noise
    np.testing.assert_allclose(curve, straight, rtol=2e-3)


def place(**fields: Any) -> Placement:
    return Placement(**fields)


def test_displacements_add(prints: list[Print]) -> None:
    of_print = prints[0].placement
    both = composed(of_print, place(shift_mm=(3.0, -2.0), skew_deg=0.4))
    assert both.shift_mm == (of_print.shift_mm[0] + 3.0, of_print.shift_mm[1] - 2.0)
    assert both.skew_deg == of_print.skew_deg + 0.4
    assert both.warp is of_print.warp


def speckled(prints: list[Print], speck: Speck, planes: NDArray[np.float64]) -> Print:
    from dataclasses import replace

    return replace(prints[0], specks=(speck,), register_mm=planes)


def test_a_speck_lies_where_it_should_and_adds_its_ink_to_what_is_printed(prints: list[Print]) -> None:
    cmyk = np.zeros((100, 80, 4), np.uint8)
    cmyk[:, 20:, 1] = 50
    page = Page(cmyk=cmyk, dpi=254.0, name="p", number=1)  # 0.1 mm a pixel
    register = np.zeros((4, 2))
    register[1] = (0.21, -0.34)  # magenta two pixels right, three up
    print_ = speckled(prints, Speck(x_mm=2.0, y_mm=5.0, diameter_mm=0.8, ink=3, share=0.1), register)
    np.testing.assert_array_equal(plane_pixels(print_, page), [[0, 0], [2, -3], [0, 0], [0, 0]])
    places, printed = speck_pixels(print_, page)
    assert len(places) == pytest.approx(np.pi * 16, abs=6)  # pixels in a disc of 4 pixels' radius
    np.testing.assert_allclose(places.mean(axis=0) + 0.5, [50, 20], atol=0.2)
    assert (printed[:, 3] == 26).all()  # 10 % of 255
    np.testing.assert_array_equal(printed[:, 1], np.where(places[:, 1] >= 22, 50, 0))


def test_plain_words_are_json(prints: list[Print], sessions: list[Session], two_sensor_press: Press) -> None:
    import json

    plain = prints[0].plain()
    assert plain["shift_mm"] == pytest.approx(prints[0].placement.shift_mm, abs=1e-4)
    json.dumps(plain, allow_nan=False)
    json.dumps(sessions[0].plain(two_sensor_press), allow_nan=False)
