"""A page is found in a scanner's picture, and its tone is fitted, so that a press's detector can judge it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from prooflight.commissioning.build import build_press
from prooflight.inspection.scanner.fits import fitted_tone, toned_lines
from prooflight.inspection.scanner.placing import (
    ExpectedPage,
    agreement_of,
    drawn_scan,
    most_likely,
    placed,
    seen_coarsely,
)
from prooflight.pages.raster import Page
from prooflight.press.artefact import Press
from prooflight.press.scanner import feeder_of, scanner_press_file
from prooflight.scans.scanner.feeder import FeederPrior
from prooflight.scans.scanner.reading import ScannedPicture

WIDTH_MM, HEIGHT_MM, DPI = 100.0, 120.0, 300.0


@pytest.fixture(scope="module")
def scanner() -> Press:
    return build_press(scanner_press_file(dpi=150, grey=True, width_mm=WIDTH_MM), seed=1)


@pytest.fixture(scope="module")
def expected(scanner: Press, make_page: Callable[..., Page]) -> ExpectedPage:
    page = make_page(3, width_mm=WIDTH_MM, height_mm=HEIGHT_MM, dpi=300.0)
    return ExpectedPage.of(page, scanner.press_context().predict(page), scanner, feeder_of(scanner))


def light_of(expected: ExpectedPage, press: Press) -> NDArray[np.float32]:
    """The page's expected light as shares of paper, at the press's pixels."""
    sensor = press.sensors[0]
    lines = press.press_context().predict(expected.page).expected_dn[0]
    bare = (lines - sensor.column_offset_dn) / sensor.column_gain
    return (bare / np.float32(sensor.white_dn)).astype(np.float32)


def scanned(
    expected: ExpectedPage,
    press: Press,
    *,
    shift_mm: tuple[float, float] = (0.0, 0.0),
    skew_deg: float = 0.0,
    along_percent: float = 0.0,
    upside_down: bool = False,
) -> ScannedPicture:
    """The page as a scanner of 300 dpi would show it, in perfect tone."""
    light = cv2.resize(light_of(expected, press), None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    rows, columns = light.shape
    turn, along = np.deg2rad(skew_deg), 1 + along_percent / 100
    linear = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) * (1.0, along)
    centre = np.array([(columns - 1) / 2, (rows - 1) / 2])
    moved = centre + np.array(shift_mm) * DPI / 25.4 - linear @ centre
    matrix = np.column_stack([linear, moved])
    light = cv2.warpAffine(light, matrix, (columns, rows), flags=cv2.INTER_CUBIC, borderValue=1.0)
    light = np.clip(light, 0, 1)[None].astype(np.float32)
    if upside_down:
        light = np.ascontiguousarray(light[:, ::-1, ::-1])
    return ScannedPicture(name="scan", light=light, clipped=light >= 1, dpi=(DPI, DPI))


@pytest.mark.parametrize("upside_down", [False, True])
def test_a_page_is_found_where_a_feeder_laid_it(
    scanner: Press, expected: ExpectedPage, upside_down: bool
) -> None:
    picture = scanned(
        expected, scanner, shift_mm=(2.4, -1.9), skew_deg=0.3, along_percent=-0.8, upside_down=upside_down
    )
    start = most_likely(seen_coarsely(picture, expected), expected)
    where, reason = placed(picture, expected, start, scanner)
    assert reason == ""
    assert where.turned == upside_down
    assert where.shift_mm == pytest.approx((2.4, -1.9), abs=0.05)
    assert where.skew_deg == pytest.approx(0.3, abs=0.02)
    assert where.stretch_percent == pytest.approx((0.0, -0.8), abs=0.05)
    drawn = drawn_scan(picture, expected.page, where, scanner)
    assert agreement_of(drawn, expected) > 0.98
    assert 0.7 < drawn.seen.mean() < 0.95  # what the feeder moved out of the scan is not seen


def test_a_back_side_is_found_where_its_own_feeder_laid_it(scanner: Press, expected: ExpectedPage) -> None:
    back = FeederPrior(shift_mm=2.7, skew_deg=0.9, stretch_percent=2.4)
    both = replace(expected.feeder, back=back)
    assert [both.of_scan(turn) for turn in range(4)] == [both, back, both, back]
    assert expected.feeder.of_scan(1) is expected.feeder
    assert expected.fed_by(expected.feeder) is expected
    picture = scanned(expected, scanner, shift_mm=(-1.2, 0.8), skew_deg=-0.9, along_percent=2.4)
    page = expected.fed_by(back)
    where, reason = placed(picture, page, most_likely(seen_coarsely(picture, page), page), scanner)
    assert reason == ""
    assert where.skew_deg == pytest.approx(-0.9, abs=0.02)
    assert where.stretch_percent == pytest.approx((0.0, 2.4), abs=0.05)


def test_a_scan_of_something_else_is_not_placed(
    scanner: Press, expected: ExpectedPage, make_page: Callable[..., Page]
) -> None:
    page = make_page(11, width_mm=WIDTH_MM, height_mm=HEIGHT_MM, dpi=300.0)
    other = ExpectedPage.of(page, scanner.press_context().predict(page), scanner, feeder_of(scanner))
    picture = scanned(other, scanner)
    start = most_likely(seen_coarsely(picture, expected), expected)
    _, reason = placed(picture, expected, start, scanner)
    assert reason
    blank = replace(picture, light=np.ones_like(picture.light), clipped=np.ones_like(picture.clipped))
    start = most_likely(seen_coarsely(blank, expected), expected)
    assert placed(blank, expected, start, scanner)[1] == "the scan shows nothing of this page"


def wedge() -> NDArray[np.float32]:
    """Expected light of a page with eight tints and paper."""
    steps = np.append(np.linspace(0.08, 0.85, 8), [1.0, 1.0]).astype(np.float32)
    return np.tile(np.repeat(steps, 20), (100, 1))


def test_white_black_and_gamma_are_fitted_to_the_pages_own_tints() -> None:
    due, seen = wedge(), np.ones((100, 200), bool)
    light = (0.9 * (0.04 + 0.96 * due**1.3)).astype(np.float32)
    tone = fitted_tone(light, np.zeros_like(light), due, seen)
    assert tone.white == pytest.approx(0.9, rel=1e-3)
    assert tone.black == pytest.approx(0.04, abs=0.01)
    assert tone.gamma == pytest.approx(1.3, abs=0.05)
    assert not tone.clipped
    np.testing.assert_allclose(tone.light(light), due, atol=0.02)


def test_what_is_clipped_is_unknown_above_its_number_and_known_below(
    scanner: Press, expected: ExpectedPage
) -> None:
    picture = scanned(expected, scanner)
    start = most_likely(seen_coarsely(picture, expected), expected)
    where, _ = placed(picture, expected, start, scanner)
    drawn = drawn_scan(picture, expected.page, where, scanner)
    # The device makes all that is lighter than 80 % of paper plain white, where it says full light.
    short = replace(
        drawn,
        light=np.minimum(drawn.light / np.float32(0.8), 1),
        clipped=(drawn.light >= 0.8).astype(np.float32),
    )
    lines, (tone,) = toned_lines(short, scanner.press_context().predict(expected.page), scanner.sensors)
    assert tone.clipped
    unknown = (short.clipped[0] == 1) & drawn.seen
    due = scanner.press_context().predict(expected.page).expected_dn[0]
    assert (lines[0][unknown] >= due[unknown] - 1).all()
    # A spot where paper should be is no less visible for it.
    rows, columns = np.nonzero(unknown)
    spot = short.light.copy()
    spot[0, rows[0], columns[0]] = 0.2
    clipped = short.clipped.copy()
    clipped[0, rows[0], columns[0]] = 0
    spotted, _ = toned_lines(
        replace(short, light=spot, clipped=clipped),
        scanner.press_context().predict(expected.page),
        scanner.sensors,
    )
    assert spotted[0, rows[0], columns[0]] < 0.5 * due[rows[0], columns[0]]
