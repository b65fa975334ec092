"""Scans made under light that the press was not calibrated for are not inspected, and said to be so. Seeds fixed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.detectors.print_prior import PrintPrior
from prooflight.inspection.inspector import Inspector
from prooflight.inspection.light_level import (
    BLACK_OFF,
    LEAST_OFF,
    LightLevel,
    light_levels,
    light_tolerance,
    wrong_light,
)
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.simulation.captures import SimulatedDay
from prooflight.simulation.scans import ideal_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from prooflight.detectors.verdict import Verdict
    from prooflight.press.artefact import Press

    MakePage = Callable[..., Page]

DETECTORS = ("matched_filter", "chi-square")


def scan_of(page: Page, press: Press, light: float = 1.0, *, sensor: int | None = None) -> NDArray[np.uint16]:
    """A good print under ``light`` times the light of the press; sensor: seen so by this one alone."""
    lit = replace(
        press,
        sensors=tuple(
            replace(one, column_gain=one.column_gain * np.float32(light if sensor in (None, index) else 1))
            for index, one in enumerate(press.sensors)
        ),
    )
    seen = predict(page, sensors=lit.sensors, geometry=lit.geometry, threads=1)
    return ideal_scan(seen, lit, np.random.default_rng(1))


def verdict(page: Page, scan: NDArray[np.uint16], press: Press, detector: str | None = None) -> Verdict:
    inspector = Inspector.of(press, detector)
    return inspector.inspect(inspector.prepare(page), scan, scan_name="scan").verdict


def inked(page: Page) -> Page:
    """The same without a pixel of bare paper: a picture that fills the page."""
    return replace(page, cmyk=np.maximum(page.cmyk, np.array([60, 40, 90, 0], np.uint8)))


@pytest.mark.parametrize("detector", DETECTORS)
@pytest.mark.parametrize("light", [0.5, 0.7, 0.8, 1.3])
def test_light_far_from_the_calibrated_is_said(
    trained_press: Press, page: Page, light: float, detector: str
) -> None:
    for shown in (page, inked(page)):
        found = verdict(shown, scan_of(shown, trained_press, light), trained_press, detector)
        assert (found.verdict, found.kind) == ("not-inspected", None)
        assert found.score is None
        assert found.detector == detector
        white = trained_press.sensors[0].white_dn
        assert found.reason.startswith(f"the light is {light:.2f} times what this press was calibrated for")
        assert f"{white:.0f} expected" in found.reason


@pytest.mark.parametrize("light", [0.7, 1.0])
def test_a_misprint_is_known_before_it_is_explained_unless_the_light_is_wrong(
    trained_press: Press, page: Page, light: float
) -> None:
    known: list[Verdict] = []
    scan = scan_of(page, trained_press, light)
    scan[:, 200:230, 100:130] //= 2
    verdict = Inspector.of(trained_press).inspect(page, scan, decided=known.append).verdict
    assert verdict.verdict == ("misprint" if light == 1.0 else "not-inspected")
    assert [(one.verdict, one.score) for one in known] == [("misprint", verdict.score)] * (light == 1.0)


def test_light_that_good_presses_vary_by_is_not_said(trained_press: Press, page: Page) -> None:
    for light in (0.95, 1.0, 1.05):
        for shown in (page, inked(page)):
            found = verdict(shown, scan_of(shown, trained_press, light), trained_press)
            assert found.verdict != "not-inspected"


def only_paper(tolerance: float) -> PrintPrior:
    """Return the variation of prints of which paper alone varies, by a fifth of the tolerance."""
    return PrintPrior(white=tolerance / 5, common=0.0, lamp=0.0, shape=0.0, gain=0.0, dot=0.0)


def test_good_prints_of_the_press_world_lie_well_within(press: Press, make_page: MakePage) -> None:
    """Also where they vary half as much again as the press says."""
    for seed in range(12):
        rng = np.random.default_rng([seed, 4])
        day = SimulatedDay.begin("press", replace(press, variation={"all_times": 1.5}), rng)
        page = make_page(seed) if seed % 2 else inked(make_page(seed))
        prepared = Inspector.of(press, "chi-square").prepare(page)
        (level,) = light_levels(prepared.lit, day.recorded(day.seen(day.good(page), rng), rng), press.sensors)
        assert level.page is not None or not seed % 2  # a picture a millimetre off its place need not agree
        assert abs((level.page or 1.0) - 1) < 0.8 * light_tolerance(PrintPrior(), level.ink_share)
        assert level.clipped == 0
        assert abs(level.darkest - level.darkest_due) < 0.6 * BLACK_OFF


@pytest.mark.parametrize(
    ("spoilt", "words"),
    [
        (lambda scan: np.full_like(scan, 4095), "100% of the page is at the camera's greatest value, 4095"),
        (lambda scan: scan >> 4, "the light is 0.06 times"),
        (lambda scan: scan << 4, "above the camera's greatest, 4095"),
        (np.zeros_like, "the light is 0.00 times"),
    ],
    ids=["saturated", "8 bits", "shifted", "dark"],
)
def test_scans_that_no_calibrated_camera_makes(
    press: Press, page: Page, spoilt: Callable[[NDArray[np.uint16]], NDArray[np.uint16]], words: str
) -> None:
    found = verdict(page, spoilt(scan_of(page, press)), press, "chi-square")
    assert found.verdict == "not-inspected"
    assert words in found.reason


def test_a_black_level_that_is_far_off_never_passes_as_good(trained_press: Press, page: Page) -> None:
    press, scan = trained_press, scan_of(page, trained_press)
    prepared = Inspector.of(press).prepare(page)
    for off_dn, told in ((0, False), (50, False), (200, True)):
        dark = scan + np.uint16(off_dn)
        wrong = wrong_light(
            light_levels(prepared.lit, dark, press.sensors), press.sensors, prior=only_paper(0.14)
        )
        assert (wrong is not None) == told
        if wrong is not None:
            assert wrong.of_sheet  # a misprint says more
            assert "black level is off" in wrong.reason
            assert verdict(page, dark, press).verdict != "good"


def test_a_dark_picture_that_fills_the_page_has_the_backing_speak_for_it(
    trained_press: Press, page: Page
) -> None:
    dark = replace(page, cmyk=np.maximum(page.cmyk, np.array([200, 150, 120, 140], np.uint8)))
    for light, told in ((0.7, True), (0.95, False), (1.0, False)):
        scan = scan_of(dark, trained_press, light)
        prepared = Inspector.of(trained_press).prepare(dark)
        sensors = trained_press.sensors
        (level,) = light_levels(prepared.lit, scan, sensors)
        assert level.page is None
        assert (wrong_light((level,), sensors, prior=only_paper(0.14)) is not None) == told
        assert verdict(dark, scan, trained_press).verdict != "good" or not told


def test_one_sensor_of_two_is_named(two_sensor_press: Press, page: Page) -> None:
    press = two_sensor_press
    for index, sensor in enumerate(press.sensors):
        found = verdict(page, scan_of(page, press, 0.7, sensor=index), press, "chi-square")
        assert found.verdict == "not-inspected"
        assert found.reason.startswith(f"sensor {sensor.name}: the light is 0.70 times")
        assert found.reason.count("sensor ") == 1
    swapped = verdict(page, np.ascontiguousarray(scan_of(page, press)[::-1]), press, "chi-square")
    assert swapped.verdict == "not-inspected"


def test_what_is_wrong_with_the_page_alone_stays_a_misprint(press: Press, page: Page) -> None:
    """The backing beside it shows that the light is right: another page, no page of paper, ink all over."""
    full = replace(page, cmyk=np.broadcast_to(np.array([90, 60, 60, 20], np.uint8), page.cmyk.shape).copy())
    blank = replace(page, cmyk=np.zeros_like(page.cmyk))
    weak = replace(full, cmyk=(full.cmyk * 0.5).astype(np.uint8))
    for design, printed in ((page, full), (blank, full), (full, blank), (full, weak)):
        assert verdict(design, scan_of(printed, press), press, "chi-square").verdict == "misprint"


def test_paper_that_is_not_what_was_calibrated_for_never_passes_as_good(
    trained_press: Press, page: Page
) -> None:
    """The backing is as it should be, so that it is not the lamp."""
    grey = tuple(replace(one, mean_dn=one.mean_dn * np.float32(0.8)) for one in trained_press.sensors)
    seen = predict(page, sensors=grey, geometry=trained_press.geometry, threads=1)
    scan = ideal_scan(seen, trained_press, np.random.default_rng(1))
    found = verdict(page, scan, trained_press)
    assert found.verdict != "good"
    if found.verdict == "not-inspected":
        assert "calibrate again for this paper" in found.reason


def test_the_tolerance_follows_what_good_prints_do() -> None:
    hardly = PrintPrior(white=0.0, common=0.0, lamp=0.0, shape=0.0, gain=0.01)
    assert light_tolerance(hardly, 0.0) == LEAST_OFF == 0.1
    assert light_tolerance(replace(hardly, white=0.03, common=0.04, gain=0.0), 0.0) == pytest.approx(0.25)


def test_the_tolerance_of_a_dark_tint_holds_what_its_ink_does(press: Press) -> None:
    """A page of one tint, printed with 5 % less ink: the light of the whole page changes, and its lamp is right.

    The light of the tint is 1 - a (1 - s), s that of the solid, so that it changes by the share that is stated, less a
    fifth, by which the area grows less than the raster's number where dots gain most.
    """
    tint = Page(cmyk=np.full((560, 560, 4), (0, 0, 0, 120), np.uint8), dpi=press.dpi, name="tint", number=1)
    less = replace(tint, cmyk=np.full_like(tint.cmyk, (0, 0, 0, 114)))
    prepared = Inspector.of(press, "chi-square").prepare(tint)
    (level,) = light_levels(prepared.lit, scan_of(less, press), press.sensors)
    assert level.page is not None
    assert level.page - 1 == pytest.approx(0.8 * 0.05 * level.ink_share, rel=0.05)
    assert level.page - 1 < light_tolerance(PrintPrior(), level.ink_share)
    assert level.page - 1 > 0.05  # more than the same share of the light


# --- each limit, from levels of light alone ---

RIGHT = LightLevel(page=1.0, backing=1.0, clipped=0.0, brightest_dn=4095, darkest=0.05, darkest_due=0.05)


@pytest.mark.parametrize(
    ("change", "words", "of_sheet"),
    [
        ({}, "", False),
        ({"brightest_dn": 4096}, "values up to 4096, above the camera's greatest, 4095", False),
        ({"clipped": 0.05}, "", False),
        ({"clipped": 0.06}, "6% of the page is at the camera's greatest value", False),
        ({"page": 1.125}, "", False),
        ({"page": 0.875}, "", False),
        ({"page": 1.25, "backing": 1.25}, "the light is 1.25 times", False),
        ({"page": 0.75, "backing": None}, "the light is 0.75 times", False),
        ({"page": 0.75, "backing": 0.875}, "the light is 0.75 times", False),
        ({"page": 0.75, "backing": 0.88}, "the sheet is 0.75 times as bright", True),
        ({"page": 1.25, "backing": 0.88}, "the sheet is 1.25 times as bright", True),
        ({"page": -0.25, "backing": -0.25}, "the light is 0.00 times", False),
        ({"page": None}, "", False),
        ({"page": None, "backing": None}, "", False),
        ({"page": None, "backing": 1.125}, "", False),
        ({"page": None, "backing": 0.75}, "the backing next to the page is 0.75 times as bright", True),
        ({"page": None, "backing": 1.25}, "the backing next to the page is 1.25 times as bright", True),
        ({"page": None, "backing": 2.0}, "", False),
        ({"darkest": 0.0999}, "", False),
        ({"darkest": 0.1001}, "the darkest area of the page is at 200 DN above dark, 100 expected", True),
        ({"darkest": 0.0}, "", False),
        ({"darkest_due": 0.1, "darkest": 0.2}, "200 expected", True),
        ({"darkest_due": 0.11, "darkest": 0.3}, "", False),
    ],
)
def test_light_is_wrong_from_each_limit_on(
    press: Press, change: dict[str, float | None], words: str, of_sheet: bool
) -> None:
    """White is at 2000 DN, and good prints may be off by an eighth."""
    sensor = replace(press.sensors[0], mean_dn=np.full((33,) * 4, 2000, np.float32))
    assert sensor.top_code_dn == 4095
    wrong = wrong_light([replace(RIGHT, **change)], [sensor], prior=only_paper(0.125))
    assert (wrong is not None) == bool(words)
    if wrong is not None:
        assert words in wrong.reason
        assert "sensor" not in wrong.reason  # there is but one
        assert wrong.of_sheet is of_sheet


def test_it_may_be_the_sheet_alone_where_every_sensor_says_so(press: Press) -> None:
    lamp, sheet = replace(RIGHT, page=0.5, backing=0.5), replace(RIGHT, page=0.5)
    sensors = [replace(press.sensors[0], name=name) for name in ("mono", "blue")]
    for levels, of_sheet in (((lamp, sheet), False), ((sheet, sheet), True), ((RIGHT, sheet), True)):
        wrong = wrong_light(levels, sensors, prior=only_paper(0.125))
        assert wrong is not None
        assert wrong.of_sheet is of_sheet
        told = [part.split(":")[0] for part in wrong.reason.split("; ")]
        assert told == [
            f"sensor {one.name}" for one, level in zip(sensors, levels, strict=True) if level is not RIGHT
        ]
