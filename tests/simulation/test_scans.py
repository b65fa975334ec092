from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from prooflight.errors import RequestError
from prooflight.pages.raster import Page
from prooflight.prediction.predict import Prediction, predict
from prooflight.rng import stream
from prooflight.simulation.misprints.kinds import Drawn, draw_misprint
from prooflight.simulation.scans import (
    KINDS,
    TRIES,
    MisprintRequest,
    SimulatedScan,
    ideal_scan,
    passes_gate,
    scan_page,
)
from prooflight.simulation.session import Session
from prooflight.simulation.worlds import Amounts, gate

if TYPE_CHECKING:
    from prooflight.press.artefact import Press


def no_other(number: int) -> Page:
    raise AssertionError(number)


def prediction_of(press: Press, level: float, variance: float, *, lines: int = 200) -> Prediction:
    shape = (len(press.sensors), lines, press.geometry.pixels)
    return Prediction(
        expected_dn=np.full(shape, level, np.float32), variance_dn2=np.full(shape, variance, np.float32)
    )


# --- requests ---


@pytest.mark.parametrize("kind", KINDS)
def test_a_request_is_a_kind_and_perhaps_a_severity(kind: str) -> None:
    assert MisprintRequest.parse(kind) == MisprintRequest(kind=kind, severity=None)
    assert MisprintRequest.parse(f"{kind}:0.25") == MisprintRequest(kind=kind, severity=0.25)
    assert MisprintRequest.parse(f"{kind}:1") == MisprintRequest(kind=kind, severity=1.0)
    assert MisprintRequest.parse(f"{kind}:0") == MisprintRequest(kind=kind, severity=0.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("smudge", "no kind 'smudge'"),
        ("", "no kind ''"),
        ("Streak", "no kind 'Streak'"),
        ("streak:1.1", "out of range"),
        ("streak:-0.1", "out of range"),
        ("streak:nan", "out of range"),
        ("streak:inf", "out of range"),
        ("streak:much", "'much' is not a number"),
        ("streak:0.5:0.5", "not a number"),
    ],
)
def test_a_request_for_something_else_is_refused_in_one_line(text: str, said: str) -> None:
    with pytest.raises(RequestError) as refusal:
        MisprintRequest.parse(text)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)
    if "kind" in said:
        assert KINDS[0] in str(refusal.value)  # what would be right


# --- random numbers ---


def test_every_page_has_its_own_random_numbers_whatever_else_is_simulated() -> None:
    drawn = {
        (seed, number): tuple(stream(seed, "print", number).random(4))
        for seed in (0, 1)
        for number in (1, 2, 3)
    }
    assert len(set(drawn.values())) == 6
    assert tuple(stream(1, "print", 2).random(4)) == drawn[1, 2]


# --- the ideal world (seeds fixed; five standard errors) ---


@pytest.mark.parametrize(("level", "variance"), [(1000.3, 64.0), (50.45, 2.0), (2856.5, 9.0)])
def test_an_ideal_scan_has_the_predicted_mean_and_variance(
    press: Press, level: float, variance: float
) -> None:
    prediction = prediction_of(press, level, variance)
    dn = ideal_scan(prediction, press, np.random.default_rng(3)).astype(float)
    n = dn.size
    assert dn.mean() == pytest.approx(level, abs=5 * np.sqrt(variance / n))
    assert dn.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / n))
    # white: neighbours across and along know nothing of each other
    error = dn[0] - level
    for one, other in ((error[:-1], error[1:]), (error[:, :-1], error[:, 1:])):
        assert np.corrcoef(one.ravel(), other.ravel())[0, 1] == pytest.approx(0, abs=5 / np.sqrt(n))


def test_an_ideal_scan_without_noise_is_the_prediction_rounded(press: Press) -> None:
    prediction = prediction_of(press, 0.0, 1 / 12)
    prediction.expected_dn[0] = np.linspace(0, 4095, prediction.expected_dn[0].size).reshape(200, -1)
    kept = prediction.expected_dn.copy()
    dn = ideal_scan(prediction, press, np.random.default_rng(3))
    assert dn.dtype == np.uint16
    assert np.abs(dn - prediction.expected_dn.astype(float)).max() <= 0.5
    np.testing.assert_array_equal(prediction.expected_dn, kept)


def test_an_ideal_scan_stays_within_each_sensors_codes(two_sensor_press: Press) -> None:
    for level in (0.5, 4095.0):
        dn = ideal_scan(
            prediction_of(two_sensor_press, level, 400.0), two_sensor_press, np.random.default_rng(3)
        )
        assert dn[0].max() <= 4095
        assert dn[1].max() <= 1023  # 10 bits
    assert (dn[1] == 1023).all()


# --- the gate ---


@pytest.mark.parametrize(
    ("peak_percent", "width_pixels", "passes"),
    [
        (0.0, 400, False),
        (0.39, 400, False),  # below both: 0.4 % rms, 1.2 % peak
        (0.41, 400, True),  # enough rms
        (1.1, 20, False),  # 22 of 400 columns: rms 0.25 %
        (1.3, 20, True),  # wide against the blur of 3.6 pixels
        (3.0, 1, False),  # the blur leaves 1 / (3.6 sqrt(2 pi)) = 11 % of a line
        (12.0, 1, True),
    ],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_the_gate_asks_for_a_blurred_peak_or_an_rms(
    press: Press, peak_percent: float, width_pixels: int, passes: bool, sign: int
) -> None:
    good, bad = prediction_of(press, 1500.0, 9.0), prediction_of(press, 1500.0, 9.0)
    bad.expected_dn[0, :, 190 : 190 + width_pixels] += sign * peak_percent / 100 * press.sensors[0].white_dn
    if width_pixels == 400:
        bad.expected_dn[0] = good.expected_dn[0] + sign * peak_percent / 100 * press.sensors[0].white_dn
    assert passes_gate(good, bad, press, gate()) is passes


def test_the_gate_opens_when_any_sensor_sees_it(two_sensor_press: Press) -> None:
    for sensor in (0, 1):
        good = prediction_of(two_sensor_press, 500.0, 9.0)
        bad = prediction_of(two_sensor_press, 500.0, 9.0)
        bad.expected_dn[sensor] += 0.02 * two_sensor_press.sensors[sensor].white_dn
        assert passes_gate(good, bad, two_sensor_press, gate())


# --- whole pages ---


def test_a_good_scan_is_the_prediction_plus_noise(press: Press, page: Page) -> None:
    scan = scan_page(page, press=press, request=None, others=(), fetch=no_other, rng=stream(1, "print", 1))
    assert scan.misprint is None
    assert scan.draws == 0
    good = predict(page, sensors=press.sensors, geometry=press.geometry)
    assert scan.dn.shape == good.expected_dn.shape
    z = (scan.dn - good.expected_dn) / np.sqrt(good.variance_dn2)
    assert z.std() == pytest.approx(1, abs=5 / np.sqrt(2 * z.size))


@pytest.mark.parametrize("kind", KINDS)
def test_a_misprinted_scan_differs_and_says_how(press: Press, page: Page, kind: str) -> None:
    request = MisprintRequest(kind=kind, severity=0.9)
    first, again = (
        scan_page(page, press=press, request=request, others=(), fetch=no_other, rng=stream(4, "print", 1))
        for _ in range(2)
    )
    assert first.misprint is not None
    assert first.misprint.kind == kind
    assert first.misprint.severity == 0.9
    assert 1 <= first.draws <= TRIES
    np.testing.assert_array_equal(first.dn, again.dn)
    assert first.misprint == again.misprint
    good = predict(page, sensors=press.sensors, geometry=press.geometry)
    z = (first.dn - good.expected_dn) / np.sqrt(good.variance_dn2)
    assert np.abs(z).max() > 10


def test_without_a_severity_each_draw_has_its_own(press: Press, page: Page) -> None:
    request = MisprintRequest(kind="missing-content")
    severities = set()
    for number in range(1, 6):
        scan = scan_page(
            page, press=press, request=request, others=(), fetch=no_other, rng=stream(4, "print", number)
        )
        assert scan.misprint is not None
        assert 0 <= scan.misprint.severity <= 1
        severities.add(scan.misprint.severity)
    assert len(severities) == 5


def test_a_page_on_which_nothing_can_go_wrong_is_refused_by_name(press: Press) -> None:
    blank = Page(cmyk=np.zeros((200, 300, 4), np.uint8), dpi=300.0, name="p0006", number=6)
    for kind in ("missing-plane", "missing-content"):
        request = MisprintRequest(kind=kind, severity=1.0)
        with pytest.raises(RequestError, match=rf"page 6: {TRIES} draws of {kind}"):
            scan_page(
                blank, press=press, request=request, others=(), fetch=no_other, rng=stream(1, "print", 6)
            )


def test_a_draw_that_changes_nothing_is_drawn_again(
    press: Press, page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def twice_in_vain(printed: Page, *args: Any, **more: Any) -> Drawn:
        drawn = draw_misprint(printed, *args, **more)
        calls.append(drawn)
        return drawn if len(calls) > 2 else replace(drawn, page=printed)

    monkeypatch.setattr("prooflight.simulation.scans.draw_misprint", twice_in_vain)
    request = MisprintRequest(kind="missing-content", severity=1.0)
    scan = scan_page(page, press=press, request=request, others=(), fetch=no_other, rng=stream(1, "print", 1))
    assert scan.draws == 3
    assert scan.misprint == calls[2].misprint


# --- the press world ---


def test_a_scan_in_the_press_world_does_not_depend_on_what_was_scanned_before(
    press: Press, page: Page
) -> None:
    session = Session.draw(Amounts.stated(), press, stream(5, "session"))

    def scan(number: int) -> SimulatedScan:
        rng = stream(5, "print", number)
        return scan_page(page, press=press, request=None, others=(), fetch=no_other, rng=rng, session=session)

    first, second = scan(1), scan(2)
    again = scan(1)
    np.testing.assert_array_equal(first.dn, again.dn)
    assert first.print_ is not None
    assert second.print_ is not None
    assert first.print_.placement.shift_mm != second.print_.placement.shift_mm
    expected = predict(page, sensors=press.sensors, geometry=press.geometry).expected_dn
    assert first.dn.shape == expected.shape
    assert (first.misprint, first.draws) == (None, 0)


def test_a_misprint_in_the_press_world_comes_on_top_of_what_a_good_print_does(
    press: Press, page: Page
) -> None:
    session = Session.draw(Amounts.stated(), press, stream(5, "session"))
    request = MisprintRequest(kind="missing-content", severity=0.8)
    bad = scan_page(
        page,
        press=press,
        request=request,
        others=(),
        fetch=no_other,
        rng=stream(5, "print", 1),
        session=session,
    )
    good = scan_page(
        page, press=press, request=None, others=(), fetch=no_other, rng=stream(5, "print", 1), session=session
    )
    assert bad.misprint is not None
    assert bad.print_ is not None
    assert good.print_ is not None
    assert bad.print_.plain() == good.print_.plain()
    assert bad.draws >= 1
    change = bad.dn.astype(float) - good.dn
    x, y, width, height = bad.misprint.region_mm
    geometry = press.geometry
    beside = np.abs(geometry.centres_x_mm(page.width_mm) - x - width / 2) > width / 2 + 2
    above = np.abs(geometry.centres_y_mm(change.shape[1]) - y - height / 2) > height / 2 + 2
    outside = above[:, None] | beside
    noise = np.sqrt(2) * 60  # halftone and sensor
    assert np.abs(change[0][outside]).mean() < noise
    assert change[0][~outside].mean() > 0  # ink is missing


def test_the_ideal_world_has_no_print(press: Press, page: Page) -> None:
    scan = scan_page(page, press=press, request=None, others=(), fetch=no_other, rng=stream(5, "print", 1))
    assert scan.print_ is None
    seen = predict(page, sensors=press.sensors, geometry=press.geometry)
    np.testing.assert_array_equal(scan.dn, ideal_scan(seen, press, stream(5, "print", 1)))
