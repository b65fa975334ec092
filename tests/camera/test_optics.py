from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prooflight.camera.optics import Lens, diffraction_mtf


def lens(**changes: Any) -> Lens:
    paper: dict[str, Any] = {
        "focal_length_mm": 60.0,
        "f_number": 2.8,
        "transmittance": 1.0,
        "object_distance_mm": 546.6,
    }
    return Lens(**paper | changes)


@given(focal=st.floats(5, 200), ratio=st.floats(1.01, 100))
def test_lens_equation(focal: float, ratio: float) -> None:
    one = lens(focal_length_mm=focal, object_distance_mm=focal * ratio)
    assert 1 / one.image_distance_mm + 1 / one.object_distance_mm == pytest.approx(1 / focal, rel=1e-12)
    assert one.magnification == pytest.approx(1 / (ratio - 1), rel=1e-9)


def test_at_twice_the_focal_length_the_image_is_life_size() -> None:
    one = lens(object_distance_mm=120.0)
    assert one.image_distance_mm == pytest.approx(120.0)
    assert one.magnification == pytest.approx(1.0)
    assert one.working_f_number == pytest.approx(5.6)
    assert one.irradiance_per_radiance == pytest.approx(np.pi / (1 + 4 * 5.6**2))


def test_far_away_the_working_f_number_is_the_engraved_one() -> None:
    assert lens(object_distance_mm=1e9).working_f_number == pytest.approx(2.8, rel=1e-6)


def test_irradiance_is_proportional_to_transmittance_and_falls_with_f_number() -> None:
    assert lens(transmittance=0.5).irradiance_per_radiance == pytest.approx(
        lens().irradiance_per_radiance / 2, rel=1e-12
    )
    numbers = [1.0, 1.4, 2.0, 2.8, 4.0, 5.6]
    irradiances = [lens(f_number=n).irradiance_per_radiance for n in numbers]
    assert (np.diff(irradiances) < 0).all()
    # a stop is half the light once 4 N_w^2 is large against 1
    assert lens(f_number=22.0).irradiance_per_radiance / lens(f_number=44.0).irradiance_per_radiance == (
        pytest.approx(4, rel=1e-3)
    )


def test_mtf_is_1_at_0_and_0_from_the_cut_off() -> None:
    one = lens()
    cut_off = 1 / (550e-6 * one.working_f_number)
    np.testing.assert_allclose(one.mtf([0.0, cut_off, 1.5 * cut_off], wave_nm=550), [1, 0, 0], atol=1e-9)
    assert one.mtf(cut_off * 0.99, wave_nm=550) > 0


def test_mtf_at_half_the_cut_off_has_its_closed_form() -> None:
    # x = 1/2: (2/pi)(pi/3 - sqrt(3)/4)
    assert diffraction_mtf(500.0, wave_nm=1000, f_number=1.0) == pytest.approx(
        2 / np.pi * (np.pi / 3 - np.sqrt(3) / 4), rel=1e-12
    )


def test_mtf_falls_and_is_even_and_starts_with_slope_minus_4_over_pi() -> None:
    x = np.linspace(0, 1, 200)
    mtf = diffraction_mtf(x * 1000, wave_nm=1000, f_number=1.0)
    assert (np.diff(mtf) < 0).all()
    np.testing.assert_array_equal(diffraction_mtf(-x * 1000, wave_nm=1000, f_number=1.0), mtf)
    slope = (diffraction_mtf(1e-3, wave_nm=1000, f_number=1.0) - 1) / 1e-6
    assert slope == pytest.approx(-4 / np.pi, rel=1e-6)


def test_mtf_is_the_overlap_of_two_pupils() -> None:
    """The autocorrelation of a disk, counted on a fine grid."""
    axis = (np.arange(801) - 400) / 400
    x, y = np.meshgrid(axis, axis)
    pupil = x**2 + y**2 <= 1
    for shift in (80, 240, 560):  # of a diameter of 800 samples
        overlap = (pupil[:, shift:] & pupil[:, :-shift]).sum() / pupil.sum()
        mtf = diffraction_mtf(shift / 800, wave_nm=1e6, f_number=1.0)
        assert mtf == pytest.approx(overlap, abs=2e-3)  # the disk's edge is a sample wide


def test_relative_illumination_is_cos4() -> None:
    one = lens()
    assert one.relative_illumination(0.0) == 1.0
    assert one.relative_illumination(one.image_distance_mm) == pytest.approx(0.25)  # 45 degrees
    height = np.linspace(0, 30, 50)
    want = np.cos(np.arctan(height / one.image_distance_mm)) ** 4
    np.testing.assert_allclose(one.relative_illumination(height), want, rtol=1e-12)
    np.testing.assert_array_equal(one.relative_illumination(-height), one.relative_illumination(height))


@pytest.mark.parametrize("field", ["focal_length_mm", "f_number", "transmittance", "object_distance_mm"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_a_field_that_is_not_above_0_is_named(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{field} must be above 0"):
        lens(**{field: value})


def test_glass_does_not_amplify() -> None:
    with pytest.raises(ValueError, match="transmittance must be at most 1"):
        lens(transmittance=1.01)


@pytest.mark.parametrize("distance", [60.0, 59.0])
def test_a_page_nearer_than_the_focal_length_has_no_image(distance: float) -> None:
    with pytest.raises(ValueError, match="object_distance_mm must exceed focal_length_mm"):
        lens(object_distance_mm=distance)
