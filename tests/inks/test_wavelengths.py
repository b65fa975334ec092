import numpy as np
import pytest

from prooflight.spectra import WAVE_NM, to_grid


def ramp(wave_nm: np.ndarray) -> np.ndarray:
    return 0.2 + 0.6 * (wave_nm - 300) / 600


@pytest.mark.parametrize("step", [1.0, 2.0, 4.0, 5.0, 20.0, 25.0, 40.0])
@pytest.mark.parametrize("start", [300.0, 360.0, 380.0])
def test_any_step_keeps_a_straight_spectrum(step: float, start: float) -> None:
    wave = np.arange(start, 800, step)
    np.testing.assert_allclose(to_grid(wave, ramp(wave)[None]), ramp(WAVE_NM)[None], atol=1e-12)


def test_the_grid_and_anything_around_it_stay_as_they_are() -> None:
    rng = np.random.default_rng(0)
    wide = np.arange(340.0, 831.0, 10.0)
    spectra = rng.uniform(0.05, 0.9, (3, wide.size))
    inside = (wide >= 380) & (wide <= 730)
    np.testing.assert_array_equal(to_grid(WAVE_NM, spectra[:, inside]), spectra[:, inside])
    np.testing.assert_allclose(to_grid(wide, spectra), spectra[:, inside], atol=1e-12)


def test_outside_the_measured_range_the_last_value_holds() -> None:
    for step in (5.0, 10.0, 20.0):
        wave = np.arange(420.0, 681.0, step)
        got = to_grid(wave, ramp(wave))
        np.testing.assert_allclose(got[WAVE_NM < 420], ramp(np.array(420.0)), rtol=1e-12)
        np.testing.assert_allclose(got[wave[-1] < WAVE_NM], ramp(wave[-1]), rtol=1e-12)


def test_fine_data_is_averaged_over_a_triangle_of_10_nm() -> None:
    wave = np.arange(380.0, 731.0, 1.0)
    line = np.where(wave == 553, 1.0, 0.0)
    got = to_grid(wave, line)
    np.testing.assert_allclose(got[WAVE_NM == 550], 0.7 / 10, rtol=1e-12)
    np.testing.assert_allclose(got[WAVE_NM == 560], 0.3 / 10, rtol=1e-12)
    assert np.count_nonzero(got) == 2


def test_a_coarse_spectrum_is_smooth_and_never_leaves_its_own_range() -> None:
    wave = np.arange(380.0, 741.0, 20.0)
    edge = np.where(wave < 560, 0.02, 0.85)
    got = to_grid(wave, edge)
    assert got.min() == 0.02
    assert got.max() == 0.85
    smooth = 0.4 + 0.3 * np.sin((wave - 380) / 60)
    wanted = 0.4 + 0.3 * np.sin((WAVE_NM - 380) / 60)
    inside = (WAVE_NM > 430) & (WAVE_NM < 680)  # the spline's straight ends cost more
    # staying in range cuts a peak between two points by up to f'' h^2 / 8 = 0.3 / 60^2 * 20^2 / 8 = 0.004
    np.testing.assert_allclose(to_grid(wave, smooth)[inside], wanted[inside], atol=0.004)
    off_peak = inside & (WAVE_NM != 470)  # there f'''' h^4 / 384 = 1e-5 is left
    np.testing.assert_allclose(to_grid(wave, smooth)[off_peak], wanted[off_peak], atol=2e-5)
