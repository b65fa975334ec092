"""Which marks would be caught where: the chain to an alarm taken backwards, and prints of marks. Seeds fixed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from prooflight.commissioning.training.simulated_days import PressDay
from prooflight.detectors.cost import floor_text
from prooflight.detectors.matched_filter.detector import MatchedFilterPage
from prooflight.detectors.matched_filter.entry import model_of
from prooflight.detectors.matched_filter.ranking import (
    ALONE_FROM,
    ALONE_SLOPE,
    alarming_evidence,
    deviation_at,
    evidence_of,
    marks_of,
    strongest_alone,
)
from prooflight.detectors.matched_filter.statistics.marks import PLACE_CLASSES, classify
from prooflight.detectors.matched_filter.visibility import (
    ExpectedPage,
    Mark,
    least_sizes,
    limits,
    on_tint,
)
from prooflight.detectors.optional import ShowsVisibleMarks
from prooflight.detectors.visible_marks import VisibleMarks
from prooflight.inspection.inspector import Inspector
from prooflight.kernels.statistics.marks import CLASSES, LEAST_T, SIZES, WINDOWS
from prooflight.pages.raster import Page
from prooflight.scans.placement import IN_PLACE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from prooflight.press.artefact import Press

WHITE = 1000.0
SHAPE = 90, 80
SIZES_MM = np.array([0.1, 0.2, 0.4, 0.8])
TOLERANCE = 0.003
DPI = 481.8
TRIED = {"bare paper": (10.0, 18.0), "flat tint": (9.0, 33.0), "beside letters": (27.0, 10.0)}
"""Where spots are printed, from the left and the top. [mm]"""


def square(light: float = 0.1) -> Mark:
    """Marks that cover squares of 0.1 mm pixels wholly, and so much of the floor's pixels as of the sizes."""
    pixels = SIZES_MM / 0.1
    sums = np.minimum(pixels[:, None], np.array(WINDOWS)) ** 2
    return Mark(SIZES_MM, sums, np.linspace(0.25, 1, 4), np.array([light]))


def expected(*, sd: float = 20.0, light: NDArray[np.float32] | None = None) -> ExpectedPage:
    """A page of one sensor and so much noise [DN], blank unless told."""
    light = np.full((1, *SHAPE), WHITE, np.float32) if light is None else light
    white = np.full((1, SHAPE[1]), WHITE, np.float32)
    places = classify(light, white, np.ones(SHAPE, bool), pixel_mm=0.1)
    return ExpectedPage(light=light, weight=np.full_like(light, 1 / sd**2), white=white, places=places)


def sizes(
    page: ExpectedPage, limit: float, *, mark: Mark | None = None, floor: float = 0.0, speck: float = 0.0
) -> NDArray[np.float32]:
    """Least sizes where every class and window has the same limit."""
    specks = np.full(SIZES, speck, np.float32)
    limiting_t = np.full((CLASSES, SIZES, 2), limit)
    return least_sizes(
        page, mark or square(), limiting_t, tolerance=TOLERANCE, specks=specks, floor_share=floor
    )


@pytest.mark.parametrize("speck", [0.0, 0.05])
@pytest.mark.parametrize("sd", [20.0, 100.0, 400.0])
def test_on_a_blank_page_the_size_is_that_of_the_closed_form(sd: float, speck: float) -> None:
    """A mark that takes the share a of the light of c pixels of a k x k window has
    T = (a c - b k^2) / sqrt(k^2 s^2 + (t k^2)^2), s being a pixel's relative noise and b what specks may take.
    """
    limit, noise = 7.0, sd / WHITE
    found = sizes(expected(sd=sd), limit, speck=speck)[45, 40]
    asked = []
    for window, sums in zip(WINDOWS, square().sums.T, strict=True):
        scatter = np.sqrt((window * noise) ** 2 + (TOLERANCE * window**2) ** 2)
        cover = (limit * scatter + speck * window**2) / 0.9
        asked.append(np.interp(cover, sums, SIZES_MM, right=np.inf))
    assert found == pytest.approx(min(asked), rel=1e-6)


def test_noise_makes_least_sizes_larger_and_too_much_of_it_makes_them_infinite() -> None:
    middles = [float(sizes(expected(sd=sd), 7.0)[45, 40]) for sd in (50.0, 100.0, 200.0, 400.0, 4000.0)]
    assert middles == sorted(middles)
    assert middles[0] < middles[3] < np.inf
    assert middles[-1] == np.inf


def test_steeper_edges_make_least_sizes_larger() -> None:
    """Windows over an edge whose variance is larger need larger marks."""
    found = []
    for extra in (1.0, 3.0, 10.0):
        page = expected(sd=100.0)
        weight = page.weight.copy()
        weight[:, :, 38:43] /= extra**2
        found.append(sizes(replace(page, weight=weight), 7.0))
    assert (found[0] <= found[1]).all()
    assert (found[1] <= found[2]).all()
    assert found[0][45, 40] < found[1][45, 40] < found[2][45, 40]
    assert found[2][45, 10] == found[0][45, 10]


def test_the_floor_catches_where_windows_do_not_and_only_in_flat_places() -> None:
    """It asks for 10 % of white: 1/9 of what the mark takes of paper, and half of what it takes of a tint of 30 %."""
    light = np.full((1, *SHAPE), WHITE, np.float32)
    light[:, :, 40:] = 0.3 * WHITE
    page = expected(light=light, sd=10.0)
    assert np.isinf(sizes(page, 1e4)[45]).all()
    caught = sizes(page, 1e4, floor=0.1)
    assert caught[45, 10] == pytest.approx(0.1)
    assert caught[45, 70] == pytest.approx(0.2, rel=1e-5)
    assert np.isinf(caught[45, 40])
    noisy = sizes(expected(light=light, sd=20.0), 1e4, floor=0.1)  # six sigma are 12 % of white
    assert noisy[45, 70] == pytest.approx(np.interp(0.6, [0.5, 0.75], [0.2, 0.4]), rel=1e-5)


def test_a_mark_does_not_show_on_what_is_as_dark() -> None:
    """Nor does what sums of windows round to, beside what is light (seeds 2 and 3)."""
    dark = np.random.default_rng(2).uniform(0.02, 0.1, (1, *SHAPE)).astype(np.float32) * np.float32(WHITE)
    dark[:, :50, :30] = np.random.default_rng(3).uniform(0.5, 1.0, (50, 30)) * WHITE
    found = sizes(expected(light=dark), 3.0, floor=0.1)
    assert np.isinf(found[:, 30 + max(WINDOWS) :]).all()
    assert np.isinf(found[50 + max(WINDOWS) :]).all()
    assert np.isfinite(found[20, 10])


def test_two_sensors_see_smaller_marks_than_one() -> None:
    one = expected(sd=200.0)
    both = replace(
        one,
        **{name: np.concatenate([getattr(one, name)] * 2) for name in ("light", "weight", "white")},
    )
    mark = square()
    twice = mark._replace(light=np.concatenate([mark.light] * 2))
    assert sizes(both, 9.0, mark=twice)[45, 40] < sizes(one, 9.0)[45, 40]


def test_evidence_taken_backwards_gives_the_deviation_again(trained_press: Press) -> None:
    assert "matched_filter" in trained_press.detectors
    screen = model_of(trained_press).model.screen
    assert screen is not None
    rising = (np.diff(screen.quantiles) > 0).all(axis=1)  # where good pages tie, more is said at once
    assert rising.sum() > 40
    for evidence in (0.5, 1.2, 2.5, 4.0):
        deviation = deviation_at(evidence, screen.quantiles, screen.tail, screen.tail_from)
        members = np.arange(len(screen.families))
        again = evidence_of(deviation[None], members, screen.quantiles, screen.tail, screen.tail_from)
        np.testing.assert_allclose(again[0, rising], evidence, rtol=1e-6)
        assert (again[0] > evidence - 1e-6).all()


def test_a_page_at_the_limit_scores_the_threshold() -> None:
    marks = np.array([True, True, True, False])
    evidence = np.zeros((1, 4))
    evidence[0, 1] = alarming_evidence(4.2, 3)
    alone = strongest_alone(evidence, marks)[0]
    assert ALONE_SLOPE * (alone - ALONE_FROM) == pytest.approx(4.2)


def test_statistics_taken_backwards_deviate_as_far_again(trained_press: Press) -> None:
    assert "matched_filter" in trained_press.detectors
    model = model_of(trained_press).model
    rng = np.random.default_rng(3)
    deviations, features = (
        rng.normal(0, 2, len(model.statistics)),
        rng.normal(model.centre[0], model.centre[1]),
    )
    again = model.deviations(model.values_at(deviations, features)[None], features[None])[0]
    np.testing.assert_allclose(again, deviations, atol=1e-6)


def test_limits_rise_with_the_threshold(trained_press: Press) -> None:
    assert "matched_filter" in trained_press.detectors
    model, windows = model_of(trained_press).model, np.full((CLASSES, SIZES), 1e5)
    low, high = (limits(model, threshold, model.centre[0], windows) for threshold in (0.0, 6.0))
    assert (low >= LEAST_T).all()
    assert (high > low).all()


def design() -> NDArray[np.uint8]:
    """Bare paper, a tint of 40 % black and stripes as wide as letters' stems, (rows, columns, 4)."""
    rows, columns = round(44 * DPI / 25.4), round(36 * DPI / 25.4)
    cmyk = np.zeros((rows, columns, 4), np.uint8)
    cmyk[rows // 2 :, : columns // 2, 3] = 102
    rng = np.random.default_rng(1)
    for top in range(60, 240, 40):
        stripes = np.repeat(rng.random(-(-columns // 8)) < 0.4, 8)[:columns]
        cmyk[top : top + 30, :, 3] = np.where(stripes, 255, 0)
    return cmyk


def page_of(cmyk: NDArray[np.uint8]) -> Page:
    return Page(cmyk=cmyk, dpi=DPI, name="p0001", number=1)


def spotted(x_mm: float, y_mm: float, diameter_mm: float) -> Page:
    """The design with a disc of 90 % black."""
    cmyk, pixels, parts = design(), DPI / 25.4, 8
    radius, x, y = diameter_mm / 2 * pixels, x_mm * pixels, y_mm * pixels
    left, top, side = int(x - radius) - 1, int(y - radius) - 1, int(2 * radius) + 4
    rows, columns = (np.mgrid[0 : side * parts, 0 : side * parts] + 0.5) / parts
    disc = (columns + left - x) ** 2 + (rows + top - y) ** 2 < radius**2
    cover = disc.reshape(side, parts, side, parts).mean(axis=(1, 3))
    black = cmyk[top : top + side, left : left + side, 3]
    black[:] = np.maximum(black, np.rint(229.5 * cover)).astype(np.uint8)
    return page_of(cmyk)


class Designs:
    def page(self, _index: int) -> Page:
        return page_of(design())


def _marks(inspector: Inspector) -> VisibleMarks:
    assert isinstance(inspector.detector, ShowsVisibleMarks)
    return inspector.detector.visible_marks(inspector.planned(page_of(design())))


@pytest.mark.parametrize("where", TRIED)
def test_spots_half_as_wide_again_alarm_and_half_as_wide_do_not(trained_press: Press, where: str) -> None:
    """Prints of one press day, seed 5, noise of seeds 0 and 1: the map says which spots alarm by marks or the floor."""
    assert "matched_filter" in trained_press.detectors
    inspector = Inspector.of(trained_press)
    prepared = inspector.prepare(page_of(design()))
    assert isinstance(prepared.prepared_page, MatchedFilterPage)
    marks, model = _marks(inspector), prepared.prepared_page.model
    assert model.screen is not None
    x, y = TRIED[where]
    place = int((y - marks.top_mm) / marks.line_mm), int((x - marks.left_mm) / marks.pixel_mm)
    size = float(marks.spot_mm[place])
    of_marks = marks_of(model.screen.families)
    limit = alarming_evidence(model_of(trained_press).threshold, int(of_marks.sum()))
    day = PressDay.of(trained_press, Designs(), seed=5, first=0).day
    for times in (0.5, 1.5):
        for seed in (0, 1):
            rng = np.random.default_rng([seed, 3])
            scan = day.recorded(day.seen_in_press(spotted(x, y, times * size), rng, IN_PLACE), rng)
            found = inspector.inspect(prepared, scan)
            deviations = model.deviations(
                found.stored_arrays["values"][None], found.stored_arrays["page_features"][None]
            )
            by_marks = model.screen.evidence(deviations)[0, of_marks].max() > limit
            by_floor = found.stored_arrays["floor_mm2"] > 0.1
            assert (by_marks or by_floor) == (times > 1), (times, seed)
            if times > 1:
                assert found.verdict.verdict == "misprint"


def test_rows_are_of_the_places_that_a_page_has(trained_press: Press) -> None:
    marks = _marks(Inspector.of(trained_press))
    rows = {row.place: row for row in marks.rows()}
    assert sum(row.share for row in rows.values()) == pytest.approx(1)
    assert rows["bare paper"].spot_mm < rows["text or hard edge"].spot_mm
    for row in rows.values():
        assert row.spot_mm <= row.worst_spot_mm
        assert row.hair_mm <= row.worst_hair_mm
    inspected = marks.place < len(PLACE_CLASSES)
    assert np.isnan(marks.spot_mm[~inspected]).all()
    assert not np.isnan(marks.spot_mm[inspected]).any()


def test_a_tint_hides_what_bare_paper_shows(trained_press: Press) -> None:
    assert "matched_filter" in trained_press.detectors
    press_context = trained_press.press_context()
    paper, tint = (on_tint(model_of(trained_press), press_context, black) for black in (0.0, 0.4))
    assert 0.1 < paper[0] < tint[0] < 1
    assert 0.01 < paper[1] < tint[1] < 0.5
    without = on_tint(model_of(trained_press), replace(press_context, floor_share=0.0), 0.0)
    assert without[1] > paper[1]


def test_the_floor_is_said_in_words() -> None:
    assert floor_text(0.1).startswith(
        "A flat place over 0.1 mm² that differs by more than 10 % of paper white"
    )
    assert floor_text(0.0) == ""
