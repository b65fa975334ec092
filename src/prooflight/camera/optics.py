"""The light on the page, and the lens: position, irradiance and sharpness of the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prooflight import spectra


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Light:
    """Illuminant of stated strength, uniform over the page."""

    name: str
    relative_power: NDArray[np.float64]
    """Relative spectral power (36,), in any scale."""
    luminance_cd_m2: float
    """Luminance of a perfect white diffuser lying on the page. [cd/m2]"""

    def __post_init__(self) -> None:
        object.__setattr__(self, "relative_power", spectra.on_grid(self.relative_power))
        if (self.relative_power < 0).any() or not self.relative_power.any():
            message = "relative_power must be positive somewhere and negative nowhere"
            raise ValueError(message)
        if not self.luminance_cd_m2 > 0:
            message = f"luminance_cd_m2 must be above 0, got {self.luminance_cd_m2}"
            raise ValueError(message)

    @property
    def radiance_w(self) -> NDArray[np.float64]:
        """Return the radiance of a perfect diffuser (36,). [W sr-1 m-2 nm-1]

        Its luminance is 683 sum(V L) dlambda (CIE 015).
        """
        luminous = (
            spectra.LUMINOUS_EFFICACY_LM_W
            * spectra.STEP_NM
            * (spectra.luminous_efficiency() @ self.relative_power)
        )
        return self.relative_power * (self.luminance_cd_m2 / luminous)

    @property
    def radiance_photons(self) -> NDArray[np.float64]:
        """Return the radiance of a perfect diffuser (36,). [photons s-1 sr-1 m-2 nm-1]"""
        return self.radiance_w * spectra.photons_per_joule()


def diffraction_mtf(
    frequency_per_mm: ArrayLike, *, wave_nm: ArrayLike, f_number: float
) -> NDArray[np.float64]:
    """Return the incoherent MTF of a perfect circular lens, (2/pi)(acos x - x sqrt(1 - x^2)), x = frequency lambda N.

    frequency_per_mm [cycles/mm at the image] and wave_nm [nm] broadcast; f_number is the working F-number.
    Source: Goodman, Introduction to Fourier Optics, section 6.3; ISETCam ``dlMTF``.

        >>> float(diffraction_mtf(0.0, wave_nm=550, f_number=2.8))
        1.0
    """
    x = np.abs(np.asarray(frequency_per_mm, dtype=np.float64)) * (np.asarray(wave_nm) * 1e-6 * f_number)
    x = np.minimum(x, 1.0)
    return (2 / np.pi) * (np.arccos(x) - x * np.sqrt(1 - x * x))


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """Diffraction-limited thin lens, focused on the page."""

    focal_length_mm: float
    f_number: float
    transmittance: float
    object_distance_mm: float
    """Distance from lens to page. [mm]"""

    def __post_init__(self) -> None:
        for field in ("focal_length_mm", "f_number", "transmittance", "object_distance_mm"):
            if not getattr(self, field) > 0:
                message = f"{field} must be above 0, got {getattr(self, field)}"
                raise ValueError(message)
        if self.transmittance > 1:
            message = f"transmittance must be at most 1, got {self.transmittance}"
            raise ValueError(message)
        if self.object_distance_mm <= self.focal_length_mm:
            message = f"object_distance_mm must exceed focal_length_mm, got {self.object_distance_mm}"
            raise ValueError(message)

    @property
    def image_distance_mm(self) -> float:
        """Return the distance from lens to sensor, 1/v = 1/f - 1/s. [mm]"""
        return 1.0 / (1.0 / self.focal_length_mm - 1.0 / self.object_distance_mm)

    @property
    def magnification(self) -> float:
        """Return the size on the sensor over the size on the page, |m| = v/s (the image is upside down). [-]"""
        return self.image_distance_mm / self.object_distance_mm

    @property
    def working_f_number(self) -> float:
        """Return the F-number of the cone that reaches the sensor, N (1 + |m|). [-]"""
        return self.f_number * (1 + self.magnification)

    @property
    def irradiance_per_radiance(self) -> float:
        """Return on-axis image irradiance over scene radiance, pi T / (1 + 4 N^2 (1 + |m|)^2) (ISETCam's form). [sr]"""
        return np.pi * self.transmittance / (1 + 4 * self.working_f_number**2)

    def mtf(self, frequency_per_mm: ArrayLike, *, wave_nm: ArrayLike) -> NDArray[np.float64]:
        """Return the MTF at the working F-number.

        Frequency [cycles/mm at the sensor] and wave_nm [nm] broadcast.
        """
        return diffraction_mtf(frequency_per_mm, wave_nm=wave_nm, f_number=self.working_f_number)

    def relative_illumination(self, image_height_mm: ArrayLike) -> NDArray[np.float64]:
        """Return cos^4 of the field angle at a distance from the axis on the sensor [mm]; 1 on the axis."""
        height = np.asarray(image_height_mm, dtype=np.float64)
        cos2 = 1.0 / (1.0 + (height / self.image_distance_mm) ** 2)
        return cos2 * cos2
