from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file
from tests.fuzz.press_mutants import ink_mutants

from prooflight.errors import ChartError
from prooflight.inks.chart import Chart
from prooflight.inks.ink_model import InkModel, Spread
from prooflight.inks.reflectance import ReflectanceModel
from prooflight.inks.selection import MODELS

WANTED = np.random.default_rng(8).uniform(0, 256 / 255, size=(3, 5, 4))


@pytest.fixture(scope="module")
def inks(built_in_chart: Chart) -> InkModel:
    return InkModel.fit(built_in_chart, "hybrid", folds=4)


@pytest.mark.parametrize("model", list(MODELS))
def test_what_is_saved_loads_the_same(built_in_chart: Chart, tmp_path: Path, model: str) -> None:
    fitted = InkModel.fit(built_in_chart, model, folds=3)
    digest = fitted.save(tmp_path / "a.inks")
    loaded = InkModel.load(tmp_path / "a.inks")
    assert loaded.name == fitted.name == model
    np.testing.assert_array_equal(loaded.reflectance(WANTED), fitted.reflectance(WANTED))
    np.testing.assert_array_equal(loaded.standard_deviation(WANTED), fitted.standard_deviation(WANTED))
    for name in ("score", "why", "chart_digest"):
        assert getattr(loaded, name) == getattr(fitted, name)
    assert loaded.chart_digest == built_in_chart.digest
    assert loaded.save(tmp_path / "b.inks") == digest


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


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda data: data[: len(data) // 2], "damaged"),
        (lambda data: data[:-1] + bytes([data[-1] ^ 1]), "its digest differs"),
        (lambda data: b"", "damaged"),
        (lambda data: b"CGATS.17\n" + data, "damaged"),
        (
            lambda data: data.replace(b'"schema":"1"', b'"schema":"9"'),
            "schema 9 of the ink model, this program reads 1",
        ),
        (
            lambda data: data.replace(b"prooflight ink model", b"prooflight ink muddle"),
            "damaged|no ink model",
        ),
        (lambda data: data.replace(b'"model":"hybrid"', b'"model":"hybryd"'), "its digest differs"),
    ],
)
def test_damaged_files_are_refused(inks: InkModel, tmp_path: Path, damage: object, message: str) -> None:
    path = tmp_path / "x.inks"
    inks.save(path)
    before = path.read_bytes()
    path.write_bytes(damage(before))
    assert path.read_bytes() != before
    with pytest.raises(ChartError, match=message) as caught:
        InkModel.load(path)
    assert "\n" not in str(caught.value)


def test_other_files_are_refused(inks: InkModel, tmp_path: Path) -> None:
    with pytest.raises(ChartError, match="no such file"):
        InkModel.load(tmp_path / "none.inks")
    inks.save(tmp_path / "x.inks")
    save_file(load_file(tmp_path / "x.inks"), tmp_path / "y.inks", metadata={"kind": "something"})
    with pytest.raises(ChartError, match="this is no ink model"):
        InkModel.load(tmp_path / "y.inks")


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


def test_standard_deviation_of_reflectance_is_in_its_units(inks: InkModel) -> None:
    got = inks.standard_deviation(WANTED)
    want = (
        2 * np.sqrt(inks.reflectance(WANTED)) * inks.spread.of_root(WANTED.reshape(-1, 4)).reshape(3, 5, 36)
    )
    np.testing.assert_allclose(got, want, rtol=1e-12)


@pytest.mark.parametrize("model", ["log-linear", "neugebauer", "neighbours", "hybrid"])
def test_spoilt_files_are_refused_in_one_line_or_predict(
    built_in_chart: Chart, tmp_path: Path, model: str
) -> None:
    """Seeds (13, 0) to (13, 99), digested anew."""
    path = tmp_path / "a.inks"
    InkModel.fit(built_in_chart, model, folds=2).save(path)
    source, refused = path.read_bytes(), []
    for index in range(100):
        path.write_bytes(ink_mutants(source, np.random.default_rng([13, index])))
        try:
            loaded = InkModel.load(path)
        except ChartError as error:
            refused.append(str(error))
            continue
        assert np.isfinite(loaded.reflectance(WANTED)).all()
        assert np.isfinite(loaded.standard_deviation(WANTED)).all()
    assert len(refused) > 60
    assert all(text.startswith(f"{path}: ") and "\n" not in text for text in refused)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("model.cmyk", np.nan),
        ("model.measured", np.inf),
        ("spread.reach", 0.0),
        ("spread.squared", -1.0),
    ],
)
def test_a_wrong_value_is_refused_at_save_and_named(
    built_in_chart: Chart, tmp_path: Path, name: str, value: float
) -> None:
    fitted = InkModel.fit(built_in_chart, "neighbours", folds=2)
    of, what = name.split(".")
    held = getattr(fitted, of)
    array = getattr(held, what).copy()
    array.reshape(-1)[7] = value
    spoilt = replace(held, **{what: array})
    with pytest.raises(ChartError, match=name):
        replace(fitted, **{of: spoilt}).save(tmp_path / "a.inks")
    assert not list(tmp_path.iterdir())
