"""The lens: where the image lies, how bright it is, how sharp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def diffraction_mtf(
    frequency_per_mm: ArrayLike, *, wave_nm: ArrayLike, f_number: float
) -> NDArray[np.float64]:
    """Incoherent MTF of a perfect circular lens, (2/pi)(acos x - x sqrt(1 - x^2)), x = frequency lambda N.

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
    """A diffraction-limited thin lens, focused on the page."""

    focal_length_mm: float
    f_number: float
    transmittance: float
    object_distance_mm: float
    """Lens to page. [mm]"""

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
        """Lens to sensor, 1/v = 1/f - 1/s. [mm]"""
        return 1.0 / (1.0 / self.focal_length_mm - 1.0 / self.object_distance_mm)

    @property
    def magnification(self) -> float:
        """Size on the sensor over size on the page, |m| = v/s (the image is upside down). [-]"""
        return self.image_distance_mm / self.object_distance_mm

    @property
    def working_f_number(self) -> float:
        """F-number of the cone that reaches the sensor, N (1 + |m|). [-]"""
        return self.f_number * (1 + self.magnification)

    @property
    def irradiance_per_radiance(self) -> float:
        """On-axis image irradiance over scene radiance, pi T / (1 + 4 N^2 (1 + |m|)^2) (ISETCam's form). [sr]"""
        return np.pi * self.transmittance / (1 + 4 * self.working_f_number**2)

    def mtf(self, frequency_per_mm: ArrayLike, *, wave_nm: ArrayLike) -> NDArray[np.float64]:
        """MTF at the working F-number; frequency at the sensor [cycles/mm] and wave_nm [nm] broadcast."""
        return diffraction_mtf(frequency_per_mm, wave_nm=wave_nm, f_number=self.working_f_number)

    def relative_illumination(self, image_height_mm: ArrayLike) -> NDArray[np.float64]:
        """cos^4 of the field angle at a distance from the axis on the sensor [mm]; 1 on the axis."""
        height = np.asarray(image_height_mm, dtype=np.float64)
        cos2 = 1.0 / (1.0 + (height / self.image_distance_mm) ** 2)
        return cos2 * cos2
