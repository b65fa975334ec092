"""Modulation transfer function (MTF): contrast of a fine pattern in the digital numbers over that on the page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from prooflight.camera.camera import Camera
    from prooflight.camera.sensor import LineSensor


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sharpness:
    """MTFs at the sensor, each of the shape of the requested frequencies. [-]"""

    lens: NDArray[np.float64]
    """MTF of the lens alone, at its working F-number."""
    across: NDArray[np.float64]
    """MTF of lens and pixel, for patterns that vary across the web."""
    along: NDArray[np.float64]
    """MTF of lens, pixel, motion, TDI smear and binning, for patterns that vary along the travel."""


def sharpness(
    camera: Camera, sensor: LineSensor, frequency_per_mm: ArrayLike, *, wave_nm: float | None = None
) -> Sharpness:
    """Return the MTFs of ``camera`` at frequencies (...) [cycles/mm on the sensor] through ``sensor``.

    wave_nm: light of one wavelength; None: the spectrum of white paper's photo-electrons, light x QE.

    A box of width w has the transfer function sinc(w f). Across, the aperture is the whole pixel: its fill
    factor scales light, not its shape (ISETCam's box). Along, the paper moves by one line's travel while a
    line is exposed, and binning adds neighbouring lines: one box as long as all of them. TDI smears by stages
    x |travel - pixel| (the limit of many stages).
    """
    frequency = np.asarray(frequency_per_mm, dtype=np.float64)
    if wave_nm is not None:
        lens = camera.lens.mtf(frequency, wave_nm=wave_nm)
    elif (camera.light.radiance_photons * sensor.quantum_efficiency).any():
        lens = camera.white_mtf(sensor, frequency)
    else:
        message = f"sensor {sensor.name} is not sensitive to this light"
        raise ValueError(message)
    per_pixel = frequency * (sensor.pixel_pitch_um * 1e-3)
    across = lens * np.abs(np.sinc(per_pixel))
    motion = np.sinc(camera.binning_along * camera.travel_pixels * per_pixel)
    motion = motion * np.sinc(camera.smear_pixels(sensor) * per_pixel)
    return Sharpness(lens=lens, across=across, along=across * np.abs(motion))


def nyquist_per_mm(sensor: LineSensor) -> float:
    """Return the Nyquist frequency of the pixels across the web, half a cycle a pixel. [cycles/mm on the sensor]"""
    return 1 / (2 * sensor.pixel_pitch_um * 1e-3)
