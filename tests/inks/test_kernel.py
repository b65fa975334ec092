import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from prooflight.inks.built_in import built_in_inks
from prooflight.inks.chart import Chart
from prooflight.inks.radial_basis import Hybrid, RadialBasis, _cubes, _plane, _System
from prooflight.inks.recipes import choose_recipes
from prooflight.spectra import BANDS, delta_e00, lab

RNG = np.random.default_rng(21)
CMYK = RNG.uniform(size=(60, 4))
ROOT = np.sqrt(built_in_inks().reflectance(CMYK))


@pytest.mark.parametrize("smoothing", [1e-6, 1e-2, 1.0])
def test_the_taken_apart_system_solves_the_textbook_equations(smoothing: float) -> None:
    noise = 1.0 / RNG.integers(1, 4, 60)
    plane = _plane(CMYK)
    c, b = _System(CMYK, plane, noise, ROOT).solve(smoothing)
    matrix = np.block([[_cubes(CMYK, CMYK) + smoothing * np.diag(noise), plane], [plane.T, np.zeros((5, 5))]])
    wanted = np.linalg.solve(matrix, np.concatenate([ROOT, np.zeros((5, BANDS))]))
    np.testing.assert_allclose(c, wanted[:60], atol=1e-9 * np.abs(wanted).max())
    np.testing.assert_allclose(b, wanted[60:], atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("smoothing", [1e-6, 1e-2])
def test_leave_one_out_is_what_leaving_one_out_gives(smoothing: float) -> None:
    noise = 1.0 / RNG.integers(1, 4, 60)
    plane = _plane(CMYK)
    at_once = _System(CMYK, plane, noise, ROOT).left_out(smoothing)
    for out in (0, 17, 59):
        kept = np.arange(60) != out
        c, b = _System(CMYK[kept], plane[kept], noise[kept], ROOT[kept]).solve(smoothing)
        predicted = _cubes(CMYK[out : out + 1], CMYK[kept]) @ c + plane[out : out + 1] @ b
        np.testing.assert_allclose(at_once[out], ROOT[out] - predicted[0], atol=1e-10)


def test_without_noise_it_is_the_interpolation_that_scipy_knows() -> None:
    model = RadialBasis.fit(CMYK, ROOT**2)
    wanted = RNG.uniform(size=(40, 4))
    other = RBFInterpolator(CMYK, ROOT, kernel="cubic", smoothing=model.smoothing)(wanted) ** 2
    np.testing.assert_allclose(model.reflectance(wanted), np.clip(other, 1e-4, 1.2), atol=1e-8)
    assert delta_e00(lab(model.reflectance(CMYK)), lab(ROOT**2)).mean() < 0.05


def test_repeats_count() -> None:
    noise = np.random.default_rng(3).normal(scale=0.05, size=(60, 1))
    noisy = ROOT**2 * np.exp(noise)
    once = RadialBasis.fit(CMYK, noisy).reflectance(CMYK)
    often = RadialBasis.fit(CMYK, noisy, np.where(np.arange(60) < 5, 10_000, 1)).reflectance(CMYK)
    assert np.abs(often[:5] - noisy[:5]).max() < 0.2 * np.abs(once[:5] - noisy[:5]).max()


@pytest.mark.parametrize("kind", [RadialBasis, Hybrid])
def test_recipes_that_determine_nothing_are_refused(kind: type[RadialBasis]) -> None:
    with pytest.raises(ValueError, match="every ink"):
        kind.fit(CMYK * [1, 1, 1, 0], ROOT**2)
    with pytest.raises(ValueError, match="at least 12"):
        kind.fit(CMYK[:11], ROOT[:11] ** 2)


@pytest.mark.parametrize(("patches", "median"), [(100, 0.28), (200, 0.11)])
def test_well_chosen_patches_teach_a_measured_chart(
    measured_chart: Chart, patches: int, median: float
) -> None:
    recipes = measured_chart.recipes()
    chosen = choose_recipes(recipes.cmyk, patches)
    rest = np.setdiff1d(np.arange(len(recipes.cmyk)), chosen)
    model = Hybrid.fit(recipes.cmyk[chosen], recipes.reflectance[chosen])
    difference = delta_e00(lab(model.reflectance(recipes.cmyk[rest])), lab(recipes.reflectance[rest]))
    assert np.median(difference) <= median


def test_physics_carries_it_beyond_the_ink_limit(measured_chart: Chart) -> None:
    recipes = measured_chart.recipes()
    chosen = choose_recipes(recipes.cmyk, 300)
    known = chosen[recipes.cmyk[chosen].sum(axis=1) <= 3.0]
    heavy = recipes.cmyk.sum(axis=1) > 3.0
    spectra = {
        kind: kind.fit(recipes.cmyk[known], recipes.reflectance[known]).reflectance(recipes.cmyk[heavy])
        for kind in (RadialBasis, Hybrid)
    }
    errors = {kind: delta_e00(lab(got), lab(recipes.reflectance[heavy])) for kind, got in spectra.items()}
    assert errors[Hybrid].max() < 3.0  # 1.9 with the whole chart below the limit
    assert np.median(errors[Hybrid]) < np.median(errors[RadialBasis])
    assert (spectra[Hybrid] > 0).all()


def test_a_fine_grid_of_a_measured_chart_is_sane_and_smooth(measured_chart: Chart) -> None:
    recipes = measured_chart.recipes()
    chosen = choose_recipes(recipes.cmyk, 400)
    model = Hybrid.fit(recipes.cmyk[chosen], recipes.reflectance[chosen])
    grid = model.reflectance(
        np.stack(np.meshgrid(*[np.linspace(0, 256 / 255, 9)] * 4, indexing="ij"), axis=-1)
    )
    assert grid.min() > 0
    assert grid.max() < 1.2
    for ink in range(4):
        # The chart itself rises by 0.037 towards its red solid; elsewhere more ink is darker.
        rise = np.diff(grid, axis=ink).max(axis=-1)
        assert rise.max() < 0.04
        assert (rise > 0.005).mean() < 0.01
    for ink in range(4):
        line = np.full((257, 4), 0.3)
        line[:, ink] = np.linspace(0, 1, 257)
        bend = np.diff(np.sqrt(model.reflectance(line)), n=2, axis=0) * 256**2
        assert np.abs(bend).max() < 20  # a step of 0.0003 between neighbouring points would bend by 20
        assert np.abs(np.diff(bend, axis=0)).max() < 2  # and the second derivative has no jumps
