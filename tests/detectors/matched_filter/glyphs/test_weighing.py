"""Glyphs weighed: the log likelihood ratio in closed form, its mean under good prints, and what a scan says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from prooflight.detectors.matched_filter.fit.modes import pixel_map
from prooflight.detectors.matched_filter.glyphs.scoring import (
    FREEDOM,
    GOOD,
    NONE,
    PageGlyphs,
    ScoredPage,
    capped,
    chance_astray,
    log_ratio,
    nuisances,
    prepare_glyphs,
    score_glyphs,
    usual_about,
    without_nuisances,
)
from prooflight.pages.raster import Page
from prooflight.prediction.predict import predict
from prooflight.press.artefact import Press
from prooflight.scans.placement import IN_PLACE

DIGITS = {
    "0": ".###. #...# #...# #...# #...# #...# .###.",
    "1": "..#.. .##.. ..#.. ..#.. ..#.. ..#.. .###.",
    "3": "####. ....# ....# .###. ....# ....# ####.",
    "7": "##### ....# ...#. ...#. ..#.. ..#.. ..#..",
    "8": ".###. #...# #...# .###. #...# #...# .###.",
}


def sheet(rows: list[str], dpi: float) -> Page:
    """Rows of digits, 1.5 mm high, on a page of 36 x 30 mm."""
    cmyk = np.zeros((round(30 * dpi / 25.4), round(36 * dpi / 25.4), 4), np.uint8)
    dot = round(1.5 * dpi / 25.4 / 7)
    for line, text in enumerate(rows):
        for place, digit in enumerate(text):
            mask = np.array([[one == "#" for one in row] for row in DIGITS[digit].split()])
            mask = np.kron(mask, np.ones((dot, dot), bool))
            top, left = (4 + 3 * line) * 7 * dot, (4 + 2 * place) * 6 * dot // 2
            cmyk[top : top + mask.shape[0], left : left + mask.shape[1], 3][mask] = 255
    return Page(cmyk=cmyk, dpi=dpi, name="p0001", number=1)


ROWS = ["0137801378", "8731087310", "1111333388"]


def test_energies_are_those_of_gaussians_and_the_ratio_no_more_than_that_of_two_t_distributions() -> None:
    rng = np.random.default_rng(11)
    basis, differences = rng.normal(size=(len(GOOD), 40)), rng.normal(size=(3, 40))
    sure, residual = rng.uniform(0.5, 2, 40), rng.normal(size=40)
    push, power, energy = without_nuisances(differences, basis, sure, sure * residual)
    covariance = np.diag(1 / sure) + basis.T @ np.diag(np.square(GOOD)) @ basis
    none = stats.multivariate_normal(np.zeros(40), covariance)
    assert energy == pytest.approx(residual @ np.linalg.solve(covariance, residual))
    explained = 2 * push - power
    for index, difference in enumerate(differences):
        there = stats.multivariate_normal(difference, covariance)
        ratio = there.logpdf(residual) - none.logpdf(residual)
        assert explained[index] / 2 == pytest.approx(ratio, rel=1e-9)
        of_t = [stats.multivariate_t(at, covariance, df=FREEDOM) for at in (difference, np.zeros(40))]
        least = min(ratio, of_t[0].logpdf(residual) - of_t[1].logpdf(residual))
        assert log_ratio(energy, explained, 40)[index] == pytest.approx(least, rel=1e-9)


@pytest.mark.parametrize("freedom", [FREEDOM, np.inf])
def test_the_ratio_has_a_mean_of_1_at_most_on_good_prints(freedom: float) -> None:
    """20,000 draws of seed 12, each as wide as chance has it or all alike; the mean is known to 2 %."""
    rng = np.random.default_rng(12)
    basis = rng.normal(size=(len(GOOD), 12))
    difference = 0.3 * rng.normal(size=(1, 12))
    wide = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, 20_000))[:, None] if np.isfinite(freedom) else 1.0
    amounts = rng.normal(size=(20_000, len(GOOD))) * GOOD
    prints = wide * (amounts @ basis + rng.normal(size=(20_000, 12)))
    ratios = []
    for residual in prints:
        push, power, energy = without_nuisances(difference, basis, np.ones(12), residual)
        ratios.append(log_ratio(energy, 2 * push - power, 12)[0])
    assert 0.6 < np.exp(ratios).mean() < 1.06


def test_a_rival_that_explains_a_part_of_much_says_little() -> None:
    """Letters that lie off by more than is foretold: a rival explains two fifths of what is left of them."""
    assert log_ratio(2000.0, np.array([800.0]), 40)[0] < 12
    assert log_ratio(2000.0, np.array([1960.0]), 40)[0] > 80
    assert log_ratio(1e6, np.array([1e6 - 40.0]), 40)[0] < 240  # of a Gaussian it is half a million


@pytest.mark.parametrize(("sd", "most"), [(0.05, 14), (0.15, 7), (0.3, 2), (np.inf, 0)])
def test_the_ratio_is_no_surer_than_the_page_is_placed(sd: float, most: float) -> None:
    assert capped(300.0, chance_astray((sd, sd))) <= most
    assert capped(-3.0, chance_astray((0.05, 0.05))) == pytest.approx(-3.0, abs=1e-3)


@given(seed=st.integers(0, 1000))
def test_ratios_do_not_change_with_units(seed: int) -> None:
    rng = np.random.default_rng(seed)
    basis, difference = rng.normal(size=(len(GOOD), 30)), rng.normal(size=(2, 30))
    sure, residual = rng.uniform(0.5, 2, 30), rng.normal(size=30)
    push, power, _ = without_nuisances(difference, basis, sure, sure * residual)
    again = without_nuisances(difference[::-1], basis, sure, sure * residual)
    np.testing.assert_allclose(again[0][::-1], push)
    assert (power >= 0).all()


def test_what_a_good_print_does_with_a_glyph_costs_no_more_than_it_is_likely() -> None:
    seen = np.random.default_rng(3).random((9, 8))
    for basis in nuisances(seen, seen[::-1]):
        push, power, _ = without_nuisances(
            basis[None], nuisances(seen, seen[::-1]), np.full(72, 1e8), 0 * basis
        )
        assert push[0] == 0
        assert power[0] <= 1 / min(GOOD) ** 2


@pytest.fixture(scope="module")
def page(press: Press) -> Page:
    return sheet(ROWS, press.dpi)


@pytest.fixture(scope="module")
def glyphs(press: Press, page: Page) -> PageGlyphs:
    return prepare_glyphs(page, sensors=press.sensors, geometry=press.geometry)


def residual(press: Press, page: Page, printed: Page) -> NDArray[np.float32]:
    """What a noiseless print in its place leaves."""
    of = [predict(one, sensors=press.sensors, geometry=press.geometry).expected_dn for one in (printed, page)]
    return of[0] - of[1]


def asked(press: Press, page: Page, glyphs: PageGlyphs, left: NDArray[np.float32]) -> ScoredPage:
    where = pixel_map(page, press.geometry, IN_PLACE)
    light = predict(page, sensors=press.sensors, geometry=press.geometry).expected_dn
    return score_glyphs(glyphs, left, np.full_like(left, 1 / 60**2), light, where)


def test_each_digit_is_a_glyph_and_each_outline_a_letter(glyphs: PageGlyphs) -> None:
    assert glyphs.count == sum(map(len, ROWS))
    assert len(glyphs.letters.leader) == len(DIGITS)
    assert sorted(set(glyphs.line.tolist())) == [1, 2, 3]
    for outline in glyphs.letters.leader:
        rivals = glyphs.letters.rivals(int(outline))
        assert outline not in rivals
        assert glyphs.letters.rivals(int(outline)) is rivals  # found once a design


def test_a_patch_is_what_prediction_says_of_its_glyph(press: Press, page: Page, glyphs: PageGlyphs) -> None:
    """Without a glyph the camera sees its patch less; the lens's far light, left out of patches, is 2 % of it."""
    gone = page.cmyk.copy()
    x, y, width, height = (glyphs.box_mm[0] / page.pixel_mm).round().astype(int)
    gone[y : y + height, x : x + width] = 0
    left = residual(press, page, replace(page, cmyk=gone))[0] / glyphs.placed.contrast[0, 0]
    assert left.min() < -0.3
    said = asked(press, page, glyphs, residual(press, page, replace(page, cmyk=gone)))
    assert said.glyphs[0].glyph == 0
    assert said.glyphs[0].missing


def test_a_good_print_says_nothing(press: Press, page: Page, glyphs: PageGlyphs) -> None:
    noise = 60 * np.random.default_rng(5).standard_normal(residual(press, page, page).shape, np.float32)
    assert asked(press, page, glyphs, noise).score < 0
    assert asked(press, page, glyphs, 0 * noise).score == NONE


@pytest.mark.parametrize(("place", "digit"), [(2, "8"), (4, "3"), (9, "0"), (0, "8"), (3, "1")])
def test_another_digit_is_found_where_it_stands(
    press: Press, page: Page, glyphs: PageGlyphs, place: int, digit: str
) -> None:
    rows = [ROWS[0][:place] + digit + ROWS[0][place + 1 :], *ROWS[1:]]
    left = residual(press, page, sheet(rows, press.dpi))
    said = asked(press, page, glyphs, left)
    assert said.score > 20
    worst = said.glyphs[0]
    assert not worst.missing
    x = glyphs.box_mm[worst.glyph, 0] + glyphs.box_mm[worst.glyph, 2] / 2
    dot = round(1.5 * press.dpi / 25.4 / 7)
    assert x == pytest.approx(((4 + 2 * place) * 3 + 2.5) * dot * page.pixel_mm, abs=0.5)
    assert glyphs.line[worst.glyph] == 1


def test_the_usual_energy_is_that_of_the_glyphs_about_one() -> None:
    """Of a row of 40 glyphs the twelve about the fourth are the others of the first thirteen that are seen."""
    box_mm = np.column_stack([2.0 * np.arange(40), np.zeros(40), np.ones((40, 2))])
    pixels = np.full(40, 10.0)
    energy = 10.0 * np.arange(40)
    assert usual_about(box_mm, energy, pixels, 3) == np.median([*range(3), *range(4, 13)])
    assert usual_about(box_mm, energy, np.where(np.arange(40) == 0, 0.0, pixels), 3) == np.median(
        [1, 2, *range(4, 14)]
    )
    assert usual_about(box_mm[:1], energy[:1], pixels[:1], 0) == 0


def test_where_all_letters_scatter_one_says_less(press: Press, page: Page, glyphs: PageGlyphs) -> None:
    """A print whose first line lies 0.3 mm too low, which the page's other lines do not tell."""
    cmyk = page.cmyk.copy()
    below = round((glyphs.box_mm[0, 1] + 2.5) / page.pixel_mm)
    down = round(0.3 / page.pixel_mm)
    cmyk[down:below] = page.cmyk[: below - down]
    here = asked(press, page, glyphs, residual(press, page, replace(page, cmyk=cmyk)))
    one = ROWS[0][:4] + "3" + ROWS[0][5:]
    wrong = asked(press, page, glyphs, residual(press, page, sheet([one, *ROWS[1:]], press.dpi)))
    assert 4 * here.score < wrong.score


def test_a_page_without_glyphs_is_asked_nothing(press: Press, page: Page) -> None:
    empty = replace(page, cmyk=np.zeros_like(page.cmyk))
    glyphs = prepare_glyphs(empty, sensors=press.sensors, geometry=press.geometry)
    assert glyphs.count == 0
    left = np.ones((1, press.geometry.lines(page.height_mm), press.geometry.pixels), np.float32)
    assert asked(press, empty, glyphs, left).score == NONE
