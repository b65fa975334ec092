"""Limits of a camera as a whole: combinations of valid numbers that are too fine, too blurred or too dark to compute.

They are checked before anything is computed, and reported in the fields of the press file.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from prooflight.errors import PressFileError
from prooflight.spectra import BANDS

if TYPE_CHECKING:
    from pathlib import Path

    from prooflight.camera.camera import Camera

FINEST_MM: Final = 0.001
COARSEST_MM: Final = 5.0
"""Greatest extent of a pixel or a line on the page; office-class cameras see 0.02 to 0.3 mm."""
LONGEST_BLUR_PIXELS: Final = 256.0
"""Greatest blur by motion, binning and TDI smear combined.

Its footprint takes 150 MB to compute, and the exact camera as many times a page's memory as it has pixels.
"""
LARGEST_SCAN_GB: Final = 2.0
"""Greatest size of the scan of an A4 page."""
_A4_LENGTH_MM: Final = 297.0
_FEWEST_ELECTRONS: Final = 1e-3
"""Least electrons of white paper in a line: no sensor has so little noise that less could be seen."""


def refuse_unworkable(path: Path, camera: Camera) -> None:
    """Refuse a camera whose numbers do not go together; PressFileError names the fields and valid values."""
    _refuse_pitches(path, camera)
    _refuse_blur(path, camera)
    _refuse_large_scans(path, camera)
    _refuse_darkness(path, camera)


def _refuse_pitches(path: Path, camera: Camera) -> None:
    pitch = camera.pixel_pitch_mm
    if not FINEST_MM <= pitch <= COARSEST_MM:
        what = f"a pixel would see {pitch:.3g} mm of the page"
        remedy = (
            "choose lens.focal_length_mm, lens.object_distance_mm and sensor.pixel_pitch_um so that it sees"
            f" {FINEST_MM:g} to {COARSEST_MM:g} mm"
        )
        raise PressFileError(path, what, remedy=remedy)
    if not FINEST_MM <= camera.line_pitch_mm <= COARSEST_MM:
        what = f"lines would lie {camera.line_pitch_mm:.3g} mm apart on the page"
        raise PressFileError(path, what, remedy=_line_rate(camera))


def _line_rate(camera: Camera) -> str:
    """Return the setting that would make lines as far apart as pixels are wide."""
    if camera.speed_mm_s is None:
        return "lower transport.binning_along"
    wanted = camera.speed_mm_s / camera.pixel_pitch_mm
    return f"at transport.speed_mm_s = {camera.speed_mm_s:g} give a sensor.line_rate_hz of about {wanted:.4g}"


def _refuse_blur(path: Path, camera: Camera) -> None:
    travel = camera.travel_pixels
    for sensor in camera.sensors:
        blur = camera.binning_along * travel + camera.smear_pixels(sensor)
        if blur > LONGEST_BLUR_PIXELS:
            what = (
                f"a line of sensor {sensor.name} would be smeared over {blur:.4g} pixels: the paper moves by"
                f" {travel:.4g} in a line, sensor.tdi_stages = {sensor.tdi_stages}"
            )
            raise PressFileError(path, what, remedy=_line_rate(camera))


def _refuse_large_scans(path: Path, camera: Camera) -> None:
    lines = math.ceil(_A4_LENGTH_MM / camera.line_pitch_mm)
    pixels = camera.sensors[0].pixels
    size_gb = 2e-9 * len(camera.sensors) * pixels * lines
    if size_gb > LARGEST_SCAN_GB:
        what = f"a scan of an A4 page would take {size_gb:.3g} GB: {lines} lines of {pixels} pixels"
        remedy = f"take fewer sensor.pixels or coarser ones; {LARGEST_SCAN_GB:g} GB are the most"
        raise PressFileError(path, what, remedy=remedy)


def _refuse_darkness(path: Path, camera: Camera) -> None:
    white = camera.irradiance_photons(np.ones(BANDS))
    for sensor in camera.sensors:
        if not sensor.electrons(white) >= _FEWEST_ELECTRONS:
            what = f"sensor {sensor.name} sees nothing of this light"
            remedy = "raise light.luminance_cd_m2, or give it a quantum_efficiency where the light is"
            raise PressFileError(path, what, remedy=remedy)
