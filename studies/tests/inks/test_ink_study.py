from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from prooflight.inks.built_in import built_in_inks
from prooflight.inks.chart import Chart, Recipes
from prooflight.inks.recipes import choose_recipes, printable_recipes
from prooflight.spectra import delta_e00, lab
from prooflight_studies.ink.study import ink_grid, measured_rise, run_ink_study, with_noise


def test_noise_has_the_size_asked_for_and_follows_the_generator(built_in_chart: Chart) -> None:
    spectra = built_in_chart.recipes().reflectance
    noisy = with_noise(spectra, 0.3, np.random.default_rng(0))
    assert delta_e00(lab(noisy), lab(spectra)).mean() == pytest.approx(0.3, rel=1e-3)
    np.testing.assert_array_equal(noisy, with_noise(spectra, 0.3, np.random.default_rng(0)))
    assert (noisy != with_noise(spectra, 0.3, np.random.default_rng(1))).any()


def test_measured_rise_compares_recipes_that_differ_in_one_ink() -> None:
    cmyk = np.array([[0, 0, 0, 0], [0.5, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0.5]])
    level = np.array([0.8, 0.5, 0.53, 0.9])  # the last is lighter, but differs in two inks
    recipes = Recipes(
        cmyk=cmyk,
        reflectance=level[:, None] * np.ones(36),
        count=np.ones(4, dtype=int),
        of_patch=np.arange(4),
    )
    assert measured_rise(recipes) == pytest.approx(0.03)


def test_the_grid_has_every_combination() -> None:
    grid = ink_grid(3)
    assert grid.shape == (3, 3, 3, 3, 4)
    np.testing.assert_array_equal(grid[0, 1, 2, 0], [0, 0.5, 1, 0])


def test_a_quick_study_writes_its_page(
    chart_text: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fast = ("log-linear", "neighbours", "neugebauer")  # the others take longer
    monkeypatch.setattr("prooflight_studies.ink.study._STUDIED", fast)
    candidates = printable_recipes()
    cmyk = candidates[choose_recipes(candidates, 130)]
    path = tmp_path / "chart.txt"
    path.write_text(
        chart_text(100 * cmyk, built_in_inks().reflectance(cmyk), keywords=['DESCRIPTOR "a press"'])
    )
    rows = run_ink_study(path, tmp_path / "results", folds=2, quick=True)
    assert [row["model"] for row in rows] == list(fast)
    page = (tmp_path / "results" / "ink.md").read_text()
    assert "a press, 130 patches of 130 recipes" in page
    assert all(f"| {name} |" in page for name in fast)
    assert "| 100 |" in page
    assert "nan" not in page
    with Image.open(tmp_path / "results" / "ink-learning.png") as picture:
        assert picture.width > 600
