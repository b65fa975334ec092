import numpy as np
import pytest

from prooflight.inks.chart import Chart
from prooflight.inks.ink_model import InkModel, Spread
from prooflight.inks.reflectance import ReflectanceModel

WANTED = np.random.default_rng(8).uniform(0, 256 / 255, size=(3, 5, 4))


@pytest.fixture(scope="module")
def inks(built_in_chart: Chart) -> InkModel:
    return InkModel.fit(built_in_chart, "hybrid", folds=4)


def test_it_is_a_reflectance_model(inks: InkModel) -> None:
    model: ReflectanceModel = inks
    assert model.name == "hybrid"
    got = model.reflectance(WANTED)
    assert got.shape == (3, 5, 36)
    assert ((got > 0) & (got < 1.2)).all()
    np.testing.assert_allclose(got[1, 2], model.reflectance(WANTED[1, 2]), rtol=1e-9)


def test_auto_says_why(built_in_chart: Chart) -> None:
    fitted = InkModel.fit(built_in_chart, folds=3)
    assert fitted.why.startswith(fitted.name)
    assert fitted.why.endswith(tuple("0123456789"))


def test_standard_deviation_follows_the_residuals_nearby() -> None:
    rng = np.random.default_rng(0)
    cmyk = rng.uniform(size=(600, 4))
    sigma = np.where(cmyk[:, :1] < 0.5, 0.01, 0.04)
    root = 0.6 + sigma * rng.normal(size=(600, 36))
    spread = Spread.of(cmyk, np.full((600, 36), 0.36), root**2)
    wanted = np.full((2, 4), 0.5)
    wanted[:, 0] = (0.1, 0.9)
    got = spread.of_root(wanted).mean(axis=1)  # 24 neighbours and 36 bands: 3 % one sigma
    np.testing.assert_allclose(got, [0.01, 0.04], rtol=0.12)


def test_standard_deviation_grows_away_from_patches() -> None:
    rng = np.random.default_rng(1)
    cmyk = rng.uniform(0, 0.4, size=(300, 4))
    spread = Spread.of(cmyk, np.full((300, 36), 0.36), (0.6 + 0.01 * rng.normal(size=(300, 36))) ** 2)
    near, far = spread.of_root(np.array([[0.2] * 4, [1.0] * 4])).mean(axis=1)
    assert near == pytest.approx(0.01, rel=0.15)
    assert far > 4 * near
