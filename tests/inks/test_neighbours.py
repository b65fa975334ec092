import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.inks.chart import Chart
from prooflight.inks.neighbours import LocalLinear, Neighbours, inverse_square, plane_weights, tricube
from prooflight.inks.recipes import choose_recipes
from prooflight.spectra import BANDS, delta_e00, lab

RNG = np.random.default_rng(11)
CMYK = RNG.uniform(size=(200, 4))
PLANE = RNG.uniform(-0.1, 0.1, size=(5, BANDS)) + np.array([[0.5], [0], [0], [0], [0]])


def plane(cmyk: np.ndarray) -> np.ndarray:
    return np.concatenate([np.ones((len(cmyk), 1)), cmyk], axis=1) @ PLANE


@pytest.mark.parametrize("weighting", [inverse_square, tricube])
@given(seed=st.integers(0, 1000), neighbours=st.integers(8, 30))
def test_weights_sum_to_one_and_keep_planes(weighting: object, seed: int, neighbours: int) -> None:
    wanted = np.random.default_rng(seed).uniform(0.2, 0.8, size=(7, 4))
    nearest, weight = plane_weights(CMYK, wanted, neighbours, weighting)
    np.testing.assert_allclose(weight.sum(axis=1), 1, rtol=1e-9)
    got = (weight[..., None] * plane(CMYK)[nearest]).sum(axis=1)
    # slopes are held back by a millionth of their sum, more where neighbours nearly lie in one plane
    np.testing.assert_allclose(got, plane(wanted), atol=1e-3)


@pytest.mark.parametrize("kind", [Neighbours, LocalLinear])
def test_undetermined_slopes_are_flat(kind: type[Neighbours | LocalLinear]) -> None:
    flat = CMYK * [1, 1, 1, 0]  # black never printed
    model = kind.fit(flat, np.full((200, BANDS), 0.4))
    np.testing.assert_allclose(model.reflectance(np.array([[0.5, 0.5, 0.5, 1.0]])), 0.4, rtol=1e-6)


def test_the_papers_interpolation_goes_through_measured_patches() -> None:
    measured = RNG.uniform(0.1, 0.9, size=(200, BANDS))
    model = Neighbours.fit(CMYK, measured)
    np.testing.assert_allclose(model.reflectance(CMYK), measured, rtol=1e-6)


def test_local_linear_is_exact_where_the_root_is_linear() -> None:
    model = LocalLinear.fit(CMYK, plane(CMYK) ** 2)
    inside = np.random.default_rng(0).uniform(0.3, 0.7, size=(50, 4))
    np.testing.assert_allclose(model.reflectance(inside), plane(inside) ** 2, atol=1e-4)


def test_local_linear_takes_few_neighbours_where_it_bends_and_many_in_noise() -> None:
    bent = (0.5 + 0.3 * np.sin(9 * CMYK[:, :1])) ** 2 * np.ones(BANDS)
    noisy = plane(CMYK) ** 2 * np.exp(0.2 * np.random.default_rng(1).normal(size=(200, 1)))
    assert LocalLinear.fit(CMYK, bent).neighbours < LocalLinear.fit(CMYK, noisy).neighbours


def test_any_leading_shape(recipes_100: np.ndarray) -> None:
    model = LocalLinear.fit(CMYK, plane(CMYK) ** 2)
    grid = recipes_100.reshape(5, 20, 4)
    got = model.reflectance(grid)
    assert got.shape == (5, 20, BANDS)
    np.testing.assert_allclose(got[2, 3], model.reflectance(grid[2, 3]), rtol=1e-12)


def test_on_a_measured_chart_the_root_makes_planes_five_times_better(measured_chart: Chart) -> None:
    recipes = measured_chart.recipes()
    chosen = choose_recipes(recipes.cmyk, 400)
    rest = np.setdiff1d(np.arange(len(recipes.cmyk)), chosen)
    medians = [
        np.median(delta_e00(lab(model.reflectance(recipes.cmyk[rest])), lab(recipes.reflectance[rest])))
        for model in (
            kind.fit(recipes.cmyk[chosen], recipes.reflectance[chosen]) for kind in (Neighbours, LocalLinear)
        )
    ]
    assert medians[1] < 0.5 * medians[0]


def test_one_neighbour_gives_its_own_value() -> None:
    measured = np.array([[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    nearest, weight = plane_weights(
        measured, np.array([[0.9, 0.1, 0.0, 0.0], [0.2, 0.0, 0.0, 0.0]]), 1, tricube
    )
    np.testing.assert_array_equal(nearest, [[1], [0]])
    np.testing.assert_allclose(weight, 1.0)
