"""An ink model smooths the noise of a measurement."""

import numpy as np
import pytest

from prooflight.inks.chart import Chart
from prooflight.inks.radial_basis import Hybrid
from prooflight.inks.recipes import choose_recipes
from prooflight.spectra import delta_e00, lab
from prooflight_studies.ink.study import with_noise


def test_noise_is_smoothed_and_the_smooth_is_closer_to_the_truth(measured_chart: Chart) -> None:
    recipes = measured_chart.recipes()
    chosen = choose_recipes(recipes.cmyk, 300)
    rest = np.setdiff1d(np.arange(len(recipes.cmyk)), chosen)
    cmyk, clean = recipes.cmyk[chosen], recipes.reflectance[chosen]
    noisy = with_noise(clean, 0.3, np.random.default_rng(2))
    assert delta_e00(lab(noisy), lab(clean)).mean() == pytest.approx(0.3, rel=0.01)
    model = Hybrid.fit(cmyk, noisy)
    assert model.smoothing > 100 * Hybrid.fit(cmyk, clean).smoothing
    unseen = delta_e00(lab(model.reflectance(recipes.cmyk[rest])), lab(recipes.reflectance[rest]))
    assert np.median(unseen) < 0.25  # 0.17 here; the noise itself has a median of 0.25
