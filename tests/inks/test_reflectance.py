import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.inks.reflectance import LogLinear
from prooflight.spectra import BANDS, WAVE_NM

PAPER = 0.8 + 0.0002 * (WAVE_NM - 380)
DENSITY = np.array(
    [3.0 * np.exp(-0.5 * ((WAVE_NM - centre) / 60) ** 2) + 0.05 for centre in (630, 540, 440, 555)]
)
TVI = (0.14, 0.12, 0.10, 0.16)
AREAS = np.linspace(0, 256 / 255, 41)


def test_without_tone_curve_it_is_equation_1() -> None:
    cmyk = np.array([0.2, 0.4, 0.6, 0.1])
    got = LogLinear(paper=PAPER, density=DENSITY).reflectance(cmyk)
    want = [PAPER[b] * np.exp(-sum(cmyk[i] * DENSITY[i, b] for i in range(4))) for b in range(BANDS)]
    np.testing.assert_allclose(got, want, rtol=1e-13)


@pytest.mark.parametrize("ink", range(4))
def test_tint_follows_murray_davies_with_tone_value_increase_in_its_densest_band(ink: int) -> None:
    model = LogLinear(paper=PAPER, density=DENSITY, tvi=TVI)
    band = int(DENSITY[ink].argmax())
    area = np.linspace(0, 1, 21)
    cmyk = np.zeros((21, 4))
    cmyk[:, ink] = area
    effective = area + 4 * TVI[ink] * area * (1 - area)
    solid = PAPER[band] * np.exp(-DENSITY[ink, band])
    want = (1 - effective) * PAPER[band] + effective * solid
    np.testing.assert_allclose(model.reflectance(cmyk)[:, band], want, rtol=1e-12)


def test_tone_curve_keeps_paper_and_solids() -> None:
    curved = LogLinear(paper=PAPER, density=DENSITY, tvi=TVI)
    straight = LogLinear(paper=PAPER, density=DENSITY)
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * 4, indexing="ij"), axis=-1)
    np.testing.assert_allclose(curved.reflectance(corners), straight.reflectance(corners), rtol=1e-12)


def test_tone_curve_has_a_finite_slope_at_no_ink_and_no_step_at_the_solid() -> None:
    model = LogLinear(paper=PAPER, density=DENSITY, tvi=TVI)
    step = 1e-6
    at_zero = model.amount(np.full(4, step)) / step
    greatest = DENSITY.max(axis=1)
    want = (1 + 4 * np.array(TVI)) * (1 - np.exp(-greatest)) / greatest
    np.testing.assert_allclose(at_zero, want, rtol=1e-4)  # second-order term of the curve is below 1e-5 here
    below, at, above = (model.amount(np.full(4, a)) for a in (1 - step, 1.0, 1 + step))
    # one-sided slopes agree to the curvature times the step, curvature is below 100 for these densities
    np.testing.assert_allclose((at - below) / step, (above - at) / step, atol=200 * step)


@given(
    recipe=st.lists(st.floats(0, 256 / 255), min_size=4, max_size=4),
    ink=st.integers(0, 3),
    more=st.floats(0, 1),
    tvi=st.sampled_from([None, TVI]),
)
def test_more_ink_is_never_lighter(
    recipe: list[float], ink: int, more: float, tvi: tuple[float, float, float, float] | None
) -> None:
    model = LogLinear(paper=PAPER, density=DENSITY, tvi=tvi)
    less = np.array(recipe)
    greater = less.copy()
    greater[ink] += more * (256 / 255 - less[ink])
    light, dark = model.reflectance(less), model.reflectance(greater)
    assert (dark > 0).all()
    assert (dark <= light * (1 + 1e-12)).all()


def test_any_leading_shape_gives_the_same_numbers_and_leaves_the_input_alone() -> None:
    model = LogLinear(paper=PAPER, density=DENSITY, tvi=TVI)
    cmyk = np.stack(np.meshgrid(*[AREAS[::20]] * 4, indexing="ij"), axis=-1)
    before = cmyk.copy()
    grid = model.reflectance(cmyk)
    assert grid.shape == (*cmyk.shape[:-1], BANDS)
    assert grid.dtype == np.float64
    np.testing.assert_array_equal(cmyk, before)
    np.testing.assert_allclose(grid[1, 0, 2, 1], model.reflectance(cmyk[1, 0, 2, 1]), rtol=1e-13)
    np.testing.assert_allclose(
        model.reflectance(cmyk.astype(np.float32)), grid, rtol=1e-5
    )  # float32 areas differ by up to 6e-8, times the steepest slope


def test_fit_gets_its_own_coefficients_back() -> None:
    rng = np.random.default_rng(1)
    truth = LogLinear(paper=PAPER, density=DENSITY)
    cmyk = rng.uniform(size=(60, 4))
    fitted = LogLinear.fit(cmyk, truth.reflectance(cmyk))
    np.testing.assert_allclose(fitted.paper, PAPER, rtol=1e-10)
    np.testing.assert_allclose(fitted.density, DENSITY, atol=1e-10)


def test_fit_is_least_squares_in_log_reflectance() -> None:
    rng = np.random.default_rng(2)
    cmyk = rng.uniform(size=(80, 4))
    measured = LogLinear(paper=PAPER, density=DENSITY).reflectance(cmyk) * rng.lognormal(
        sigma=0.1, size=(80, BANDS)
    )
    fitted = LogLinear.fit(cmyk, measured)
    left = np.log(measured) - np.log(fitted.reflectance(cmyk))
    design = np.column_stack([np.ones(80), cmyk])
    np.testing.assert_allclose(design.T @ left, 0, atol=1e-9)  # normal equations


def test_fit_refuses_recipes_that_confuse_two_inks() -> None:
    cmyk = np.random.default_rng(3).uniform(size=(30, 4))
    cmyk[:, 2] = cmyk[:, 1]
    with pytest.raises(ValueError, match="every ink"):
        LogLinear.fit(cmyk, np.full((30, BANDS), 0.5))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"paper": PAPER[:-1]}, "36"),
        ({"paper": PAPER * 0}, "above 0"),
        ({"density": DENSITY[:3]}, r"\(4, 36\)"),
        ({"tvi": (0.1, 0.1, 0.1)}, "four values"),
        ({"tvi": (0.1, 0.1, 0.1, 0.25)}, "four values"),
        ({"tvi": TVI, "density": DENSITY * [[1], [1], [1], [0]]}, "positive density"),
    ],
)
def test_impossible_models_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LogLinear(**({"paper": PAPER, "density": DENSITY} | change))
