import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.inks.neighbours import Neighbours, inverse_square, plane_weights, tricube
from prooflight.spectra import BANDS

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


def test_undetermined_slopes_are_flat() -> None:
    flat = CMYK * [1, 1, 1, 0]  # black never printed
    model = Neighbours.fit(flat, np.full((200, BANDS), 0.4))
    np.testing.assert_allclose(model.reflectance(np.array([[0.5, 0.5, 0.5, 1.0]])), 0.4, rtol=1e-6)


def test_the_papers_interpolation_goes_through_measured_patches() -> None:
    measured = RNG.uniform(0.1, 0.9, size=(200, BANDS))
    model = Neighbours.fit(CMYK, measured)
    np.testing.assert_allclose(model.reflectance(CMYK), measured, rtol=1e-6)


def test_any_leading_shape(recipes_100: np.ndarray) -> None:
    model = Neighbours.fit(CMYK, plane(CMYK))
    grid = recipes_100.reshape(5, 20, 4)
    got = model.reflectance(grid)
    assert got.shape == (5, 20, BANDS)
    np.testing.assert_allclose(got[2, 3], model.reflectance(grid[2, 3]), rtol=1e-12)


def test_one_neighbour_gives_its_own_value() -> None:
    measured = np.array([[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    nearest, weight = plane_weights(
        measured, np.array([[0.9, 0.1, 0.0, 0.0], [0.2, 0.0, 0.0, 0.0]]), 1, tricube
    )
    np.testing.assert_array_equal(nearest, [[1], [0]])
    np.testing.assert_allclose(weight, 1.0)
