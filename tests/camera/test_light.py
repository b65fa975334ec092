import numpy as np
import pytest

from prooflight import spectra
from prooflight.camera.optics import Light

D65 = spectra.illuminant("D65")


@pytest.mark.parametrize("scale", [1.0, 1e-6, 3e5])
def test_a_perfect_diffuser_has_the_stated_luminance_whatever_the_scale_of_the_data(scale: float) -> None:
    light = Light(name="D65", relative_power=D65 * scale, luminance_cd_m2=140.0)
    luminance = 683.0 * 10.0 * float(spectra.luminous_efficiency() @ light.radiance_w)
    assert luminance == pytest.approx(140.0, rel=1e-12)
    np.testing.assert_allclose(light.radiance_w / light.radiance_w[0], D65 / D65[0], rtol=1e-12)


def test_photons_are_joules_over_h_nu() -> None:
    light = Light(name="D65", relative_power=D65, luminance_cd_m2=100.0)
    joules_per_photon = spectra.PLANCK_J_S * spectra.LIGHT_M_S / (spectra.WAVE_NM * 1e-9)
    np.testing.assert_allclose(light.radiance_photons * joules_per_photon, light.radiance_w, rtol=1e-12)


@pytest.mark.parametrize("power", [np.zeros(36), np.where(np.arange(36) == 3, -1.0, 1.0)])
def test_light_needs_power(power: np.ndarray) -> None:
    with pytest.raises(ValueError, match="relative_power"):
        Light(name="dark", relative_power=power, luminance_cd_m2=100.0)


@pytest.mark.parametrize("luminance", [0.0, -1.0, float("nan")])
def test_luminance_is_above_0(luminance: float) -> None:
    with pytest.raises(ValueError, match="luminance_cd_m2 must be above 0"):
        Light(name="D65", relative_power=D65, luminance_cd_m2=luminance)
