from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.inks.built_in import built_in_inks
from prooflight.inks.chart import Chart
from prooflight.inks.neugebauer import Neugebauer, effective_area
from prooflight.inks.recipes import choose_recipes
from prooflight.spectra import BANDS, delta_e00, lab

SOLIDS = np.array(list(product((0.0, 1.0), repeat=4)))
PRIMARIES = built_in_inks().reflectance(SOLIDS) + 0.005
CURVES = np.array([[0.1, 0.02], [0.12, -0.03], [0.05, 0.0], [0.15, 0.04]])
TRUTH = Neugebauer(n=2.4, curves=CURVES, roots=PRIMARIES ** (1 / 2.4))
STRAIGHT = np.zeros((4, 2))


def test_solids_are_the_primaries_for_any_n() -> None:
    for n in (1.0, 2.0, 7.0):
        model = Neugebauer(n=n, curves=CURVES, roots=PRIMARIES ** (1 / n))
        np.testing.assert_allclose(model.reflectance(SOLIDS), PRIMARIES, rtol=1e-12)


def test_one_ink_without_spread_of_light_is_murray_davies_and_two_are_demichel() -> None:
    model = Neugebauer(n=1.0, curves=STRAIGHT, roots=PRIMARIES)
    paper, black, yellow, both = PRIMARIES[[0, 1, 2, 3]]
    np.testing.assert_allclose(
        model.reflectance(np.array([0, 0, 0, 0.3])), 0.7 * paper + 0.3 * black, rtol=1e-12
    )
    mosaic = 0.6 * 0.7 * paper + 0.6 * 0.3 * black + 0.4 * 0.7 * yellow + 0.4 * 0.3 * both
    np.testing.assert_allclose(model.reflectance(np.array([0, 0, 0.4, 0.3])), mosaic, rtol=1e-12)


def test_yule_nielsen_darkens_tints() -> None:
    tint = np.array([0.0, 0.0, 0.0, 0.5])
    by_n = [
        Neugebauer(n=n, curves=STRAIGHT, roots=PRIMARIES ** (1 / n)).reflectance(tint)
        for n in (1.0, 1.5, 3.0, 10.0)
    ]
    assert all((more < less).all() for less, more in pairwise(by_n))


@given(t=st.floats(-0.10, 0.18), s=st.floats(-0.06, 0.06))
def test_every_curve_within_the_bounds_rises_from_0_to_1(t: float, s: float) -> None:
    area = np.repeat(np.linspace(0, 256 / 255, 300)[:, None], 4, axis=1)
    effective = effective_area(area, np.array([[t, s]] * 4))
    assert (np.diff(effective, axis=0) > 0).all()
    ends = effective_area(np.array([[0.0] * 4, [1.0] * 4]), np.array([[t, s]] * 4))
    np.testing.assert_allclose(ends, [[0] * 4, [1] * 4], atol=1e-12)


def test_fit_finds_the_truth_again(recipes_100: np.ndarray) -> None:
    model = Neugebauer.fit(recipes_100, TRUTH.reflectance(recipes_100))
    assert model.n == pytest.approx(2.4, abs=0.05)
    np.testing.assert_allclose(model.curves, CURVES, atol=0.01)
    wanted = np.random.default_rng(0).uniform(size=(300, 4))
    assert delta_e00(lab(model.reflectance(wanted)), lab(TRUTH.reflectance(wanted))).max() < 0.1


def test_overprints_never_measured_come_from_the_log_linear_belief(recipes_100: np.ndarray) -> None:
    light = recipes_100[recipes_100.sum(axis=1) < 2.2]
    model = Neugebauer.fit(light, TRUTH.reflectance(light))
    full = model.reflectance(np.ones(4))
    assert (full > 0).all()
    assert (full < 0.05).all()


def test_repeats_count(recipes_100: np.ndarray) -> None:
    spectra = TRUTH.reflectance(recipes_100)
    spectra[0] *= 1.1  # paper measured too bright
    once = Neugebauer.fit(recipes_100, spectra)
    often = Neugebauer.fit(recipes_100, spectra, np.where(np.arange(100) == 0, 1000, 1))
    white = np.zeros(4)
    assert (
        np.abs(often.reflectance(white) - spectra[0]).max()
        < 0.1 * np.abs(once.reflectance(white) - spectra[0]).max()
    )


def test_a_grid_stays_sane(recipes_100: np.ndarray) -> None:
    model = Neugebauer.fit(recipes_100, TRUTH.reflectance(recipes_100))
    grid = model.reflectance(
        np.stack(np.meshgrid(*[np.linspace(0, 256 / 255, 9)] * 4, indexing="ij"), axis=-1)
    )
    assert grid.shape == (9, 9, 9, 9, BANDS)
    assert grid.min() > 0
    assert grid.max() < 1.2
    for ink in range(4):
        assert (
            np.diff(grid, axis=ink).max() < 0.002
        )  # primaries are fitted, so they may cross by their fit's error


def test_a_measured_chart_with_100_patches(measured_chart: Chart) -> None:
    recipes = measured_chart.recipes()
    chosen = choose_recipes(recipes.cmyk, 100)
    model = Neugebauer.fit(recipes.cmyk[chosen], recipes.reflectance[chosen])
    difference = delta_e00(lab(model.reflectance(recipes.cmyk)), lab(recipes.reflectance))
    assert np.median(difference) < 0.6  # 0.44; 16 primaries explain an offset press that well
